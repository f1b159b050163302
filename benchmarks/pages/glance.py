"""The table "At a glance" of docs/results.md: each of its figures is one of the notes, at the place that is listed."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pages.passages import NUMBER, ROOT, Figure, captured, passages, replaced, rounded_as, same, sections
from pages.places import PLACES

RESULTS = ROOT / "docs" / "results.md"
NOTES = ROOT / "docs" / "notes"
_ROW = re.compile(r"^\| \[([^\]]+)\]\((notes/[a-z]+\.md#[^)]+)\) \|[^|]*\|([^|]*)\| (`[^|`]+`) \|$", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A row of the table: what it is about, the section of the notes, the cell with figures and where it begins."""

    name: str
    link: str
    cell: str
    start: int

    def figures(self) -> list[str]:
        """Return the figures of the cell."""
        return NUMBER.findall(re.sub(r"\]\([^)]*\)", "]", self.cell))


def linked_sections(notes: Path = NOTES) -> dict[str, str]:
    """Return the text of each section of the notes by its link from the results."""
    return {
        f"notes/{page.name}#{anchor}": section
        for page in sorted(notes.glob("*.md"))
        for anchor, section in sections(page.read_text(encoding="utf-8")).items()
    }


def rows(page: str) -> Iterator[Row]:
    """Yield the rows of the table in the text of the results."""
    begin = page.index("## At a glance")
    for match in _ROW.finditer(page, begin):
        yield Row(name=match[1], link=match[2], cell=match[3], start=match.start(3))


def placed(row: Row, lines: list[str]) -> tuple[list[str], list[str]]:
    """Return the figures at a row's places in the passages of its section, and what is wrong with the places."""
    figures: list[str] = []
    faults: list[str] = []
    for template in PLACES.get(row.name, ()):
        match captured(template, lines):
            case [only]:
                figures += only
            case others:
                faults.append(f"{row.name}: {len(others)} passages of {row.link} read {template!r}; wanted one")
                figures += ["0"] * template.count("#")
    if len(figures) != len(row.figures()):
        faults.append(f"{row.name}: {len(row.figures())} figures, {len(figures)} places in benchmarks/pages/places.py")
    return figures, faults


def misplaced(row: Row, lines: list[str]) -> list[str]:
    """Return what of the figures of a row's cell is not, in their order, at their places in the linked passages."""
    figures, faults = placed(row, lines)
    return faults + [
        f"{row.name}: states {one}, and its place in {row.link} {other}"
        for one, other in zip(row.figures(), figures, strict=False)
        if not same(one, other)
    ]


def rewritten(page: str, notes: dict[str, str]) -> str:
    """Return the text of the results with the table's figures as they stand in the notes, rounded as they are now.

    Raises
    ------
    ValueError
        If a row has no places, or a place is not found in the notes.
    """
    changes: list[tuple[Figure, str]] = []
    for row in rows(page):
        if not row.figures():
            continue
        figures, faults = placed(row, passages(notes[row.link]))
        if faults:
            raise ValueError("; ".join(faults))
        for match, other in zip(NUMBER.finditer(row.cell), figures, strict=True):
            if not same(match[0], other):
                start = row.start + match.start()
                changes.append((Figure(start, start + len(match[0]), match[0]), rounded_as(match[0], other)))
    return replaced(page, changes)
