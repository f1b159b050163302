"""The table of the results states nothing that does not stand in the notes that it links."""

import json
import re

from pages.glance import NOTES, RESULTS, Row, linked_sections, misplaced, rewritten, rows
from pages.passages import NUMBER, passages, same, sections
from pages.places import PLACES

from tests.docs.pages import ROOT, anchors, text_of

POSITION = NOTES / "position.md"


def glance() -> list[Row]:
    """Return the table of the results, whose rows all have a link, figures and a command."""
    table = sections(text_of(RESULTS))["at-a-glance"]
    found = list(rows(text_of(RESULTS)))
    # all lines of the table but its head and its rule
    assert len(found) == len(re.findall(r"^\|", table, re.MULTILINE)) - 2
    return found


def test_each_figure_of_the_table_is_at_its_place_in_the_notes() -> None:
    """Expected: in its sentence, or in its row and column; a figure without a place is given one in `places`."""
    notes, table = linked_sections(), glance()
    assert {link.split("#")[1] for link in notes} <= set().union(*(anchors(page) for page in NOTES.glob("*.md")))
    assert len(table) >= 20
    found = []
    for row in table:
        found += misplaced(row, passages(notes[row.link]))
    assert found == []
    names = {row.name for row in table}
    assert set(PLACES) <= names
    assert len(names) == len(table)


def test_a_figure_elsewhere_in_the_section_is_found() -> None:
    """Expected: each figure of the table by itself once it is another's, though that stands in the same section."""
    notes = linked_sections()
    for row in glance():
        lines, others = passages(notes[row.link]), sorted(set(NUMBER.findall(notes[row.link])))
        for number in NUMBER.finditer(row.cell):
            other = next(o for o in others if not same(o, number[0]))
            changed = row.cell[: number.start()] + other + row.cell[number.end() :]
            altered = Row(name=row.name, link=row.link, cell=changed, start=row.start)
            assert misplaced(altered, lines), f"{row.name}: {number[0]} may be {other}"


def test_the_table_is_written_from_the_notes() -> None:
    """Expected: nothing to write today; a figure that the notes have otherwise is written as they have it."""
    page, notes = text_of(RESULTS), linked_sections()
    assert rewritten(page, notes) == page
    link = "notes/field.md#in-operation"
    changed = {**notes, link: notes[link].replace("a growth of 9 MB", "a growth of 11 MB")}
    assert changed != notes
    row = "[live: growth of memory in ten minutes](notes/field.md#in-operation) | 20 MB |"
    assert rewritten(page, changed) == page.replace(f"{row} 9 MB |", f"{row} 11 MB |") != page


def test_the_results_are_a_page_of_five_minutes() -> None:
    """Expected: at most 1,500 words, and one figure or two in a cell."""
    assert len(re.findall(r"[^\s|]+", text_of(RESULTS))) <= 1500
    assert [row.name for row in glance() if row.cell.count(";") > 1] == []


_FIGURES = ROOT / "recordings" / "landing-1.figures.json"
# a row's range of y, as far as the aircraft was there, and the name of its bin
_BINS = {"400–485": "400-700", "250–400": "250-400", "150–250": "150-250", "100–150": "100-150", "97–100": "60-100"}
_ACCURACY = re.compile(r"^\| (?:landing-1 )?\| (\d+–\d+)[^|]*\| \d+ \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)


def landing_rows(text: str) -> dict[str, tuple[str, ...]]:
    """Return the accuracy of the bundled landing by range: EKF, triangulation and gain as they are printed."""
    section = sections(text)["accuracy-of-a-replay"]
    table = section[section.index("| landing-1 |") : section.index("| takeoff-1 |")]
    return {cells[0]: cells[1:] for cells in _ACCURACY.findall(table)}


def off_by(printed: str, figure: float) -> bool:
    """Return whether a printed number is not its figure, rounded; figures are kept with five decimals."""
    decimals = len(printed.partition(".")[2])
    return abs(float(printed.replace("−", "-")) - figure) > 0.5 * 10.0**-decimals + 1e-5


def stale(text: str, figures: dict[str, float]) -> list[str]:
    """Return figures of the bundled landing in the section on accuracy that differ from the kept ones."""
    found = []
    found_rows = landing_rows(text)
    assert set(found_rows) == set(_BINS)
    for span, (ekf, triangulation, gain) in found_rows.items():
        for method, cells in (("ekf", ekf), ("triangulation", triangulation)):
            for axis, cell in zip("xyz", cells.split("/"), strict=True):
                figure = figures[f"truth.y{_BINS[span]}.common.{method}.rmse_{axis}_m"]
                if off_by(cell, figure):
                    found.append(f"y {span} m, {method} {axis}: {cell}, kept {figure}")
        for axis, cell in zip("xyz", gain.split("/"), strict=True):
            one, other = (figures[f"truth.y{_BINS[span]}.common.{m}.rmse_{axis}_m"] for m in ("ekf", "triangulation"))
            # to a percent: the figures are rounded as well
            if abs(float(cell.replace("−", "-")) - 100.0 * (1.0 - one / other)) > 1.0:
                found.append(f"y {span} m, gain {axis}: {cell}, kept {100.0 * (1.0 - one / other):.1f}")
    (anees,) = re.findall(r"^- ANEES \(1 is ideal\): landing-1 ([\d.]+)", text, re.MULTILINE)
    if off_by(anees, figures["truth.all.ekf.anees"]):
        found.append(f"ANEES: {anees}, kept {figures['truth.all.ekf.anees']}")
    (clock,) = re.findall(r"^DGPS clock found: landing-1 \+([\d.]+) ±", text, re.MULTILINE)
    if off_by(clock, figures["dgps_clock.offset_s"]):
        found.append(f"DGPS clock: {clock}, kept {figures['dgps_clock.offset_s']}")
    return found


def test_figures_of_the_bundled_landing_are_the_kept_ones() -> None:
    """Expected: a change that moves `landing-1.figures.json` moves the section on accuracy with it."""
    assert stale(text_of(POSITION), json.loads(_FIGURES.read_text())) == []


def test_a_stale_figure_is_found() -> None:
    """Expected: each number by itself, once its kept figure is another."""
    text, kept = text_of(POSITION), json.loads(_FIGURES.read_text())
    for span, (ekf, triangulation, _) in landing_rows(text).items():
        for method, cells in (("ekf", ekf), ("triangulation", triangulation)):
            for axis, cell in zip("xyz", cells.split("/"), strict=True):
                name = f"truth.y{_BINS[span]}.common.{method}.rmse_{axis}_m"
                reported = stale(text, {**kept, name: float(cell) + 0.002})
                assert any(line.startswith(f"y {span} m, {method} {axis}: {cell}") for line in reported)
    reported = stale(text, {**kept, "truth.all.ekf.anees": 9.0, "dgps_clock.offset_s": 0.3})
    assert {line.split(":")[0] for line in reported} >= {"ANEES", "DGPS clock"}
