"""A track and a reference that cannot both be right, and the fault that is named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.arrays import FloatArray
from groundstation.evaluation.position_series import PositionSeries, ReferenceSeries
from groundstation.evaluation.reference_hypotheses import reference_contradiction, too_few_common

TIMES_S = np.arange(0.0, 12.0, 0.1)
REFERENCE_S = np.arange(-4.0, 16.0, 0.2)


def path(t_s: FloatArray) -> FloatArray:
    """Return an approach (n, 3) that drifts across the centre line."""
    x = 6.0 * np.sin(0.25 * t_s) + 3.0
    return np.stack([x, 420.0 - 22.0 * t_s, 30.0 - 1.9 * t_s + 0.02 * t_s**2], axis=1)


def track(position: FloatArray, sigma_m: float = 0.3) -> PositionSeries:
    covariance = np.tile(sigma_m**2 * np.eye(3), (len(TIMES_S), 1, 1))
    return PositionSeries(t_s=TIMES_S, position_m=position, covariance_m2=covariance)


def reference(position: FloatArray) -> ReferenceSeries:
    return ReferenceSeries(t_s=REFERENCE_S, position_m=position, sigma_m=np.full((len(REFERENCE_S), 3), 0.05))


@pytest.mark.parametrize(
    ("stored", "words"),
    [
        (lambda p: p / 0.3048, "the DGPS log taken as feet"),
        (lambda p: p[:, [1, 0, 2]], "x and y exchanged in the DGPS log"),
        (lambda p: p * np.array([-1.0, -1.0, 1.0]), "x and y reversed in the DGPS log"),
        (lambda p: p[:, [1, 0, 2]] * np.array([-1.0, 1.0, 1.0]), "x and y exchanged and one of them reversed"),
        (lambda p: 0.5 * p, "the track 2 times as far away as the DGPS log has it"),
        (lambda p: 0.3048 * p, "the track taken as feet"),
        (lambda p: p * np.array([1.0, 1.0, -1.0]), "0.0 m with z reversed in the DGPS log"),
        (
            lambda p: p + [0.0, 0.0, 47.8],
            "another origin or height of the DGPS log, which moves it by x +0, y +0, z -48",
        ),
        (lambda p: p + [465000.0, 5250000.0, 455.0], "which moves it by x -465000, y -5250000, z -455 m"),
        (
            lambda p: p @ np.array([[0.866, 0.5, 0.0], [-0.5, 0.866, 0.0], [0.0, 0.0, 1.0]]).T,
            "the DGPS log turned by 30.0° to the left: is the azimuth of +y another?",
        ),
    ],
)
def test_a_usual_fault_is_named(stored, words):
    line = reference_contradiction(track(path(TIMES_S)), reference(stored(path(REFERENCE_S))), 3.0, "the DGPS log")
    assert line is not None
    assert words in line


@pytest.mark.parametrize("off_s", [18.0, -18.0, 7.0])
def test_a_clock_that_is_off_by_more_than_is_looked_for_is_named(off_s):
    """Expected: as by leap seconds: the reference's times lead by 18 s."""
    times = np.arange(-30.0, 40.0, 0.2)
    sigma = np.full((len(times), 3), 0.05)
    late = ReferenceSeries(t_s=times, position_m=path(times - off_s), sigma_m=sigma)
    line = reference_contradiction(track(path(TIMES_S)), late, 3.0, "the DGPS log")
    assert line is not None
    assert f"the times of the DGPS log {abs(off_s):.1f} s {'earlier' if off_s > 0.0 else 'later'}" in line


def test_a_fault_of_no_known_kind_is_reported_without_a_name():
    wrong = path(REFERENCE_S) + np.array([150.0, 0.0, 0.0])
    line = reference_contradiction(track(path(TIMES_S)), reference(wrong), 3.0, "truth.csv")
    assert line is not None
    assert line.startswith("track and truth.csv are ")
    assert line.endswith(" m")


@settings(max_examples=60, deadline=None)
@given(
    offset_s=st.floats(-2.9, 2.9),
    bias_m=st.floats(0.0, 3.0),
    range_error=st.floats(-0.06, 0.06),
    seed=st.integers(0, 1000),
)
def test_what_a_filter_may_be_off_by_is_no_contradiction(offset_s, bias_m, range_error, seed):
    noise = np.random.default_rng(seed).normal(0.0, 0.3, (len(TIMES_S), 3))
    position = (1.0 + range_error) * path(TIMES_S) + noise + bias_m * np.array([0.6, 0.0, 0.8])
    fixes = reference(path(REFERENCE_S + offset_s))
    assert reference_contradiction(track(position), fixes, 3.0, "the DGPS log") is None


