# Two targets do everything: `make demo` and `make test`. Both build .venv first, once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out/landing-1
KERNELS := $(shell grep -rl --include=*.py njit groundstation calibration)

# Bytecode is kept whatever the surroundings ask for: without it each worker and each program that a test starts reads
# every module as text, the tests' assertions included, half a minute of a core each.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test docs docs-check lint kernels fuzz mutants peers peers-node cameras figures pages study constraints clean

# the versions that the tests ran with, for every install below
PIP_INSTALL := -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

$(VENV)/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else None'
	@$(PYTHON) -c 'import venv, ensurepip' || { echo "On Debian and Ubuntu: apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@echo "installing into $(VENV): takes a few minutes, most of it download"
	$(BIN)/python $(PIP_INSTALL) --editable '.[dev,docs,logs,autopilot]'
	@touch $@

# numba looks whether a kernel's own file has changed, not those of the kernels that are compiled into it
$(VENV)/kernels: $(KERNELS) | $(VENV)/installed
	@find groundstation calibration -name '*.nb[ic]' -delete
	@touch $@

## demo: replay the bundled landing and print its accuracy
demo: $(VENV)/installed $(VENV)/kernels
	$(BIN)/groundstation replay recordings/landing-1 --out $(OUT)

## test: everything that must hold, a quarter of an hour on two cores (three workers: a sixth of the time is waiting for devices)
test: $(VENV)/installed $(VENV)/kernels
	@$(MAKE) --no-print-directory --jobs=2 $(VENV)/kernels-ground lint $(VENV)/kernels-aboard $(VENV)/bytecode
	$(BIN)/python -m pytest --numprocesses=3 --dist=loadfile --no-loadscope-reorder

## docs: these pages as a site, out/docs/index.html; no network, neither now nor when it is read
docs: $(VENV)/installed
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going docs out/docs
	@echo "wrote out/docs/index.html"

## docs-check: the commands on the pages that take longer than 5 s; `make test` runs all others
docs-check: $(VENV)/installed $(VENV)/kernels
	$(BIN)/python -m pytest tests/docs/check_long_commands.py

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

## kernels: compile what is compiled, once, while lint has the other core; three workers would compile it three times
kernels: $(VENV)/kernels-ground $(VENV)/kernels-aboard

# again only where a kernel has changed: to run those that are compiled takes seven seconds of a core
$(VENV)/kernels-ground: $(VENV)/kernels
	$(BIN)/python -m tests.compile_kernels ground
	@touch $@

$(VENV)/kernels-aboard: $(VENV)/kernels
	$(BIN)/python -m tests.compile_kernels aboard >/dev/null
	@touch $@

# the tests' bytecode with its rewritten assertions, once; three workers would rewrite each assertion three times
$(VENV)/bytecode: | $(VENV)/installed
	$(BIN)/python -m pytest --collect-only --quiet --quiet >/dev/null
	@touch $@

## fuzz: the property tests on examples that no run has seen; then mutated files through every reader and mutated
## recordings through the commands, which goes on from where an earlier run was interrupted (benchmarks/fuzz)
fuzz: $(VENV)/installed
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile=new
	$(BIN)/python benchmarks/ptu_fuzz.py
	$(BIN)/python benchmarks/recording_fuzz.py
	$(BIN)/python benchmarks/reader_fuzz.py

## mutants: faults put in one by one, do the tests find them? goes on where it was stopped; WORKERS processes at a time
WORKERS ?= 2
mutants: $(VENV)/installed $(VENV)/kernels
	$(BIN)/python benchmarks/mutation_score.py run --workers $(WORKERS)

## peers: programs of others that the tests set ours against, in a venv of their own
peers: .venv-peers/installed

.venv-peers/installed:
	$(PYTHON) -m venv .venv-peers
	.venv-peers/bin/python -m pip install --quiet --disable-pip-version-check flirptu==0.0.1a2 alpaca-simulators==1.3.2 evo==1.38.1
	@touch $@

# a MAVLink receiver in TypeScript (LGPL, a process of its own)
peers-node: .venv-peers/node/installed

.venv-peers/node/installed:
	npm install --silent --no-audit --no-fund --prefix .venv-peers/node node-mavlink@2.3.0
	@touch $@

## cameras: what GenICam and GigE Vision cameras need, for their tests (docs/cameras.md)
cameras: $(VENV)/installed
	$(BIN)/python $(PIP_INSTALL) --editable '.[genicam,gige]'

## figures: commit to new figures of the bundled landing (say why in the changelog)
figures: $(VENV)/installed
	$(BIN)/python benchmarks/change_indicator.py --update

## pages: figures, tables, printed outputs and pictures of README and docs as the program gives them now
pages: $(VENV)/installed $(VENV)/kernels
	$(BIN)/python benchmarks/regenerate_pages.py

## study: the slow measurements whose figures stand in docs/notes
study: $(VENV)/installed
	for study in $(filter-out benchmarks/change_indicator.py benchmarks/flightgear_approach.py benchmarks/mutation_score.py benchmarks/reader_fuzz.py benchmarks/recording_fuzz.py benchmarks/bank_mutation.py benchmarks/bank_notes.py benchmarks/landing_animation.py benchmarks/regenerate_pages.py benchmarks/report_pictures.py benchmarks/proposal_recall.py benchmarks/channel_odds.py benchmarks/channel_worlds.py benchmarks/interrupts.py benchmarks/rule_ablation.py benchmarks/true_pixels.py $(wildcard benchmarks/*_sheet.py),$(wildcard benchmarks/*.py)); do echo "== $$study"; $(BIN)/python $$study || exit 1; done

## constraints: the newest versions that pyproject.toml admits become those that the tests run with
constraints:
	rm -rf build/newest && $(PYTHON) -m venv build/newest
	build/newest/bin/python -m pip install --quiet --disable-pip-version-check '.[dev,docs,logs,autopilot,genicam,gige]'
	{ sed '/^#/!Q' constraints.txt; build/newest/bin/python -m pip freeze --exclude groundstation; } >build/constraints.txt
	mv build/constraints.txt constraints.txt

clean:
	rm -rf $(VENV) .venv-peers out build *.egg-info .mypy_cache .ruff_cache .pytest_cache
