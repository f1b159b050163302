"""Recognition: the mean log odds of a target's pixels over about a second."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.tracking.recognition import Recognition


def test_without_the_learned_channel_there_is_none() -> None:
    recognition = Recognition()
    recognition.start(0.0, None)
    assert not recognition.is_available
    assert not recognition.is_recognised


def test_the_first_pixel_counts_where_the_search_gave_no_odds() -> None:
    recognition = Recognition()
    recognition.start(0.0, None)
    recognition.add("left", 0.1, 5.0)
    assert recognition.is_available
    assert recognition.is_recognised


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 60.0])
def test_it_takes_about_a_second_at_any_rate(rate_hz: float) -> None:
    """Expected: from 5 to -6 the mean crosses 1.5 at ln(11 / 7.5) s."""
    recognition = Recognition()
    recognition.start(0.0, 5.0)
    times = np.arange(1, 200) / rate_hz
    lost = next(t for t in times if not (recognition.add("left", float(t), -6.0), recognition.is_recognised)[1])
    assert lost == pytest.approx(np.log(11.0 / 7.5), abs=1.0 / rate_hz)


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(-12.0, 12.0)), min_size=1, max_size=30))
def test_late_pixels_change_nothing_beyond_the_range_of_the_odds(pixels: list[tuple[float, float]]) -> None:
    """Expected: at any order of times it is recognised where all odds say so, and not where none does."""
    recognition = Recognition()
    for t_s, odds in pixels:
        recognition.add("left", t_s, odds)
    if min(odds for _, odds in pixels) >= 1.5 + 1e-9:
        assert recognition.is_recognised
    if max(odds for _, odds in pixels) < 1.5 - 1e-9:
        assert not recognition.is_recognised


def test_both_cameras_of_a_pair_count() -> None:
    """Expected: pixels of the same instant, in either order."""
    for first, second in ((6.0, 0.0), (0.0, 6.0)):
        recognition = Recognition()
        recognition.start(0.0, None)
        for k in range(20):
            recognition.add("left", 0.1 * k, first)
            recognition.add("right", 0.1 * k, second)
        assert recognition.odds == pytest.approx(3.0)


def test_a_camera_that_has_not_seen_it_lately_does_not_count() -> None:
    recognition = Recognition()
    recognition.start(0.0, None)
    recognition.add("right", 0.0, -6.0)
    for k in range(30):
        recognition.add("left", 0.1 * k, 4.0)
    assert recognition.odds == pytest.approx(4.0)
