"""Results of the faults, and the table of them by package and by kind."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from mutants.entries import Entry
from mutants.trial import Result

FOUND = ("found", "timeout")


def read_results(file: Path) -> dict[str, Result]:
    """The last result of each fault, by its key."""
    if not file.exists():
        return {}
    results = [Result(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]
    return {result.key: result for result in results}


def with_results(entries: Iterable[Entry], results: dict[str, Result]) -> list[Entry]:
    """The list with the results of the faults; entries without a result stay as they are."""
    return [
        replace(entry, result=results[entry.key].result, by=results[entry.key].by) if entry.key in results else entry
        for entry in entries
    ]


def table(entries: Sequence[Entry]) -> str:
    """Found, timed out, explained and survived faults by package and by kind, and the survivors one by one."""
    parts = []
    groups: tuple[tuple[str, Callable[[Entry], str]], ...] = (
        ("package", lambda entry: entry.package),
        ("kind", lambda entry: entry.kind),
    )
    for title, group in groups:
        names = sorted({group(entry) for entry in entries})
        rows = [_row(name, [entry for entry in entries if group(entry) == name]) for name in names]
        head = f"| {title} | faults | found | of these by timeout | explained | survived | not run |"
        parts.append("\n".join([head, "|---|---:|---:|---:|---:|---:|---:|", *rows, _row("all", entries)]))
    left = [entry for entry in entries if entry.result and entry.result not in FOUND]
    for entry in left:
        parts.append(
            f"{entry.result}: {entry.module}.{entry.function} [{entry.key}] {entry.kind}\n"
            f"  {_short(entry.before)}  ->  {_short(entry.after)}\n  {entry.explained or 'not explained'}"
        )
    run = [entry for entry in entries if entry.result]
    found = sum(entry.result in FOUND for entry in run)
    share = f"{100 * found / len(run):.1f} %" if run else "none"
    parts.append(f"found: {found} of {len(run)} run ({share}); {len(entries)} on the list")
    return "\n\n".join(parts)


def _row(name: str, entries: Sequence[Entry]) -> str:
    results = Counter(entry.result for entry in entries)
    explained = sum(bool(entry.explained) and entry.result not in (*FOUND, "") for entry in entries)
    survived = results["survived"] + results["uncovered"] - explained
    found = results["found"] + results["timeout"]
    return f"| {name} | {len(entries)} | {found} | {results['timeout']} | {explained} | {survived} | {results['']} |"


def _short(text: str, length: int = 110) -> str:
    line = " ".join(text.split())
    return line if len(line) <= length else f"{line[: length - 1]}…"
