"""The report's page as a document: well-formed, alone, readable without pictures, and no table wider than a phone."""

import base64
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.evaluate import Evaluation, evaluate_run
from groundstation.evaluation.html_report import write_report
from groundstation.evaluation.run_description import RunDescription
from groundstation.experiments.detection_tables import ROI_COLUMNS
from groundstation.experiments.experiment import Experiment, Findings, Paper, PaperFigure
from groundstation.experiments.html_report import paper_page
from groundstation.experiments.tables import ResultTable
from groundstation.files.html_page import MAX_UNSTACKED, PAGE_CSS, Column, axes_cell, page_table
from groundstation.messages import CarriedError, DgpsFix
from groundstation.rig.rig import Rig
from tests.browser import Browser, browser
from tests.evaluation.synthetic import PSD, Path3D, Phase

VOID = {"meta", "br", "link", "img", "input", "hr"}


class Document(HTMLParser):
    """Collects elements with their attributes; raises on tags that do not nest."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.tables: list[dict[str, Any]] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.found.append((tag, values))
        if tag == "table":
            self.tables.append({"stack": "stack" in (values.get("class") or ""), "rows": []})
        if tag == "tr":
            self.tables[-1]["rows"].append([])
        if tag == "td":
            self.tables[-1]["rows"][-1].append(values)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def evaluation(
    landing_run: ResultCollector, landing_truth: Path3D, landing_fixes: list[DgpsFix], rig: Rig
) -> Evaluation:
    """A run with phases, both references, one of them with a gap, a smoothed track and carried errors."""
    run = RunDescription(
        name="a flight",
        phases=(Phase(from_s=0.5, to_s=26.2, background="sky"), Phase(from_s=26.3, to_s=40.0, background="ground")),
        acceleration_psd_m2_s3=PSD,
        carried_errors=(
            CarriedError(name="left.ptu_clock.offset", value=0.002, sigma=0.001, prior_sigma=0.01, estimated=True),
            CarriedError(name="right.ptu_clock.offset", value=0.0, sigma=0.01, prior_sigma=0.01, estimated=False),
        ),
        learnt_until_s=12.5,
        speed={"preparation_s": 3.5, "replay_s": 10.2, "epochs_per_s": 30.0, "times_real_time": 3.1},
        provenance={"command": "groundstation replay " + "a-folder/" * 12, "machine": {"cores": 2}},
    )
    return evaluate_run(
        landing_run,
        run,
        rig=rig,
        config=EvaluationConfig(),
        dgps=[fix for fix in landing_fixes if not 20.0 < fix.t_s < 23.0],
        truth=landing_truth,
        smoothed=landing_run,
    )


@pytest.fixture(scope="module")
def written(evaluation: Evaluation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    assert write_report(folder / "report.html", evaluation, EvaluationConfig()) == (
        folder / "report.html",
        folder / "figures",
    )
    return folder


@pytest.fixture(scope="module")
def page(written: Path) -> str:
    return (written / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


# widths of the page and of its window, and what of its pictures is there; a plot that can be zoomed hides its picture
LAID_OUT = """({
  page: document.documentElement.scrollWidth, window: document.documentElement.clientWidth, zoomed: innerWidth,
  drawn: [...document.querySelectorAll('svg:not(svg svg)')]
    .filter(p => p.getBBox().width > 0 && p.clientHeight > 100).length,
  shown: [...document.querySelectorAll('svg:not(svg svg)')].filter(p => p.checkVisibility()).length,
  undecoded: [...document.images].filter(p => !p.complete || !p.naturalWidth).length,
})"""


@pytest.mark.parametrize("width_px", [390, 800, 1060, 1100, 1340, 1440])
def test_a_real_browser_shows_it(chromium: Browser, written: Path, width_px: int) -> None:
    """Expected: no error, no request but for the page, nothing beyond the window's edge, every picture drawn."""
    address = (written / "report.html").as_uri()
    chromium.show(address, width_px)
    assert chromium.complaints() == []
    assert chromium.requests() == [address]
    found = chromium.value(LAID_OUT)
    assert found["page"] <= found["window"]
    assert found["zoomed"] == width_px
    assert found["drawn"] == found["shown"] == 8
    assert found["undecoded"] == 0


