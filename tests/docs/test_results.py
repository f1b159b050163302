"""The table at the top of the results says nothing that does not stand below it."""

import json
import re

from tests.docs.pages import ROOT, anchors, text_of

RESULTS = ROOT / "docs" / "results.md"
_ROW = re.compile(r"^\| \[[^\]]+\]\(#([^)]+)\) \|[^|]*\|([^|]*)\|$", re.MULTILINE)
_NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")


def sections(text: str) -> dict[str, str]:
    """Return each second-level section by its anchor."""
    found = {}
    for part in re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]:
        title = re.sub(r"[^\w\- ]", "", part.splitlines()[0][3:].lower()).replace(" ", "-")
        found[title] = part
    return found


def test_what_the_table_says_was_seen_stands_in_its_section() -> None:
    text = text_of(RESULTS)
    below = sections(text)
    assert set(below) <= anchors(RESULTS)
    rows = _ROW.findall(below["at-a-glance"])
    assert len(rows) >= 20
    missing = []
    for anchor, seen in rows:
        there = set(_NUMBER.findall(below[anchor]))
        missing += [(anchor, number) for number in _NUMBER.findall(seen) if number not in there]
    assert missing == []


_FIGURES = ROOT / "recordings" / "landing-1.figures.json"
# a row's range of y, as far as the aircraft was there, and the name of its bin
_BINS = {"400–518": "400-700", "250–400": "250-400", "150–250": "150-250", "100–150": "100-150", "97–100": "60-100"}
_ACCURACY = re.compile(r"^\| (?:landing-1 )?\| (\d+–\d+)[^|]*\| \d+ \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)


def landing_rows(text: str) -> dict[str, tuple[str, ...]]:
    """Return the accuracy of the bundled landing by range: EKF, triangulation and gain as they are printed."""
    section = sections(text)["accuracy-of-a-replay"]
    table = section[section.index("| landing-1 |") : section.index("| takeoff-1 |")]
    return {rows[0]: rows[1:] for rows in _ACCURACY.findall(table)}


def off_by(printed: str, figure: float) -> bool:
    """Return whether a printed number is not its figure, rounded; figures are kept with five decimals."""
    decimals = len(printed.partition(".")[2])
    return abs(float(printed.replace("−", "-")) - figure) > 0.5 * 10.0**-decimals + 1e-5


def stale(text: str, figures: dict[str, float]) -> list[str]:
    """Return what the section on accuracy says of the bundled landing and the kept figures do not."""
    found = []
    rows = landing_rows(text)
    assert set(rows) == set(_BINS)
    for span, (ekf, triangulation, gain) in rows.items():
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


def test_what_is_said_of_the_bundled_landing_are_the_kept_figures() -> None:
    """Expected: a change that moves `landing-1.figures.json` moves the section on accuracy with it."""
    assert stale(text_of(RESULTS), json.loads(_FIGURES.read_text())) == []


def test_a_stale_figure_is_found() -> None:
    """Expected: each number by itself, once its kept figure is another."""
    text, kept = text_of(RESULTS), json.loads(_FIGURES.read_text())
    rows = landing_rows(text)
    for span, (ekf, triangulation, _) in rows.items():
        for method, cells in (("ekf", ekf), ("triangulation", triangulation)):
            for axis, cell in zip("xyz", cells.split("/"), strict=True):
                name = f"truth.y{_BINS[span]}.common.{method}.rmse_{axis}_m"
                said = stale(text, {**kept, name: float(cell) + 0.002})
                assert any(line.startswith(f"y {span} m, {method} {axis}: {cell}") for line in said)
    said = stale(text, {**kept, "truth.all.ekf.anees": 9.0, "dgps_clock.offset_s": 0.3})
    assert {line.split(":")[0] for line in said} >= {"ANEES", "DGPS clock"}
