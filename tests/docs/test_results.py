"""The table of the results states nothing that does not stand in the notes that it links."""

import json
import re

from tests.docs.pages import ROOT, anchors, text_of
from tests.docs.places import PLACES

RESULTS = ROOT / "docs" / "results.md"
NOTES = ROOT / "docs" / "notes"
POSITION = NOTES / "position.md"
_ROW = re.compile(r"^\| \[([^\]]+)\]\((notes/[a-z]+\.md#[^)]+)\) \|[^|]*\|([^|]*)\| (`[^|`]+`) \|$", re.MULTILINE)
_NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")
_ANY = r"[+−-]?\d+(?:,\d{3})*(?:\.\d+)?"
_WILD = {"#": rf"[+−-]?({_NUMBER.pattern})", "~": _ANY, "_": r"[^|]*", "…": r".*?"}
_BEGINS = re.compile(r"^(?:\||#|<!--|\s*[-*] |\s*\d+\. )")


def sections(text: str) -> dict[str, str]:
    """Return each second-level section by its anchor."""
    found = {}
    for part in re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]:
        title = re.sub(r"[^\w\- ]", "", part.splitlines()[0][3:].lower()).replace(" ", "-")
        found[title] = part
    return found


def passages(section: str) -> list[str]:
    """Return a section's paragraphs, items of lists and rows of tables, each as one line without bold."""
    found: list[list[str]] = [[]]
    for line in section.splitlines():
        if not line.strip() or _BEGINS.match(line) or (found[-1] and found[-1][-1].startswith(("|", "#"))):
            found.append([])
        if line.strip():
            found[-1].append(line.strip())
    return [re.sub(r"\s+", " ", " ".join(lines).replace("*", "")) for lines in found if lines]


def captured(template: str, lines: list[str]) -> list[tuple[str, ...]]:
    """Return the figures in each passage that a template of `places` fits, from a table's row on its beginning."""
    pattern = "".join(_WILD.get(sign, re.escape(sign)) for sign in template.replace(" _ ", "_"))
    if template.endswith(("#", "~")):
        pattern += r"(?![\d,.]*\d)"
    find = re.compile(pattern)
    found = (find.match(line) if template.startswith("|") else find.search(line) for line in lines)
    return [match.groups() for match in found if match]


def same(seen: str, below: str) -> bool:
    """Return whether a figure is one that stands below, as it is or rounded to fewer digits."""
    decimals = len(seen.partition(".")[2])
    apart = abs(float(seen.replace(",", "")) - float(below.replace(",", "")))
    return seen == below or (decimals < len(below.partition(".")[2]) and apart <= 0.5 * 10.0**-decimals + 1e-9)


def linked_sections() -> dict[str, str]:
    """Return the text of each section of the notes by its link from the results."""
    return {
        f"notes/{page.name}#{anchor}": section
        for page in sorted(NOTES.glob("*.md"))
        for anchor, section in sections(text_of(page)).items()
    }


def glance() -> list[tuple[str, str, str]]:
    """Return the table of the results, whose rows all have a link, figures and a command: name, link, figures."""
    table = sections(text_of(RESULTS))["at-a-glance"]
    rows = _ROW.findall(table)
    # all lines of the table but its head and its rule
    assert len(rows) == len(re.findall(r"^\|", table, re.MULTILINE)) - 2
    return [(name, link, cell) for name, link, cell, _ in rows]


def misplaced(name: str, link: str, cell: str, lines: list[str]) -> list[str]:
    """Return what of the figures of a row's cell is not, in their order, at their places in the linked passages."""
    seen = _NUMBER.findall(re.sub(r"\]\([^)]*\)", "]", cell))
    places: list[str] = []
    found: list[str] = []
    for template in PLACES.get(name, ()):
        match captured(template, lines):
            case [only]:
                places += only
            case others:
                found.append(f"{name}: {len(others)} passages of {link} read {template!r}; wanted one")
                places += ["0"] * template.count("#")
    if len(places) != len(seen):
        found.append(f"{name}: {len(seen)} figures, {len(places)} places in tests/docs/places.py")
    return found + [
        f"{name}: states {one}, and its place in {link} {other}"
        for one, other in zip(seen, places, strict=False)
        if not same(one, other)
    ]


def test_each_figure_of_the_table_is_at_its_place_in_the_notes() -> None:
    """Expected: in its sentence, or in its row and column; a figure without a place is given one in `places`."""
    notes, rows = linked_sections(), glance()
    assert {link.split("#")[1] for link in notes} <= set().union(*(anchors(page) for page in NOTES.glob("*.md")))
    assert len(rows) >= 20
    found = []
    for name, link, cell in rows:
        found += misplaced(name, link, cell, passages(notes[link]))
    assert found == []
    assert set(PLACES) <= {name for name, _, _ in rows}
    assert len({name for name, _, _ in rows}) == len(rows)


def test_a_figure_elsewhere_in_the_section_is_found() -> None:
    """Expected: each figure of the table by itself once it is another's, though that stands in the same section."""
    notes = linked_sections()
    for name, link, cell in glance():
        lines, others = passages(notes[link]), sorted(set(_NUMBER.findall(notes[link])))
        for number in _NUMBER.finditer(cell):
            other = next(o for o in others if not same(o, number[0]))
            changed = cell[: number.start()] + other + cell[number.end() :]
            assert misplaced(name, link, changed, lines), f"{name}: {number[0]} may be {other}"


def test_the_results_are_a_page_of_five_minutes() -> None:
    """Expected: at most 1,500 words, and one figure or two in a cell."""
    assert len(re.findall(r"[^\s|]+", text_of(RESULTS))) <= 1500
    assert [name for name, _, cell in glance() if cell.count(";") > 1] == []


_FIGURES = ROOT / "recordings" / "landing-1.figures.json"
# a row's range of y, as far as the aircraft was there, and the name of its bin
_BINS = {"400–485": "400-700", "250–400": "250-400", "150–250": "150-250", "100–150": "100-150", "97–100": "60-100"}
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
    """Return figures of the bundled landing in the section on accuracy that differ from the kept ones."""
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


def test_figures_of_the_bundled_landing_are_the_kept_ones() -> None:
    """Expected: a change that moves `landing-1.figures.json` moves the section on accuracy with it."""
    assert stale(text_of(POSITION), json.loads(_FIGURES.read_text())) == []


def test_a_stale_figure_is_found() -> None:
    """Expected: each number by itself, once its kept figure is another."""
    text, kept = text_of(POSITION), json.loads(_FIGURES.read_text())
    rows = landing_rows(text)
    for span, (ekf, triangulation, _) in rows.items():
        for method, cells in (("ekf", ekf), ("triangulation", triangulation)):
            for axis, cell in zip("xyz", cells.split("/"), strict=True):
                name = f"truth.y{_BINS[span]}.common.{method}.rmse_{axis}_m"
                reported = stale(text, {**kept, name: float(cell) + 0.002})
                assert any(line.startswith(f"y {span} m, {method} {axis}: {cell}") for line in reported)
    reported = stale(text, {**kept, "truth.all.ekf.anees": 9.0, "dgps_clock.offset_s": 0.3})
    assert {line.split(":")[0] for line in reported} >= {"ANEES", "DGPS clock"}
