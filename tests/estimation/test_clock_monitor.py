"""When clocks may be estimated: the mean squared innovation of a PTU's readings decides."""

import numpy as np
import pytest

from groundstation.estimation.clock_monitor import ClockMonitor

PLACES = {"left": (14, 15), "right": (16,), "third": ()}


def after(squares: np.ndarray, station: str = "left") -> ClockMonitor:
    watch = ClockMonitor.of(PLACES)
    for square in squares:
        watch = watch.read(station, float(square))
    return watch


def test_nothing_is_estimated_before_the_first_readings() -> None:
    assert ClockMonitor.of(PLACES).quiet() == [14, 15, 16]
    assert after(np.ones(24)).quiet() == [14, 15, 16]
    assert after(np.ones(25)).quiet() == [16]


@pytest.mark.parametrize(("square", "quiet"), [(0.6, [14, 15, 16]), (1.0, [16]), (1.6, [14, 15, 16])])
def test_a_head_smoother_or_quicker_than_its_model_stops_estimation(
    rng: np.random.Generator, square: float, quiet: list[int]
) -> None:
    assert after(square * rng.chisquare(2, 300) / 2.0).quiet() == quiet


def test_a_head_may_return_to_its_model(rng: np.random.Generator) -> None:
    watch = after(0.4 * rng.chisquare(2, 200) / 2.0)
    assert watch.quiet() == [14, 15, 16]
    for square in rng.chisquare(2, 400) / 2.0:
        watch = watch.read("left", float(square))
    assert watch.quiet() == [16]


def test_a_watch_that_was_kept_is_as_it_was() -> None:
    before = after(np.ones(30))
    before.read("left", 50.0)
    assert before.squares["left"] == (30, 1.0)
