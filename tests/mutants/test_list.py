"""The list of faults: drawn the same each time, found again after moves, edits and renaming, true of the program."""

import gc
import re
from pathlib import Path

import pytest
from mutants.draw import draw, shares
from mutants.entries import LIST, Entry, Locator, new_entry, read_list, write_list
from mutants.places import Function, functions_of, read_functions

from tests.conftest import ROOT

SOURCE = '''
def limited(value, limit):
    """At most the limit."""
    if value > limit:
        return limit
    return value + 1


class Counter:
    def add(self, step=1):
        self.count += step
        return self.count < 10
'''


Known = dict[tuple[str, str], Function]


@pytest.fixture(scope="module")
def known() -> Known:
    # millions of nodes that all stay: collecting garbage among them takes longer than parsing
    gc.disable()
    functions = read_functions(ROOT)
    gc.freeze()
    gc.enable()
    # not unfrozen: without circles they go as soon as nothing refers to them, and all that is frozen would be
    return functions


def functions(source: str, module: str = "groundstation.detection.sample") -> dict[tuple[str, str], Function]:
    return {(module, function.name): function for function in functions_of(source, module)}


def entries_of(known: dict[tuple[str, str], Function]) -> list[Entry]:
    return [new_entry(function, fault) for function in known.values() for fault in function.faults]


def changes(locator: Locator, entries: list[Entry]) -> list[tuple[str, str, int]]:
    located = [locator.find(entry) for entry in entries]
    return [
        ("gone", "", 0) if found is None else (found.entry.function, found.fault.kind, found.fault.ordinal)
        for found in located
    ]


def test_faults_are_found_again_after_a_move_and_new_lines() -> None:
    entries = entries_of(functions(SOURCE))
    expected = [(entry.function, entry.kind, entry.ordinal) for entry in entries]
    assert len(entries) > 8
    moved = "import math\n\n\nOTHER = 3\n\n\ndef another():\n    return 3 > 2\n\n" + SOURCE.replace(
        "return value + 1", "return (\n        value\n        + 1  # one more\n    )"
    )
    locator = Locator(functions(moved, "groundstation.estimation.elsewhere"))
    assert changes(locator, entries) == expected
    assert {locator.find(entry).entry.module for entry in entries} == {"groundstation.estimation.elsewhere"}


def test_faults_are_found_again_after_renaming() -> None:
    entries = entries_of(functions(SOURCE))
    renamed = SOURCE
    for old, new in (("limited", "clamped"), ("value", "number"), ("Counter", "Steps"), ("count", "total")):
        renamed = re.sub(rf"\b{old}\b", new, renamed)
    names = {"limited": "clamped", "Counter.add": "Steps.add"}
    expected = [(names[entry.function], entry.kind, entry.ordinal) for entry in entries]
    assert changes(Locator(functions(renamed)), entries) == expected


def test_an_edit_around_the_place_keeps_it_and_an_edit_of_the_place_loses_it() -> None:
    entries = [entry for entry in entries_of(functions(SOURCE)) if entry.function == "limited"]
    edited = SOURCE.replace("return value + 1", "return value + 2 - offset")
    kept = dict(zip(entries, changes(Locator(functions(edited)), entries), strict=True))
    gone = {entry.before for entry, where in kept.items() if where[0] == "gone"}
    assert gone == {"value + 1", "return value + 1", "1"}
    assert {where[0] for entry, where in kept.items() if entry.before == "value > limit"} == {"limited"}


def test_where_two_functions_fit_none_is_taken() -> None:
    (entry,) = [e for e in entries_of(functions(SOURCE)) if e.kind == "boundary" and e.function == "limited"]
    twice = functions(SOURCE, "calibration.one") | functions(SOURCE, "calibration.two")
    assert Locator(twice).find(entry) is None


def test_the_draw_is_the_same_for_the_same_seed_and_takes_one_fault_a_function(known: Known) -> None:
    some = [function for function in known.values() if function.package in ("ptu_drivers", "groundstation.geometry")]
    first = draw(some, number=24, seed=3, root=ROOT)
    assert draw(reversed(some), number=24, seed=3, root=ROOT) == first
    assert draw(some, number=24, seed=4, root=ROOT) != first
    assert len({(entry.module, entry.function) for entry in first}) == len(first) == 24


def test_what_is_gone_is_replaced_from_the_same_ranking(known: Known) -> None:
    some = [function for function in known.values() if function.package == "groundstation.recording"]
    whole = draw(some, number=10, seed=3, root=ROOT)
    locator = Locator(known)
    kept = [located for entry in whole[1:] if (located := locator.find(entry)) is not None]
    filled = draw(some, number=10, seed=3, root=ROOT, kept=kept)
    assert sorted(filled, key=str) == sorted(whole, key=str)


def test_shares_have_a_minimum_and_follow_the_lines() -> None:
    assert shares({"large": 900, "small": 100}, 30, at_least=5) == {"large": 23, "small": 7}
    with pytest.raises(ValueError, match="fewer than 8 for each of 2 packages"):
        shares({"large": 900, "small": 100}, 15)


def test_a_list_is_read_as_it_was_written(tmp_path: Path) -> None:
    entries = entries_of(functions(SOURCE))
    write_list(tmp_path / "list.jsonl", entries)
    assert sorted(read_list(tmp_path / "list.jsonl"), key=str) == sorted(entries, key=str)
    assert len({entry.key for entry in entries}) == len(entries)


def test_the_committed_list_covers_all_packages_and_still_finds_its_places(known: Known) -> None:
    entries = read_list(LIST)
    locator = Locator(known)
    gone = [f"{entry.module}.{entry.function}" for entry in entries if locator.find(entry) is None]
    # so many may go until the list is filled up again: python benchmarks/mutation_score.py draw
    assert len(entries) - len(gone) >= 300, f"gone: {gone}"
    assert {function.package for function in known.values()} == {entry.package for entry in entries}
    unexplained = [entry.key for entry in entries if entry.result in ("survived", "uncovered") and not entry.explained]
    assert unexplained == []
