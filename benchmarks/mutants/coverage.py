"""Tests and the functions that they call: each test file once, with a mark in every function.

Calls of a module's or a session's fixture count for each test that uses it; where tests keep results in a cache,
calls of one test of the file count for all of them. A file gets a limited time, and tests beyond it cover nothing:
the score can only become smaller by that. One file of results for each test file; a test file that has changed is run
again.
"""

import hashlib
import json
import os
import re
from collections import defaultdict
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from mutants import marks
from mutants.session import PytestOutcome, Run, Work

# no test of this file may take longer (a first compilation of kernels included)
LONGEST_CPU_S, LONGEST_WALL_S = 300.0, 900.0
_CACHED = re.compile(r"^\s*@(functools\.)?(lru_)?cache\b", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Covering:
    """One test that passes without a fault.

    Attributes
    ----------
    test : pytest's name of it
    functions : its calls, "module:qualified name"
    cpu_s, wall_s : its time, with its fixtures
    """

    test: str
    functions: frozenset[str]
    cpu_s: float
    wall_s: float


class Marker:
    """A pytest plugin that records the calls of each test and of each wider fixture."""

    def __init__(self, imported: Path) -> None:
        self._imported = imported
        self.file = imported
        self._fixtures: dict[str, list[str]] = defaultdict(list)
        self._own: list[str] = []
        self._offset = 0

    def begin(self, folder: Path) -> None:
        """Begin with a separate file in a forked process."""
        self.file = folder / "hits"
        self.file.touch()
        self._offset = 0
        marks.clear(str(self.file))

    def _new(self) -> list[str]:
        marks.again()
        with self.file.open("rb") as file:
            file.seek(self._offset)
            text = file.read()
        whole = text[: text.rfind(b"\n") + 1]
        self._offset += len(whole)
        return whole.decode().splitlines()

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Generator[None, Any, Any]:
        """Attribute the calls of a wider fixture to the fixture."""
        if fixturedef.scope == "function":
            return (yield)
        self._own += self._new()
        try:
            return (yield)
        finally:
            self._fixtures[_fixture_name(fixturedef)] += self._new()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None, Any, Any]:
        """Attribute the calls between the beginning and the end of a test to the test."""
        self._own = []
        marks.again()
        try:
            return (yield)
        finally:
            called = set(self._own) | set(self._new())
            for definitions in item._fixtureinfo.name2fixturedefs.values():  # type: ignore[attr-defined]
                for definition in definitions:
                    called.update(self._fixtures.get(_fixture_name(definition), ()))
            item.user_properties.append(("mutants", sorted(called)))


def _fixture_name(definition: Any) -> str:
    return f"{definition.baseid}::{definition.argname}"


def map_jobs(
    items: dict[str, pytest.Item], *, store: Path, root: Path, marker: Marker, budget_s: float
) -> Iterable[Work]:
    """One job for each test file."""
    by_file: dict[Path, list[pytest.Item]] = defaultdict(list)
    for item in items.values():
        by_file[item.path].append(item)
    # the longest are collected first (tests/conftest.py) and cover least for their time
    for file, those in reversed(by_file.items()):
        yield _map(file, those, store, root, marker, budget_s)


def _map(file: Path, items: list[pytest.Item], store: Path, root: Path, marker: Marker, budget_s: float) -> Work:
    limited = [(item, LONGEST_CPU_S, LONGEST_WALL_S) for item in items]
    ran: PytestOutcome = yield Run(items=limited, prepare=marker.begin, budget_s=budget_s, until_failure=False)
    tests = [line for line in ran.lines if "end" in line]
    if _CACHED.search(file.read_text(encoding="utf-8")):
        union = sorted({name for line in tests for name in line.get("mutants", ())})
        tests = [{**line, "mutants": union} for line in tests]
    name = file.relative_to(root).as_posix()
    print(f"{len(tests):4} of {len(items):4} tests, {ran.seconds:6.1f} s: {name} {ran.how}", flush=True)
    keep(store, root, file, tests)


def keep(store: Path, root: Path, file: Path, tests: list[dict[str, Any]]) -> None:
    """Store the calls of a file's tests, with the hash of its text; no tests where it is left out as a whole."""
    target = _stored(store, root, file)
    target.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"file": file.relative_to(root).as_posix(), "digest": _digest(file), "tests": tests})
    target.with_suffix(".part").write_text(text, encoding="utf-8")
    target.with_suffix(".part").replace(target)


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _stored(store: Path, root: Path, file: Path) -> Path:
    return store / (file.relative_to(root).as_posix().replace("/", "-") + ".json")


def is_known(store: Path, root: Path, file: Path) -> bool:
    """Whether a test file of this text has been run."""
    stored = _stored(store, root, file)
    return stored.exists() and json.loads(stored.read_text(encoding="utf-8"))["digest"] == _digest(file)


def read_map(store: Path) -> list[Covering]:
    """All tests that pass without a fault, with their calls."""
    found = []
    for file in sorted(store.glob("*.json")):
        for line in json.loads(file.read_text(encoding="utf-8"))["tests"]:
            if line["outcome"] == "passed":
                called = frozenset(line.get("mutants", ()))
                found.append(Covering(test=line["end"], functions=called, cpu_s=line["cpu"], wall_s=line["wall"]))
    return found


def imported(file: Path) -> frozenset[str]:
    """The functions that are called while modules are imported and tests collected."""
    return frozenset(file.read_text(encoding="utf-8").split()) if file.exists() else frozenset()


def mark_all(root: Path, file: Path) -> None:
    """Make this process and those that it starts import the packages with marks; before the first import of them."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.touch()
    inject = Path(__file__).parent / "inject"
    os.environ["MUTANTS_ROOT"] = str(root)
    os.environ["MUTANTS_HITS"] = str(file)
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(inject), os.environ.get("PYTHONPATH"))))