# what lies beyond the right edge, and what is folded away
BEYOND = """({
  beyond: [...document.querySelectorAll('body *')].filter(p => p.getBoundingClientRect().right > innerWidth + 1)
    .map(p => p.tagName + ' ' + p.textContent.slice(0, 40)),
  hidden: [...document.querySelectorAll('details > :not(summary)')].filter(p => !p.checkVisibility()).length,
  folded: [...document.querySelectorAll('details')].length,
})"""
# A4 between margins of 14 mm; Letter is wider
PAPER_PX = 688


def test_in_print_no_content_is_cut_off_or_folded(chromium: Browser, written: Path) -> None:
    """Expected: all within the paper's width, log and configuration open, and few pages, so none nearly empty."""
    chromium.show((written / "report.html").as_uri(), 1440)
    assert chromium.value(BEYOND)["hidden"] >= 1
    with chromium.on_paper(PAPER_PX):
        found = chromium.value(BEYOND)
    assert found["beyond"] == []
    assert found["hidden"] == 0
    assert found["folded"] >= 2
    pages, content = chromium.printed()
    assert content.startswith(b"%PDF")
    assert 4 <= pages <= 8


def test_the_papers_page_shows_its_widest_table_on_a_screen_and_on_paper(chromium: Browser, tmp_path: Path) -> None:
    row = ["400×300, 0 sigma", *[0.0456] * (len(ROI_COLUMNS) - 2), "157 ms, 212 ms"]
    filled = ResultTable(name="roi", title="ROI", columns=ROI_COLUMNS, rows=[row] * 3, timed=range(1, 7))
    findings = Findings(tables=(filled,))
    region = Experiment(name="roi", title="Region", numbers="table 1", paper=Paper.GROUND, run=lambda _: findings)
    page = tmp_path / "page.html"
    page.write_text(paper_page("Papers", [(region, findings)], tmp_path, []), encoding="utf-8")
    chromium.show(page.as_uri(), 1440)
    assert chromium.value("[...document.querySelectorAll('.wide')].map(p => p.scrollWidth - p.clientWidth)") == [0]
    with chromium.on_paper(PAPER_PX):
        assert chromium.value(BEYOND)["beyond"] == []


def test_the_papers_page_holds_its_figures(tmp_path: Path) -> None:
    (tmp_path / "range.png").write_bytes(b"a picture")
    figure = PaperFigure(name="range", title="Figure 9", caption="Error & range", draw=lambda path: None)
    findings = Findings(tables=(), figures=(figure,), differences=("a <smaller> aircraft",))
    region = Experiment(name="roi", title="Region", numbers="table 1", paper=Paper.GROUND, run=lambda _: findings)
    page = paper_page("Papers", [(region, findings)], tmp_path, [])
    assert f"data:image/png;base64,{base64.b64encode(b'a picture').decode()}" in page
    assert "<figcaption>Error &amp; range</figcaption>" in page
    assert "<li>a &lt;smaller&gt; aircraft</li>" in page


