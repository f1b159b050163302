# Two targets do everything: `make demo` and `make test`. Both build .venv first, once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out/landing-1
KERNELS := $(shell grep -rl --include=*.py njit groundstation calibration)

.PHONY: demo test docs lint kernels kernels-aboard fuzz peers cameras figures study clean

$(VENV)/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else None'
	@$(PYTHON) -c 'import venv, ensurepip' || { echo "On Debian and Ubuntu: apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,docs,logs,ptu]'
	@touch $@

# numba looks whether a kernel's own file has changed, not those of the kernels that are compiled into it
$(VENV)/kernels: $(KERNELS) | $(VENV)/installed
	@find groundstation calibration -name '*.nb[ic]' -delete
	@touch $@

## demo: replay the bundled landing and print its accuracy
demo: $(VENV)/installed $(VENV)/kernels
	$(BIN)/groundstation replay recordings/landing-1 --out $(OUT)

## test: everything that must hold, under ten minutes on two cores (three workers: a sixth of the time is waiting for devices)
test: $(VENV)/installed $(VENV)/kernels
	@$(MAKE) --no-print-directory --jobs=2 kernels lint kernels-aboard
	$(BIN)/python -m pytest --numprocesses=3 --dist=loadfile --no-loadscope-reorder

## docs: these pages as a site, out/docs/index.html; no network, neither now nor when it is read
docs: $(VENV)/installed
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going docs out/docs
	@echo "wrote out/docs/index.html"

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

## kernels: compile what is compiled, once, while lint has the other core; three workers would compile it three times
kernels: $(VENV)/installed
	$(BIN)/python -m tests.compile_kernels ground

kernels-aboard: $(VENV)/installed
	$(BIN)/python -m tests.compile_kernels aboard >/dev/null

## fuzz: the property tests once more, on examples that no run has seen
fuzz: $(VENV)/installed
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile=new
	$(BIN)/python benchmarks/ptu_fuzz.py

## peers: programs of others that the tests set ours against, in a venv of their own
peers: .venv-peers/installed

.venv-peers/installed:
	$(PYTHON) -m venv .venv-peers
	.venv-peers/bin/python -m pip install --quiet --disable-pip-version-check flirptu==0.0.1a2 alpaca-simulators==1.3.2 evo==1.38.1
	@touch $@

## cameras: what GenICam and GigE Vision cameras need, for their tests (docs/cameras.md)
cameras: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[genicam,gige]'

## figures: commit to new figures of the bundled landing (say why in the changelog)
figures: $(VENV)/installed
	$(BIN)/python benchmarks/change_indicator.py --update

## study: the slow measurements whose figures stand in docs/results.md
study: $(VENV)/installed
	for study in $(filter-out benchmarks/change_indicator.py benchmarks/flightgear_approach.py,$(wildcard benchmarks/*.py)); do echo "== $$study"; $(BIN)/python $$study || exit 1; done

clean:
	rm -rf $(VENV) .venv-peers out build *.egg-info .mypy_cache .ruff_cache .pytest_cache
