"""Figures of the report: drawn once for both kinds of file, as Matplotlib draws them; imported when needed."""

import io
import subprocess
import sys
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from groundstation.evaluation.figure_style import ReportFigure, draw_dots, lay_out, legend_above
from groundstation.evaluation.pair_renderer import draw_pair

DPI = 150


def filled() -> Figure:
    """Return a figure with a line beyond its clip, a band, a hatched span, dots and a legend."""
    figure = Figure(figsize=(4.0, 3.0))
    ax = figure.subplots()
    t = np.linspace(0.0, 10.0, 200)
    ax.fill_between(t, -0.5, 0.5, color="#0072B2", alpha=0.3, lw=0, label="band")
    ax.axvspan(2.0, 3.0, facecolor="none", edgecolor="#888888", hatch="////", lw=0)
    ax.plot(t, 3.0 * np.sin(t), "--", color="#D55E00", label="line")
    draw_dots(ax, t[::20], np.cos(t[::20]), 4.0, "#009E73", 1.0, "dots")
    ax.set_ylim(-2.0, 2.0)
    ax.set_ylabel("y in m")
    legend_above(ax, 3)
    lay_out(figure)
    return figure


def test_the_pixels_are_those_that_matplotlib_draws_alone() -> None:
    _, png = draw_pair(filled(), DPI)
    alone = io.BytesIO()
    filled().savefig(alone, format="png", dpi=DPI)
    ours, theirs = (
        cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).astype(float) for data in (png, alone.getvalue())
    )
    assert ours.shape == theirs.shape == (450, 600, 3)
    # text may be a pixel off: its width is measured at another size
    blurred = [cv2.GaussianBlur(picture, (0, 0), 3.0) for picture in (ours, theirs)]
    assert np.abs(blurred[0] - blurred[1]).mean() < 0.7
    assert np.abs(blurred[0] - 255.0).mean() > 5.0


def test_a_figure_is_traversed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    original = Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda self, renderer: (drawn.append(self), original(self, renderer)))
    picture = ReportFigure(
        name="one", title="One", caption="", alt="A line.", height_in=3.0, draw=lambda f: f.subplots().plot([1, 2])
    )
    rendered = picture.drawn()
    assert len(drawn) == 1
    assert rendered.png.startswith(b"\x89PNG")
    assert ElementTree.fromstring(rendered.svg).get("role") == "img"
    assert "stroke: #000000" in rendered.svg_file
    assert "stroke: #000000" not in rendered.svg


def test_a_dot_is_drawn_in_both_files() -> None:
    figure = Figure(figsize=(2.0, 2.0))
    ax = figure.subplots()
    ax.set_axis_off()
    draw_dots(ax, np.array([0.0, 1.0, np.nan]), np.array([0.0, 1.0, 0.5]), 6.0, "#ff0000", 1.0)
    svg, png = draw_pair(figure, DPI)
    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    red = ((pixels[..., 2] > 200) & (pixels[..., 1] < 60)).astype(np.uint8)
    assert cv2.connectedComponents(red)[0] - 1 == 2
    assert "stroke-linecap: round" in svg


def test_matplotlib_and_rerun_wait_for_what_is_drawn() -> None:
    """Expected: a replay without report and recording starts without them; each takes half a second of a core."""
    check = (
        "import groundstation.evaluation.html_report, groundstation.replay.replay, sys\n"
        "sys.exit(' '.join({'matplotlib', 'rerun'} & sys.modules.keys()) or None)"
    )
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0
