"""Plots of the report that can be zoomed: their data, and what a real browser does with wheel, drag, touch and keys."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from groundstation.evaluation import zoom_plot
from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.evaluate import Evaluation, evaluate_run
from groundstation.evaluation.run_description import RunDescription
from groundstation.evaluation.zoom_plot import ZOOM_CSS, zoom_plots, zoom_script, zoomable
from groundstation.files.html_page import html_page
from groundstation.messages import DgpsFix
from groundstation.rig.rig import Rig
from tests.browser import Browser, browser
from tests.evaluation.synthetic import PSD, Path3D, Phase

WIDTH_PX = 900
PICTURE = "<svg role='img' aria-label='A picture.' viewBox='0 0 100 100'><text>drawn before</text></svg>"


@pytest.fixture(scope="module")
def evaluation(
    landing_run: ResultCollector, landing_truth: Path3D, landing_fixes: list[DgpsFix], rig: Rig
) -> Evaluation:
    """A run with a background whose name would end the script early, and a gap in the DGPS log."""
    run = RunDescription(
        name="a flight",
        phases=(Phase(from_s=0.5, to_s=26.2, background="</script><b>sky"),),
        acceleration_psd_m2_s3=PSD,
    )
    fixes = [fix for fix in landing_fixes if not 20.0 < fix.t_s < 23.0]
    return evaluate_run(landing_run, run, rig=rig, config=EvaluationConfig(), dgps=fixes, truth=landing_truth)


@pytest.fixture(scope="module")
def plots(evaluation: Evaluation) -> dict[str, dict[str, Any]]:
    return {name: json.loads(text) for name, text in zoom_plots(evaluation).items()}


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture(scope="module")
def address(evaluation: Evaluation, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A page with the errors against the truth above the track from the side."""
    data = zoom_plots(evaluation)
    wrapped = [f"<figure>{zoomable(PICTURE, data[name])}</figure>" for name in ("errors_truth", "projection_yz")]
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(html_page("Plots", "".join([*wrapped, zoom_script()]), ZOOM_CSS), encoding="utf-8")
    return path.as_uri()


@pytest.fixture
def plot(chromium: Browser, address: str) -> "PlotOnPage":
    chromium.show(address, WIDTH_PX)
    found = PlotOnPage(chromium)
    assert chromium.complaints() == []
    return found


class PlotOnPage:
    """The first plot of a page that is open."""

    def __init__(self, page: Browser) -> None:
        self.page = page
        self.settle()
        self.left, self.top, self.wide, self.high = page.value(
            "(() => { const r = document.querySelector('.zoom > svg').getBoundingClientRect();"
            " return [r.left, r.top, r.width, r.height]; })()"
        )

    def settle(self) -> None:
        """Wait until the page has drawn what it was asked for."""
        self.page.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def ticks(self) -> list[float]:
        """Return the numbers below the plot."""
        return self._numbers("document.querySelector('.zoom').querySelectorAll('.tick')")

    def heights(self) -> list[float]:
        """Return the numbers at the left of the plot."""
        own = "[...document.querySelector('.zoom').querySelectorAll('text[text-anchor=end]')]"
        return self._numbers(own)

    def _numbers(self, texts: str) -> list[float]:
        self.settle()
        found = self.page.value(f"[...{texts}].map(t => t.textContent)")
        return [float(text.replace("−", "-")) for text in found]

    def at(self, across: float, down: float = 0.3) -> dict[str, float]:
        """Return a place within the plot, as shares of its size."""
        return {"x": self.left + across * self.wide, "y": self.top + down * self.high}

    def click(self, times: int = 1) -> None:
        for k in range(times):
            for kind in ("mousePressed", "mouseReleased"):
                self.mouse(kind, self.at(0.5), button="left", clickCount=k + 1)

    def mouse(self, kind: str, place: dict[str, float], **more: Any) -> None:
        self.page.ask("Input.dispatchMouseEvent", type=kind, **place, **more)

    def wheel(self, place: dict[str, float], by: float) -> None:
        self.mouse("mouseWheel", place, deltaX=0, deltaY=by)

    def key(self, key: str) -> None:
        self.page.ask("Input.dispatchKeyEvent", type="keyDown", key=key)
        self.page.ask("Input.dispatchKeyEvent", type="keyUp", key=key)


