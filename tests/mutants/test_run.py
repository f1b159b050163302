"""The whole tool on a small program: faults that tests find, miss and do not reach; and a run that is continued."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from mutants.entries import read_list
from mutants.session import PytestOutcome, Run, Work, serve

from tests.conftest import ROOT

PROGRAM = """
def tested(a):
    return a + 1


def hardly_tested(a):
    return a * 4


def untested(a):
    return a - 1


def at_import(a):
    return a + 3


def in_new_process(a):
    return a + 5


def through_fixture(a):
    return a + 7


def flaky(a):
    return a + 9


TABLE = at_import(1)
"""
# a module of their own, so that the test's new process does not import the compiler
KERNELS = """
from numba import njit


@njit(cache=True)
def inner(a):
    return a + 11


@njit(cache=True)
def outer(a):
    return inner(a) * 2.0
"""
TESTS = '''
import subprocess
import sys

import pytest

from groundstation.geometry import compiled, sample


@pytest.fixture(scope="module")
def made():
    return sample.through_fixture(1)


def test_tested():
    assert sample.tested(1) == 2


def test_hardly_tested():
    assert sample.hardly_tested(0) == 0


def test_flaky(tmp_path_factory):
    """Fails in every process but the first, as one that depends on what runs on the machine."""
    from pathlib import Path
    sample.flaky(1)
    seen = Path(__file__).with_name("seen")
    first = not seen.exists()
    seen.touch()
    assert first


def test_before_the_fixture_is_needed():
    assert sample.TABLE == 4


def test_uses_fixture(made):
    assert isinstance(made, int)


def test_uses_fixture_too(made):
    assert made == 8


def test_new_process():
    script = "import sys; from groundstation.geometry.sample import in_new_process as f; sys.exit(f(1) != 6)"
    assert subprocess.run([sys.executable, "-c", script]).returncode == 0


def test_kernel():
    assert compiled.outer(1.0) == 24.0
'''


def fault(function: str, before: str, after: str, module: str = "sample") -> str:
    where = {"package": "groundstation.geometry", "module": f"groundstation.geometry.{module}", "function": function}
    return json.dumps({**where, "shape": "", "kind": "arithmetic", "ordinal": 0, "before": before, "after": after})


FAULTS = {
    "tested": fault("tested", "a + 1", "a - 1"),
    "hardly_tested": fault("hardly_tested", "a * 4", "a / 4"),
    "untested": fault("untested", "a - 1", "a + 1"),
    "at_import": fault("at_import", "a + 3", "a - 3"),
    "in_new_process": fault("in_new_process", "a + 5", "a - 5"),
    "through_fixture": fault("through_fixture", "a + 7", "a - 7"),
    "flaky": fault("flaky", "a + 9", "a - 9"),
    "inner": fault("inner", "a + 11", "a - 11", module="compiled"),
}


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("program")
    (root / "benchmarks").mkdir()
    shutil.copy(ROOT / "benchmarks" / "mutation_score.py", root / "benchmarks")
    ignored = shutil.ignore_patterns("__pycache__", "list.jsonl")
    shutil.copytree(ROOT / "benchmarks" / "mutants", root / "benchmarks" / "mutants", ignore=ignored)
    for folder in ("groundstation", "groundstation/geometry", "tests", "tests/geometry"):
        (root / folder).mkdir(parents=True)
        (root / folder / "__init__.py").touch()
    (root / "groundstation" / "geometry" / "sample.py").write_text(PROGRAM)
    (root / "groundstation" / "geometry" / "compiled.py").write_text(KERNELS)
    (root / "tests" / "geometry" / "test_sample.py").write_text(TESTS)
    (root / "pytest.ini").write_text("[pytest]\npythonpath = .\naddopts = --import-mode=importlib\n")
    (root / "benchmarks" / "mutants" / "list.jsonl").write_text("\n".join(FAULTS.values()) + "\n")
    return root


def run(program: Path, *words: str) -> str:
    command = [sys.executable, "benchmarks/mutation_score.py", *words]
    # the small program's tests need none of the project's plugins, which take longer to import than it to run
    env = {**os.environ, "PYTHONPATH": str(program), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(command, cwd=program, env=env, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_results_found_missed_not_reached_and_continued(program: Path) -> None:
    file = program / "out" / "mutants" / "results.jsonl"
    assert "8 faults to try, 0 of the list gone" in run(program, "run")
    names = {entry.key: entry.function for entry in read_list(program / "benchmarks" / "mutants" / "list.jsonl")}
    results = [json.loads(line) for line in file.read_text().splitlines()]
    assert {names[result["key"]]: (result["result"], result["by"].split("::")[-1]) for result in results} == {
        "tested": ("found", "test_tested"),
        "hardly_tested": ("survived", ""),
        "untested": ("uncovered", ""),
        "at_import": ("found", "test_before_the_fixture_is_needed"),
        "in_new_process": ("found", "test_new_process"),
        "through_fixture": ("found", "test_uses_fixture_too"),
        "flaky": ("survived", ""),
        "inner": ("found", "test_kernel"),
    }
    # the sources were never touched
    assert (program / "groundstation" / "geometry" / "sample.py").read_text() == PROGRAM
    assert (program / "groundstation" / "geometry" / "compiled.py").read_text() == KERNELS

    # as a run that was stopped after six faults
    file.write_text("\n".join(file.read_text().splitlines()[:6]) + "\n")
    again = run(program, "run")
    assert "2 faults to try" in again
    assert "found: 5 of 8 run (62.5 %); 8 on the list" in again
    assert len(file.read_text().splitlines()) == 8


def test_a_stronger_test_is_seen_by_the_next_run(program: Path) -> None:
    test = program / "tests" / "geometry" / "test_sample.py"
    test.write_text(test.read_text().replace("hardly_tested(0) == 0", "hardly_tested(1) == 4"))
    out = run(program, "run", "--again", "survived")
    assert "found: 6 of 8 run" in out


def test_the_number_of_processes_is_as_requested_and_each_job_gets_its_own_result(tmp_path: Path) -> None:
    running, most, got = 0, 0, {}

    def start(run: Run, folder: Path) -> int:
        nonlocal running, most
        running += 1
        most = max(most, running)
        if pid := os.fork():
            return pid
        (folder / "lines").write_text(json.dumps({"end": f"{run.budget_s:.0f}", "outcome": "failed"}) + "\n")
        os._exit(0)

    def job(number: int) -> Work:
        nonlocal running
        for again in range(2):
            ran: PytestOutcome = yield Run(items=[], prepare=lambda folder: None, budget_s=10 * number + again)
            running -= 1
            got[number, again] = ran.failed

    def jobs() -> Iterator[Work]:
        yield from (job(number) for number in range(5))

    serve(jobs(), workers=2, start=start)
    assert got == {(number, again): str(10 * number + again) for number in range(5) for again in range(2)}
    assert most == 2