def test_a_real_browser_renders_faulty_parts(chromium: Browser, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(
        "<!doctype html><meta name=viewport content='width=device-width'><div style='width:900px'>wide</div>"
        "<img src=none.png><svg></svg><script>console.error('no'); nothing()</script>"
    )
    chromium.show(page.as_uri(), 390)
    assert sum("nothing is not defined" in complaint for complaint in chromium.complaints()) == 1
    assert len(chromium.complaints()) >= 3
    assert (tmp_path / "none.png").as_uri() in chromium.requests()
    found = chromium.value(LAID_OUT)
    assert found["page"] > 390
    assert found["drawn"] == 0
    assert found["undecoded"] == 1


def test_the_page_is_well_formed_and_small(page: str) -> None:
    document = Document(page)
    assert [tag for tag, _ in document.found].count("h1") == 1
    assert len(page.encode()) < 5_000_000


def test_it_loads_no_external_file(page: str) -> None:
    """Expected: no reference to outside the page; names of XML dialects do not count, nothing fetches them."""
    for tag, attributes in Document(page).found:
        assert tag not in ("link", "iframe", "img"), tag
        for name, value in attributes.items():
            if name in ("src", "href", "xlink:href", "action", "poster", "data"):
                assert value is not None
                assert value.startswith("#"), (tag, name, value)
    assert not re.search(r"@import|url\((?!#|'#|\"#)", page)
    for script in re.findall(r"<script[^>]*>(.*?)</script>", page, re.DOTALL):
        assert not re.search(r"\bfetch\b|XMLHttpRequest|WebSocket|EventSource|\bimport\b|sendBeacon|https?:", script)


def test_the_verdict_is_first_and_effort_last(page: str) -> None:
    places = [
        page.index(text)
        for text in (
            "class='verdict'>The aircraft was located in",
            "% tracked</b>",
            "<b>ANEES ",
            "<h2>Track, errors and consistency</h2>",
            "<h2>Against the truth</h2>",
            "<h2>Log</h2>" if "<h2>Log</h2>" in page else "<h2>What was found, and why not</h2>",
            "<h3>How long from picture to answer?</h3>",
            "<h2>Provenance, configuration and versions</h2>",
        )
    ]
    assert places == sorted(places)
    assert "latency" not in page[: page.index("<h2>Against the truth</h2>")].partition("<body>")[2].lower()


def test_nees_and_nis_are_explained_where_they_first_stand(page: str) -> None:
    body = page.partition("<body>")[2]
    for name, meaning in (("ANEES", "1 when that covariance is true"), ("NIS", "1 when that is true")):
        first = body.index(f"{name} ")
        assert meaning in body[first : first + 300]
        assert "the sample admits" in body[first : first + 300]
    assert body.count("1 when that covariance is true") == 1
    assert "against DGPS (the sample admits " in body


def test_every_picture_has_a_caption(page: str) -> None:
    pictures = [attributes for tag, attributes in Document(page).found if tag == "svg"]
    assert len(pictures) == 8
    for attributes in pictures:
        assert attributes.get("role") == "img"
        assert len(attributes.get("aria-label") or "") > 40
    assert len({a["aria-label"] for a in pictures}) == len(pictures)


def test_every_table_fits_a_phone(page: str) -> None:
    """Expected: more than three columns become cards, in which each cell but the first names its column."""
    tables = Document(page).tables
    assert sum(t["stack"] for t in tables) >= 4
    for table in tables:
        for row in table["rows"]:
            if not table["stack"]:
                assert len(row) <= MAX_UNSTACKED
            else:
                assert all(cell.get("data-label") for cell in row[1:])


def test_the_style_covers_phone_and_paper() -> None:
    assert "@media screen and (max-width:1050px)" in PAGE_CSS
    assert "@media print" in PAGE_CSS
    assert PAGE_CSS.count("{") == PAGE_CSS.count("}")


def test_figures_lie_beside_the_page(written: Path) -> None:
    names = {p.name for p in (written / "figures").iterdir()}
    stems = {"projection_xy", "projection_yz", "errors_truth", "errors_dgps", "bounds", "nees", "nis", "latency"}
    assert names == {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg")}
    for path in (written / "figures").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
    for path in (written / "figures").glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")


def test_errors_outside_the_clocks_sigma_are_listed_next_to_it(page: str) -> None:
    """Expected: in the same paragraph as the figure, that a lasting error of the detected nose is not in its ±."""
    clock = next(p for p in page.split("<p>") if p.startswith("Clock: t<sub>dgps</sub>")).partition("</p>")[0]
    assert " ms (1 σ)" in clock
    assert "where on the aircraft its nose is detected, is not in it" in clock


def test_estimated_parameters_are_reported(page: str) -> None:
    assert "+2.0000 ± 1.0000 ms" in page
    assert "not estimated" in page
    assert "taught until 12.50 s" in page
    assert "Until 12.5 s of the DGPS clock the filter used the DGPS; the comparison" in page
    assert "Smoothed over the whole flight" in page


def test_bounds_are_listed_next_to_errors(page: str, evaluation: Evaluation) -> None:
    bound = evaluation.summary["accuracy"]["truth"]["total"]["bound"]["track_sigma_m"]
    assert axes_cell(bound, ".3f") in page


def test_a_table_of_three_columns_stays_one() -> None:
    short = page_table((Column("a"), Column("b"), Column("c")), [("", ["1", "2", ""])])
    assert "stack" not in short
    assert "–" in short


def test_axes_without_numbers_are_empty() -> None:
    assert axes_cell(None, ".1f") == axes_cell((None, None, None), ".1f") == ""
    assert "–" in axes_cell((1.0, None, float(np.pi)), ".1f")