def test_the_wheel_zooms_about_the_pointer_once_the_plot_is_clicked_on(plot: PlotOnPage) -> None:
    """Expected: before the click the page scrolls and the axis stays; after it the axis narrows about the pointer."""
    whole = plot.ticks()
    assert whole[0] < 6.0
    assert whole[-1] > 28.0
    plot.wheel(plot.at(0.9), -100.0)
    assert plot.ticks() == whole
    plot.page.value("scrollTo({top: 0, behavior: 'instant'})")
    plot.click()
    for _ in range(6):
        plot.wheel(plot.at(0.9), -100.0)
    near = plot.ticks()
    assert near[0] > 18.0
    assert near[-1] - near[0] < 0.4 * (whole[-1] - whole[0])
    assert plot.heights() != []
    plot.click(times=2)
    assert plot.ticks() == whole
    assert plot.page.complaints() == []


def test_dragging_moves_the_window_and_stops_at_the_end(plot: PlotOnPage) -> None:
    plot.click()
    for _ in range(6):
        plot.key("+")
    middle = plot.ticks()
    plot.mouse("mousePressed", plot.at(0.4), button="left", clickCount=1)
    plot.mouse("mouseMoved", plot.at(0.6), button="left", buttons=1)
    plot.mouse("mouseReleased", plot.at(0.6), button="left", clickCount=1)
    earlier = plot.ticks()
    assert earlier[0] < middle[0]
    assert earlier[-1] < middle[-1]
    for _ in range(60):
        plot.key("ArrowLeft")
    first = plot.ticks()
    plot.key("ArrowLeft")
    assert plot.ticks() == first
    assert 0.0 <= first[0] < earlier[0]


def test_keys_zoom_stretch_and_reset(plot: PlotOnPage) -> None:
    whole, heights = plot.ticks(), plot.heights()
    plot.page.value("document.querySelector('.zoom > svg').focus()")
    for _ in range(100):
        plot.key("+")
    narrow = plot.ticks()
    # never less than some pairs, which are a tenth of a second apart
    assert 0.1 < narrow[-1] - narrow[0] < 1.0
    plot.key("ArrowUp")
    plot.key("0")
    assert plot.ticks() == whole
    for _ in range(8):
        plot.key("ArrowUp")
    assert max(plot.heights()) < 0.6 * max(heights)
    plot.key("0")
    assert plot.heights() == heights


def test_two_fingers_zoom_on_a_phone(chromium: Browser, address: str) -> None:
    chromium.show(address, 390)
    plot = PlotOnPage(chromium)
    whole = plot.ticks()

    def touch(kind: str, *across: float) -> None:
        points = [{**plot.at(share), "id": k} for k, share in enumerate(across)]
        chromium.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    touch("touchStart", 0.5, 0.6)
    touch("touchMove", 0.3, 0.8)
    touch("touchEnd")
    near = plot.ticks()
    assert near[-1] - near[0] < 0.5 * (whole[-1] - whole[0])
    assert chromium.complaints() == []


def test_a_series_can_be_hidden_and_the_pointer_reads_values(plot: PlotOnPage) -> None:
    dots = "document.querySelector('.zoom').querySelectorAll('.dots').length"
    key = "[...document.querySelectorAll('.zoom button')].find(b => b.textContent === 'triangulation')"
    assert plot.page.value(dots) == 3
    plot.page.value(f"{key}.click()")
    plot.settle()
    assert plot.page.value(dots) == 0
    assert plot.page.value(f"{key}.getAttribute('aria-pressed')") == "false"
    plot.mouse("mouseMoved", plot.at(0.5))
    plot.settle()
    shown = plot.page.value("document.querySelector('.zoom-readout').textContent")
    assert shown.startswith("t ")
    assert shown.endswith("tracking")
    assert "EKF" in shown
    assert "triangulation" not in shown


