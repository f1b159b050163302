"""One fault against the tests that cover it: their selection, order, and result."""

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import FunctionType

import pytest

from mutants.apply import environment, function_objects, put_in
from mutants.coverage import Covering
from mutants.entries import Located
from mutants.kernels import kernels_of
from mutants.session import MORE_CPU_S, MORE_WALL_S, TIMES_CPU, TIMES_WALL, PytestOutcome, Run, Work

# A kernel is compiled again within the first test that calls it.
COMPILATION_CPU_S, COMPILATION_WALL_S = 240.0, 900.0
# A test nearer to the place finds a fault sooner: by this much a farther one counts as longer.
NEAR, IN_FOLDER, FAR = 1.0, 3.0, 10.0
# a test that fails without the fault too is left out, and the rest tried again this often
FLAKY_TESTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Result of one fault.

    Attributes
    ----------
    key : of the entry
    result : "found", "timeout" (found, since a test then takes many times as long), "survived", or "uncovered"
    by : the test that found it
    tests : how many tests ran
    covering : how many cover the place
    seconds : wall time
    """

    key: str
    result: str
    by: str
    tests: int
    covering: int
    seconds: float


class Selection:
    """The tests that cover a function, in the order in which they are run."""

    def __init__(self, covering: Iterable[Covering], items: dict[str, pytest.Item]) -> None:
        self._items = items
        self._covering = with_fixtures([test for test in covering if test.test in items], items)
        self._reaching: dict[tuple[str, str], set[str]] | None = None
        self._reaching_items: dict[tuple[str, str], set[str]] = {}

    def tests(self, located: Located) -> list[tuple[pytest.Item, float, float]]:
        """Tests with their limits of processor and wall time, the nearest and shortest first."""
        function = located.function
        names = {f"{function.module}:{function.name}"}
        direct: set[str] = set()
        if function.is_kernel:
            self._read_kernels()
            assert self._reaching is not None
            names |= self._reaching.get((function.module, function.name), set())
            direct = self._reaching_items.get((function.module, function.name), set())
        chosen = [test for test in self._covering if not names.isdisjoint(test.functions) or test.test in direct]
        chosen.sort(key=lambda test: _order(test, function.module))
        more_cpu, more_wall = (COMPILATION_CPU_S, COMPILATION_WALL_S) if function.is_kernel else (0.0, 0.0)
        return [
            (
                self._items[test.test],
                TIMES_CPU * test.cpu_s + MORE_CPU_S + more_cpu,
                TIMES_WALL * test.wall_s + MORE_WALL_S + more_wall,
            )
            for test in chosen
        ]

    def _read_kernels(self) -> None:
        """What runs each kernel: functions of the packages that name it, and tests that do."""
        if self._reaching is not None:
            return
        self._reaching = {}
        known: dict[tuple[str, str], frozenset[tuple[str, str]]] = {}
        for function in (item for items in function_objects().values() for item in items):
            for kernel in kernels_of(function, known):
                name = f"{function.__module__}:{function.__code__.co_qualname}"
                self._reaching.setdefault(kernel, set()).add(name)
        for name, item in self._items.items():
            if isinstance(plain := getattr(item, "function", None), FunctionType):
                for kernel in kernels_of(plain, known, module_functions=True):
                    self._reaching_items.setdefault(kernel, set()).add(name)


def with_fixtures(covering: list[Covering], items: dict[str, pytest.Item]) -> list[Covering]:
    """The tests with the possible time of their wider fixtures, which only the first test of a file shows.

    That is at most what the longest test takes that uses the same fixture.
    """
    used = {test.test: _wider_fixtures(items[test.test]) for test in covering}
    longest: dict[tuple[str, str], tuple[float, float]] = {}
    for test in covering:
        for fixture in used[test.test]:
            longest[fixture] = max(longest.get(fixture, (0.0, 0.0)), (test.cpu_s, test.wall_s))
    found = []
    for test in covering:
        cpu_s, wall_s = max((longest[fixture] for fixture in used[test.test]), default=(0.0, 0.0))
        found.append(replace(test, cpu_s=max(test.cpu_s, cpu_s), wall_s=max(test.wall_s, wall_s)))
    return found


def _wider_fixtures(item: pytest.Item) -> list[tuple[str, str]]:
    """Fixtures that several tests share; those of all tests (paths) and of pytest itself take no time."""
    definitions = item._fixtureinfo.name2fixturedefs.values()  # type: ignore[attr-defined]
    shared = [each for those in definitions for each in those if each.scope != "function"]
    return [(each.baseid, each.argname) for each in shared if each.baseid not in ("", "tests")]


def _order(test: Covering, module: str) -> tuple[int, str, float]:
    """Near and short first, in steps of a factor two, and within a step file by file."""
    file = Path(test.test.split("::")[0])
    parts = module.split(".")
    folder = parts[1:-1] if parts[0] == "groundstation" else parts[:-1]
    in_folder = list(file.parts[1 : 1 + len(folder)]) == folder
    near = in_folder and file.stem.startswith(f"test_{parts[-1]}")
    cost = (test.cpu_s + 0.3 * test.wall_s + 0.05) * (NEAR if near else IN_FOLDER if in_folder else FAR)
    return int(math.log2(cost) + 20), str(file), cost


def trial(located: Located, selection: Selection, *, root: Path, budget_s: float, imported: bool, into: Path) -> Work:
    """Try one fault, and append its result to a file."""
    tests = selection.tests(located)
    covering = len(tests)
    result = Result(key=located.entry.key, result="uncovered", by="", tests=0, covering=0, seconds=0.0)
    ran_tests, seconds = 0, 0.0
    for _ in range(FLAKY_TESTS):
        if not tests:
            break
        ran: PytestOutcome = yield Run(
            items=tests,
            prepare=lambda folder: put_in(root, located.function, located.fault, folder),
            budget_s=budget_s * (4 if located.function.is_kernel else 1),
        )
        if ran.how == "prepare":
            raise RuntimeError(f"{located.function.module}.{located.function.name}: {ran.lines}")
        ran_tests += sum("begin" in line for line in ran.lines)
        seconds += ran.seconds
        name = "survived" if ran.failed is None else "timeout" if ran.how == "timeout" else "found"
        result = Result(
            key=located.entry.key,
            result=name,
            by=ran.failed or "",
            tests=ran_tests,
            covering=covering,
            seconds=round(seconds, 1),
        )
        if ran.failed is None:
            break
        alone = [test for test in tests if test[0].nodeid == ran.failed]
        without: PytestOutcome = yield Run(items=alone, prepare=lambda folder: None, budget_s=budget_s)
        if without.failed is None:
            break
        tests = [test for test in tests if test[0].nodeid != ran.failed]
        result = replace(result, result="survived", by="")
    if result.result in ("survived", "uncovered") and imported:
        result = in_new_process(located, result, root=root, budget_s=budget_s)
    entry = located.entry
    print(
        f"{result.result:9} {entry.module}.{entry.function} {entry.kind}: {result.tests} of {result.covering} tests,"
        f" {result.seconds:.1f} s {result.by}",
        flush=True,
    )
    with into.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(result)) + "\n")


def in_new_process(located: Located, result: Result, *, root: Path, budget_s: float) -> Result:
    """Code called while modules are imported is tried in a process that imports them with the fault in."""
    module = located.function.module.split(".")
    folder = root / "tests" / Path(*(module[1:-1] if module[0] == "groundstation" else module[:-1]))
    files = sorted(folder.glob(f"test_{module[-1]}*.py")) or sorted(folder.glob("test_*.py"))
    flaky: list[str] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        with_fault = environment(root, located.function, located.fault, Path(scratch))
        for _ in range(FLAKY_TESTS):
            skipped = [f"--deselect={name}" for name in flaky]
            failed = _first_failure([*map(str, files), *skipped], root, with_fault, 4 * budget_s)
            if failed is None:
                return result
            if not failed or _first_failure([failed], root, {}, 4 * budget_s) is None:
                return replace(result, result="found", by=failed or "collection of the tests")
            flaky.append(failed)
    return result


def _first_failure(arguments: list[str], root: Path, variables: dict[str, str], limit_s: float) -> str | None:
    """The first test that fails in a new process, empty when not even the collection succeeds, None when all pass."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *arguments]
    with subprocess.Popen(
        command,
        cwd=root,
        env=os.environ | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            output, _ = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None
    if process.returncode not in (1, 2):
        return None
    names = [line.split()[1] for line in output.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return names[0] if names and "::" in names[0] else ""
