"""Pooled figures, their intervals, and the harm of each condition."""

import numpy as np
import pytest

from groundstation.bank.factor_figures import ClassFigures, factor_figures
from groundstation.bank.frame_classes import FRAME_FACTORS
from groundstation.bank.pooled_figures import HIT, POOLED, distributions, pooled, session_values
from groundstation.sources.visibility_table import FrameVisibility
from tests.bank.drawn_rows import drawn_row, drawn_rows


def test_pooled_figures_are_sums_over_sums() -> None:
    rows = [drawn_row(0, visible=100, hit=90), drawn_row(1, visible=300, hit=30)]
    found = {ratio.title: pooled(rows, ratio).value for ratio in POOLED}
    assert pooled(rows, HIT).value == pytest.approx(120 / 400)
    assert found["visible frames with a wrong point"] == pytest.approx(2 / 400)
    assert found["epochs with an estimate, from the first track on"] == pytest.approx(0.8)
    assert found["ANEES while tracking"] == pytest.approx(1.0)
    assert found["NIS per degree of freedom"] == pytest.approx(0.5)


def test_a_session_without_visible_frames_counts_in_no_share_of_frames() -> None:
    rows = [drawn_row(0, visible=100, hit=90), drawn_row(1, visible=0, hit=0)]
    figure = pooled(rows, HIT)
    assert (figure.value, figure.sessions) == (0.9, 1)
    assert (figure.low, figure.high) == (None, None)
    assert pooled(rows[1:], HIT).value is None


def test_intervals_cover_the_true_share_as_often_as_they_state() -> None:
    """Expected: 95 % intervals of 40 sessions cover in 95 ± 5.2 % (4 sigma of 200 banks, and 1 % short)."""
    covered = 0
    for seed in range(200):
        figure = pooled(drawn_rows(seed, 40, 0.8), HIT)
        assert figure.low is not None
        assert figure.high is not None
        covered += figure.low <= 0.8 <= figure.high
    assert 0.88 <= covered / 200 <= 0.99


@pytest.mark.parametrize("hit", [0, 100])
def test_what_no_session_had_or_all_had_has_no_interval(hit: int) -> None:
    """Expected: ten sessions without an event are no proof that there is none: 0 to 0 would be said of 2 as of 2000."""
    rows = [drawn_row(seed, visible=100, hit=hit) for seed in range(10)]
    figure = pooled(rows, HIT)
    assert figure.value == hit / 100
    assert (figure.low, figure.high) == (None, None)
    (sky,) = [figures for figures in factor_figures(rows) if figures.factor == "sky"]
    assert (sky.low, sky.high) == (None, None)
    one_more = pooled([*rows, drawn_row(10, visible=100, hit=50)], HIT)
    assert one_more.low is not None


def test_a_detector_that_is_a_fifth_worse_is_outside_the_interval() -> None:
    before, after = pooled(drawn_rows(1, 40, 0.8), HIT), pooled(drawn_rows(1, 40, 0.8 * 0.8), HIT)
    assert before.low is not None
    assert after.high is not None
    assert after.high < before.low


def figures_by_class(rows: list[dict[str, object]]) -> dict[tuple[str, str], ClassFigures]:
    return {(figures.factor, figures.kind): figures for figures in factor_figures(rows)}


def test_the_condition_with_the_most_misses_comes_first() -> None:
    """Expected: without dusk the share of hits is 0.9 instead of 0.7: harm of 0.2; frames count, not sessions."""
    rows = [drawn_row(0, hit=90), drawn_row(1, hit=90), drawn_row(2, hit=30, sky="dusk")]
    found = factor_figures(rows)
    assert (found[0].factor, found[0].kind) == ("sky", "dusk")
    assert found[0].harm == pytest.approx(0.2)
    assert (found[0].sessions, found[0].frames) == (1, 100)
    assert found[0].hit == pytest.approx(0.3)
    clear = figures_by_class(rows)["sky", "clear"]
    assert clear.harm == pytest.approx(0.3 - 0.7)
    assert clear.excluded == pytest.approx(20 / 220)


def test_classes_of_frames_have_the_frames_of_all_sessions() -> None:
    found = figures_by_class([drawn_row(0), drawn_row(1, hit=50)])
    for factor in FRAME_FACTORS:
        figures = found[factor.name, factor.classes[0]]
        assert (figures.frames, figures.coverage) == (200, None)
        assert figures.hit == pytest.approx(0.7)
        assert (factor.name, factor.classes[1]) not in found


def test_every_frame_belongs_to_a_class_and_edges_to_the_upper_one() -> None:
    width = FRAME_FACTORS[0]
    for value in (0.0, *width.edges, 1e6):
        seen = FrameVisibility(width_px=value, in_view=1.0, unhidden=1.0, snr=9.0)
        above = [k for k, edge in enumerate(width.edges) if value >= edge]
        assert width.class_of(seen) == width.classes[len(above)]
    assert len(set(width.classes)) == len(width.edges) + 1


def test_distributions_leave_out_what_no_session_has() -> None:
    found = {d.column: d for d in distributions([drawn_row(k) for k in range(5)])}
    assert found["time_to_track_s"].quantiles[2] == pytest.approx(1.2)
    assert found["time_to_track_s"].count == 5
    assert "return_s_max" not in found
    assert "baseline_hit_share" not in found
    np.testing.assert_array_equal(session_values([{"a": 2.0}, {"a": None}, {"a": 1}, {}], "a"), [1.0, 2.0])