def test_in_print_and_without_scripts_the_picture_is_shown(plot: PlotOnPage) -> None:
    shown = (
        "[...document.querySelectorAll('.zoomable > svg, .zoom')].filter(p => p.checkVisibility()).map(p => p.tagName)"
    )
    assert plot.page.value(shown) == ["DIV", "DIV"]
    with plot.page.on_paper(688):
        assert plot.page.value(shown) == ["svg", "svg"]
    plot.page.ask("Emulation.setScriptExecutionDisabled", value=True)
    try:
        plot.page.show(plot.page.requests()[0], WIDTH_PX)
        assert plot.page.value(shown) == ["svg", "svg"]
    finally:
        plot.page.ask("Emulation.setScriptExecutionDisabled", value=False)


def test_the_data_are_those_of_the_comparison(evaluation: Evaluation, plots: dict[str, dict[str, Any]]) -> None:
    """Expected: what is drawn are the errors, ±2 σ and the status of each pair; null where there is no estimate."""
    assert set(plots) == {"projection_xy", "projection_yz", "errors_truth", "errors_dgps"}
    plot, c = plots["errors_truth"], evaluation.comparisons["truth"]
    assert len(plot["panels"]) == 3
    for axis, panel in enumerate(plot["panels"]):
        series = {s["name"]: np.array(s["y"], dtype=float) for s in panel["series"]}
        np.testing.assert_allclose(series["EKF"][c.ekf_known], c.ekf_error_m[c.ekf_known, axis], atol=1e-4)
        assert np.isnan(series["EKF"][~c.ekf_known]).all()
        two_sigma = 2.0 * np.sqrt(c.covariance_m2[c.ekf_known, axis, axis])
        np.testing.assert_allclose(series["±2 σ"][c.ekf_known], two_sigma, atol=1e-4)
    words = [plot["status"]["words"][code]["name"] for code in plot["status"]["codes"]]
    assert words.count("tracking") == evaluation.summary["counts"]["track"]["tracking"]
    assert len({(w["colour"], w["height"]) for w in plot["status"]["words"]}) == 5


def test_what_is_left_out_of_the_log_is_marked(evaluation: Evaluation, plots: dict[str, dict[str, Any]]) -> None:
    assert evaluation.reference is not None
    marked = [s for s in plots["errors_dgps"]["spans"] if s["name"] == "left out"]
    assert len(marked) == len(evaluation.reference.excluded) >= 1
    assert not any(s["name"] == "left out" for s in plots["errors_truth"]["spans"])


def test_text_of_a_session_stays_text(evaluation: Evaluation, plots: dict[str, dict[str, Any]]) -> None:
    assert not any("<" in text for text in zoom_plots(evaluation).values())
    assert plots["errors_truth"]["spans"][0]["name"] == "</script><b>sky"


def test_a_long_flight_is_thinned(evaluation: Evaluation, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zoom_plot, "MAX_POINTS", 100)
    for text in zoom_plots(evaluation).values():
        plot = json.loads(text)
        assert 50 < len(plot["x"]["values"]) <= 100
        assert len(plot["status"]["codes"]) == len(plot["x"]["values"])
        assert plot["note"].startswith(" One pair in ")


def test_a_run_without_a_track_has_no_plots(rig: Rig) -> None:
    nothing = evaluate_run(ResultCollector(), RunDescription(name="none"), rig=rig, config=EvaluationConfig())
    assert zoom_plots(nothing) == {}
    assert zoomable(PICTURE, None) == PICTURE