def test_a_track_that_states_its_large_error_is_no_contradiction():
    position = path(TIMES_S) + np.array([90.0, 0.0, 0.0])
    assert reference_contradiction(track(position, sigma_m=20.0), reference(path(REFERENCE_S)), 3.0, "it") is None
    assert reference_contradiction(track(position, sigma_m=1.0), reference(path(REFERENCE_S)), 3.0, "it") is not None


def test_too_little_of_a_reference_says_nothing():
    fixes = reference(path(REFERENCE_S) / 0.3048)
    few = fixes.keep(REFERENCE_S < 2.0)
    assert reference_contradiction(track(path(TIMES_S)), few, 3.0, "it") is None


def test_a_gap_of_the_reference_is_not_interpolated():
    """Expected: fixes that end while the track goes on, and one much later, say nothing of the time between."""
    fixes = reference(path(REFERENCE_S))
    before = fixes.keep(REFERENCE_S < 3.0)
    with_late_one = ReferenceSeries(
        t_s=np.append(before.t_s, 15.0),
        position_m=np.vstack([before.position_m, [[300.0, 0.0, 0.0]]]),
        sigma_m=np.full((len(before) + 1, 3), 0.05),
    )
    assert reference_contradiction(track(path(TIMES_S)), with_late_one, 3.0, "it") is None


def test_a_reference_that_ends_early_is_not_compared_at_another_offset():
    """Expected: what has too few epochs in common at no offset is not judged by those that it has at three seconds."""
    early = reference(path(REFERENCE_S)).keep(REFERENCE_S < 4.5)
    assert reference_contradiction(track(path(TIMES_S)), early, 3.0, "it") is None


def test_on_one_clock_a_distance_along_the_path_is_a_contradiction():
    """Expected: 45 m at 22 m/s, as of angles in gradians, are 2 s of another clock, but not of the session's own."""
    behind = path(TIMES_S) + [0.0, 45.0, 0.0]
    assert reference_contradiction(track(behind), reference(path(REFERENCE_S)), 3.0, "the DGPS log") is None
    assert reference_contradiction(track(behind), reference(path(REFERENCE_S)), 0.0, "truth.csv") is not None


def test_what_is_not_compared_is_told() -> None:
    """Expected: the numbers, and the distance as a fact; nothing where the two are compared, or without a track."""
    flown, fixes = track(path(TIMES_S)), reference(path(REFERENCE_S) + [0.0, 0.0, 40.0])
    line = too_few_common(flown, fixes.keep(REFERENCE_S < 2.0), "truth.csv")
    assert line is not None
    assert "19 of 120 epochs tracking have a position of it at their time, 60 are needed" in line
    assert line.endswith("there they are 40.0 m apart in the median")
    none = too_few_common(flown, fixes.keep(REFERENCE_S < -1.0), "truth.csv")
    assert none is not None
    assert "0 of 120 epochs" in none
    assert "apart" not in none
    assert too_few_common(flown, fixes, "truth.csv") is None
    nothing = PositionSeries(t_s=np.empty(0), position_m=np.empty((0, 3)), covariance_m2=np.empty((0, 3, 3)))
    assert too_few_common(nothing, fixes, "truth.csv") is None


def test_fixes_that_are_too_far_apart_are_said_to_be() -> None:
    """Expected: of a whole log at 1 Hz its spacing and the limit; with a longer limit it is compared."""
    flown, fixes = track(path(TIMES_S)), reference(path(REFERENCE_S))
    slow = fixes.keep(np.arange(len(REFERENCE_S)) % 5 == 0)
    line = too_few_common(flown, slow, "the DGPS log")
    assert line is not None
    assert "0 of 120 epochs tracking" in line
    assert line.endswith("its fixes are 1 s apart (median), and nothing is interpolated over more than 0.5 s")
    assert too_few_common(flown, slow, "the DGPS log", 1.5) is None
    short = too_few_common(flown, fixes.keep(REFERENCE_S < 2.0), "the DGPS log")
    assert short is not None
    assert "interpolated" not in short
