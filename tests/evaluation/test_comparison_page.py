"""The page of a comparison: every run on the same axes, the numbers of its lines, and the page in a real browser."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from groundstation.evaluation.comparison_figures import comparison_pictures, overlap_in_time
from groundstation.evaluation.comparison_page import comparison_verdict, write_comparison_page
from groundstation.evaluation.comparison_tables import RunsTable, markdown
from groundstation.evaluation.comparison_text import ScoredRun
from groundstation.evaluation.figure_style import lay_out
from groundstation.evaluation.run_series import ReferencePositions, RunSeries, TrackSeries
from tests.browser import browser
from tests.evaluation.test_report_page import LAID_OUT, Document

WORDS = {"truth": "the truth", "dgps": "DGPS"}
SIGMA_M = np.array([0.1, 0.5, 0.2])
COUNT = 80


def run_of(name: str, rng: np.random.Generator, *, start_s: float = 0.0, bias_m: float = 0.0) -> RunSeries:
    """An approach of 8 s with the errors that its covariance states, and a bias; without an estimate at first."""
    t_s = start_s + 0.1 * np.arange(COUNT)
    truth = np.column_stack([np.sin(t_s), 250.0 - 15.0 * (t_s - start_s), 15.0 - 0.8 * (t_s - start_s)])
    position = truth + bias_m + SIGMA_M * rng.normal(size=truth.shape)
    position[:5] = np.nan
    covariance = np.tile(np.diag(SIGMA_M**2), (COUNT, 1, 1))
    covariance[:5] = np.nan
    status = np.where(np.arange(COUNT) < 5, "acquiring", "tracking")
    track = TrackSeries(t_s=t_s, status=status, position_m=position, covariance_m2=covariance)
    reference = ReferencePositions(position_m=truth, sigma_m=np.zeros(3))
    return RunSeries(name=name, track=track, references={"truth": reference})


@pytest.fixture(scope="module")
def runs() -> list[RunSeries]:
    rng = np.random.default_rng(11)
    return [run_of("usual", rng), run_of("_biased", rng, bias_m=0.3)]


def drawn(runs: list[RunSeries], name: str) -> Figure:
    """Draw one picture into a figure of its own."""
    picture = next(p for p in comparison_pictures(runs, WORDS) if p.name == name)
    figure = Figure(layout="constrained")
    picture.draw(figure)
    return figure


def test_errors_over_time_are_on_one_axis_with_the_stated_band(runs: list[RunSeries]) -> None:
    panels = drawn(runs, "errors_truth").axes
    assert [ax.get_ylabel() for ax in panels] == ["x in m", "y in m", "z in m", "3-D in m"]
    for axis, ax in enumerate(panels[:3]):
        for line, run in zip(ax.lines, runs, strict=True):
            t_s, errors = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
            truth = run.references["truth"].position_m
            np.testing.assert_allclose(errors, (run.track.position_m - truth)[:, axis])
            np.testing.assert_array_equal(t_s, run.track.t_s)
        for band in ax.collections:
            assert np.nanmax(band.get_paths()[0].vertices[:, 1]) == pytest.approx(2.0 * SIGMA_M[axis])
    sizes = [np.asarray(line.get_ydata()) for line in panels[3].lines]
    assert np.nanmax(sizes[0]) == pytest.approx(np.linalg.norm(SIGMA_M))
    assert [text.get_text().strip() for text in panels[0].figure.legends[0].texts] == ["usual", "_biased"]


def test_no_label_stands_in_another_panel(runs: list[RunSeries]) -> None:
    """Expected: laid out as on the page, of no picture the label of an axis overlaps the area of another panel."""
    pictures = list(comparison_pictures(runs, WORDS))
    assert len(pictures) >= 7
    for picture in pictures:
        figure = Figure(figsize=(8.0, picture.height_in), layout="constrained" if picture.fitted else None)
        picture.draw(figure)
        if not picture.fitted:
            lay_out(figure)
        figure.draw_without_rendering()
        areas = [ax.get_window_extent() for ax in figure.axes]
        for one, ax in enumerate(figure.axes):
            for label in (ax.xaxis.label, ax.yaxis.label):
                if label.get_text():
                    place = label.get_window_extent()
                    others = [k for k, area in enumerate(areas) if k != one and place.overlaps(area)]
                    assert others == [], (picture.name, label.get_text())


def test_the_distribution_is_the_share_of_pairs(runs: list[RunSeries]) -> None:
    for axis, ax in enumerate(drawn(runs, "distribution_truth").axes):
        for line, run in zip(ax.lines, runs, strict=False):
            size, share = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
            errors = run.errors("truth")
            assert errors is not None
            known = errors.error_m[errors.known]
            expected = np.linalg.norm(known, axis=1) if axis == 3 else np.abs(known[:, axis])
            half = float(np.interp(50.0, share, size))
            assert half == pytest.approx(np.median(expected), rel=0.05)
            assert share[-1] == 100.0


def test_errors_over_range_are_root_mean_squares(runs: list[RunSeries]) -> None:
    """Expected: over all steps, weighted by their pairs, the mean square is that of all errors; the stated one is σ."""
    ax = drawn(runs, "range_truth").axes[1]
    stated, errors = (np.asarray(line.get_ydata()) for line in ax.lines[2:4])
    series = runs[1].errors("truth")
    assert series is not None
    y = series.range_m[series.known]
    counts, _ = np.histogram(y, len(errors))
    total = np.nansum(counts * errors**2) / counts.sum()
    assert total == pytest.approx((series.error_m[series.known, 1] ** 2).mean(), rel=0.05)
    assert stated == pytest.approx(np.full(len(stated), SIGMA_M[1]))


def test_a_short_run_leaves_the_others_their_steps_of_range(runs: list[RunSeries]) -> None:
    """Expected: a run cut to its last ten pairs takes no step from the other, and has its errors and its stated one."""
    track, truth = runs[1].track, runs[1].references["truth"]
    last = slice(-10, None)
    short = RunSeries(
        name="short",
        track=TrackSeries(
            t_s=track.t_s[last],
            status=track.status[last],
            position_m=track.position_m[last],
            covariance_m2=track.covariance_m2[last],
        ),
        references={"truth": ReferencePositions(position_m=truth.position_m[last], sigma_m=truth.sigma_m)},
    )
    lines = drawn([runs[0], short], "range_truth").axes[1].lines
    known = [np.isfinite(np.asarray(line.get_ydata())) for line in lines]
    (alone,) = (np.isfinite(np.asarray(line.get_ydata())) for line in drawn(runs[:1], "range_truth").axes[1].lines[1:])
    assert np.count_nonzero(known[1]) >= np.count_nonzero(alone) - 1 > 8
    for line, shown in zip(lines[2:], known[2:], strict=True):
        assert shown.any()
        # one step is a point, which a line alone does not show
        assert line.get_marker() not in ("", "None")
    assert np.asarray(lines[2].get_ydata())[known[2]] == pytest.approx(SIGMA_M[1])


def test_nees_of_honest_errors_is_about_one_and_a_bias_is_above(runs: list[RunSeries]) -> None:
    ax = drawn(runs, "nees_truth").axes[0]
    honest, biased = (np.nanmean(np.asarray(line.get_ydata())) for line in ax.lines[:2])
    assert 0.8 < honest < 1.2
    # 0.3 m in each axis adds 9 + 0.36 + 2.25 to the three
    assert biased == pytest.approx(honest + 11.61 / 3.0, abs=0.6)
    vertices = ax.collections[0].get_paths()[0].vertices
    assert vertices[:, 1].min() < 1.0 < vertices[:, 1].max()


def few_pairs(run: RunSeries, count: int) -> RunSeries:
    """Only so many pairs with an estimate, from the middle of a run."""
    known = slice(COUNT // 2, COUNT // 2 + count)
    position = np.full_like(run.track.position_m, np.nan)
    position[known] = run.track.position_m[known]
    return replace(run, name=f"of {count}", track=replace(run.track, position_m=position))


@pytest.mark.parametrize("count", [1, 2, 4])
def test_labels_of_a_run_of_few_pairs_have_room(runs: list[RunSeries], count: int) -> None:
    """Expected: no two labels of an axis touch, each logarithmic one has two and more, and one pair is seen."""
    few = [few_pairs(runs[0], count)]
    for name in ("errors_truth", "distribution_truth", "range_truth", "nees_truth"):
        picture = next(p for p in comparison_pictures(few, WORDS) if p.name == name)
        figure = Figure(figsize=(8.0, picture.height_in), layout="constrained" if picture.fitted else None)
        picture.draw(figure)
        if not picture.fitted:
            lay_out(figure)
        figure.draw_without_rendering()
        for ax in figure.axes:
            for axis in (ax.xaxis, ax.yaxis):
                low, high = sorted(axis.get_view_interval())
                ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
                assert axis.get_scale() != "log" or len(ticks) >= 2, (name, count)
                shown = [t.label1.get_window_extent() for t in ticks if t.label1.get_visible()]
                assert not any(one.overlaps(other) for one, other in pairwise(shown)), (name, count, shown)
        if name in ("errors_truth", "distribution_truth"):
            assert figure.axes[0].lines[0].get_marker() == ("o" if count == 1 else "")


def test_the_legend_of_the_tracks_is_of_runs_that_have_one(runs: list[RunSeries]) -> None:
    figure = drawn([runs[0], few_pairs(runs[1], 0)], "tracks_above")
    assert [text.get_text() for text in figure.legends[0].texts] == ["reference", "usual"]


def test_runs_without_common_time_start_together() -> None:
    rng = np.random.default_rng(12)
    apart = [run_of("early", rng), run_of("late", rng, start_s=500.0)]
    assert not overlap_in_time(apart)
    panels = drawn(apart, "errors_truth").axes
    assert panels[-1].get_xlabel() == "time since each run's first estimate in s"
    for line in panels[0].lines:
        known = np.isfinite(np.asarray(line.get_ydata()))
        assert np.asarray(line.get_xdata())[known][0] == pytest.approx(0.0)


def test_many_runs_differ_in_colour_or_line_style(runs: list[RunSeries]) -> None:
    rng = np.random.default_rng(13)
    many = [run_of(f"run{k}", rng) for k in range(12)]
    figure = drawn(many, "errors_truth")
    lines = [line for line in figure.axes[0].lines if not str(line.get_label()).startswith("_")]
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == len(many)
    # bands of so many would hide each other
    assert not figure.axes[0].collections
    heights = {
        count: next(p.height_in for p in comparison_pictures(some, WORDS) if p.name == "errors_truth")
        for count, some in ((2, runs), (12, many))
    }
    assert heights[12] > heights[2] + 0.9


def test_runs_without_a_track_or_a_reference_have_no_such_pictures(runs: list[RunSeries]) -> None:
    track = runs[0].track
    empty = TrackSeries(
        t_s=track.t_s,
        status=track.status,
        position_m=np.full_like(track.position_m, np.nan),
        covariance_m2=np.full_like(track.covariance_m2, np.nan),
    )
    lost = RunSeries(name="lost", track=empty, references=runs[0].references)
    alone = RunSeries(name="alone", track=track, references={})
    assert comparison_pictures([lost], WORDS) == []
    assert {p.name for p in comparison_pictures([alone], WORDS)} == {"tracks_above", "tracks_side"}
    assert len(comparison_pictures([lost, alone, runs[1]], WORDS)) == 7


@pytest.mark.parametrize(("coverage", "said"), [(0.05, True), (0.98, False)])
def test_the_verdict_says_where_the_smallest_error_is_of_fewer_pairs(coverage: float, said: bool) -> None:
    """Expected: a run that has an estimate only where it is easy is not the best without a word."""

    def scored(name: str, error_m: float, share: float) -> ScoredRun:
        figures = {f"truth.all.ekf.rmse_{axis}_m": error_m for axis in "xyz"} | {"truth.all.ekf.coverage": share}
        return ScoredRun(name=name, source=name, summary={}, figures=figures)

    both = (scored("usual", 0.2, 0.98), scored("short", 0.1, coverage))
    verdict = comparison_verdict(both, both[0], "truth", same=True)
    assert verdict.startswith("Smallest error in 3-D against the truth")
    assert ("though not of the same pairs: short, RMSE 0.173 m in 5 % of its pairs" in verdict) is said
    assert ("usual 0.346 m in 98 % of its pairs" in verdict) is said
    assert ("% of its pairs" in verdict) is said


def test_markdown_escapes_what_would_be_its_marks() -> None:
    table = RunsTable(title="A|B", columns=("run", "pairs"), rows=[["a_b|c", "<1>"], ["_x_", "\n2"]], remark="*r*")
    assert markdown([table], ["see [origin]"]) == (
        "### A\\|B\n\n| run | pairs |\n| :-- | --: |\n| a_b\\|c | \\<1\\> |\n| \\_x\\_ | 2 |\n\n\\*r\\*\n\n"
        "### Notes\n\n- see \\[origin\\]\n"
    )


@pytest.fixture(scope="module")
def written(runs: list[RunSeries], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("comparison")
    wide = tuple(f"column {k}" for k in range(13))
    tables = [RunsTable(title="Accuracy <all>", columns=wide, rows=[[str(k) for k in range(13)]] * 3, remark="x")]
    pictures = comparison_pictures(runs, WORDS)
    paths = write_comparison_page(
        folder / "comparison.html", folder / "plots", "usual & biased", "Verdict", ["a <note>"], tables, pictures
    )
    assert paths == [folder / "comparison.html", folder / "plots"]
    return folder


def test_the_page_is_well_formed_and_loads_nothing(written: Path) -> None:
    page = (written / "comparison.html").read_text(encoding="utf-8")
    document = Document(page)
    pictures = [attributes for tag, attributes in document.found if tag == "svg"]
    assert len(pictures) == 7
    assert all(attributes.get("role") == "img" and attributes.get("aria-label") for attributes in pictures)
    assert not {"script", "link", "iframe", "img"} & {tag for tag, _ in document.found}
    assert not re.search(r"@import|url\((?!#|'#|\"#)", page)
    assert "a &lt;note&gt;" in page
    assert "Accuracy &lt;all&gt;" in page


def test_pictures_lie_next_to_the_page(written: Path) -> None:
    names = {path.name for path in (written / "plots").iterdir()}
    stems = {p.stem for p in (written / "plots").iterdir()}
    assert len(stems) == 7
    assert names == {f"{stem}.{kind}" for stem in stems for kind in ("svg", "png")}
    for path in (written / "plots").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
    for path in (written / "plots").glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")


def test_a_real_browser_shows_it_in_light_and_dark(written: Path, tmp_path: Path) -> None:
    """Expected: no error, no request but for the page, nothing beyond the edge, and a dark page where one is asked."""
    address = (written / "comparison.html").as_uri()
    shades = "[getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color]"
    with browser(tmp_path) as chromium:
        seen = {}
        for scheme, width_px in (("light", 1440), ("dark", 1440), ("light", 390), ("dark", 800)):
            feature = {"name": "prefers-color-scheme", "value": scheme}
            chromium.ask("Emulation.setEmulatedMedia", features=[feature])
            chromium.show(address, width_px)
            assert chromium.complaints() == []
            assert chromium.requests() == [address]
            found = chromium.value(LAID_OUT)
            assert found["page"] <= found["window"]
            assert found["drawn"] == found["shown"] == 7
            seen[scheme] = chromium.value(shades)
        light, dark = ([sum(map(int, re.findall(r"\d+", shade)[:3])) for shade in seen[s]] for s in ("light", "dark"))
        assert light[0] > 700 > 150 > light[1]
        assert dark[1] > 600 > 100 > dark[0]
        pages, content = chromium.printed()
        assert content.startswith(b"%PDF")
        assert 2 <= pages <= 6
