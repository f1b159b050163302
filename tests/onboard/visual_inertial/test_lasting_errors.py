"""The width of a runway as a parameter: learnt from heights, and its errors as large as is stated."""

import numpy as np
import pytest
from onboard_width import flown
from scipy.stats import chi2

from groundstation.onboard.visual_inertial.corner_errors import width_mode
from groundstation.onboard.visual_inertial.lasting_errors import KnownHeight, LastingErrors

T_S = np.arange(0.0, 13.0, 0.1)
ALONG_M = 330.0 - 22.0 * T_S
UP_M = (ALONG_M + 60.0) * np.tan(np.radians(4.0))


def test_learnt_errors_are_as_large_as_is_stated_and_no_larger_than_the_bound(rng: np.random.Generator) -> None:
    """Expected: NEES inside its 99.9 % band; along the track within 1.2 of the Cramér-Rao bound with the prior."""
    width_sigma, lasting_m, noise_m = 0.05, 1.5, 0.1
    # one sigma of the width scales all heights; the second error comes and goes
    sensitivity = np.stack([width_sigma * UP_M, 0.3 * np.sin(0.5 * T_S)], axis=1)
    h = np.column_stack([sensitivity, -np.ones_like(T_S)])
    information = np.diag([1.0, 1.0, lasting_m**-2]) + h.T @ h / noise_m**2
    bound_m = width_sigma * ALONG_M[-1] * np.sqrt(np.linalg.inv(information)[0, 0])
    nees, errors = [], []
    for _ in range(120):
        theta, b = rng.standard_normal(2), lasting_m * rng.standard_normal()
        learnt = LastingErrors(2, 3.0)
        for t, up, s in zip(T_S, UP_M, sensitivity, strict=True):
            known = KnownHeight(up_m=up + b + noise_m * rng.standard_normal(), lasting_m=lasting_m, noise_m=noise_m)
            learnt.update(float(t), float(up + s @ theta - known.up_m), s, 0.0, known)
        off = theta - learnt.mean
        nees.append(off @ np.linalg.solve(learnt.covariance, off))
        errors.append(width_sigma * ALONG_M[-1] * off[0])
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 240)
    assert low < sum(nees) < high
    # the prior alone: five per cent of 46 m
    assert np.sqrt(np.mean(np.square(errors))) < 1.2 * bound_m < 0.5 * width_sigma * ALONG_M[-1]


def test_what_heights_tell_of_the_filters_own_error_is_not_counted_as_unknown(rng: np.random.Generator) -> None:
    """Expected: the corrected height's error is as large as is stated, NEES inside its 99.9 % band.

    The filter's own error is in what the heights tell of the width. Taken for noise that has nothing to do with the
    filter's height, it stayed in the corrected one, 0.3 m here, and in what was stated.
    """
    noise_m, memory_s, own_m, nees, errors = 0.02, 3.0, 0.3, [], []
    kept = np.exp(-2.0 * 0.1 / memory_s)
    for _ in range(150):
        theta, b, e = rng.standard_normal(), 0.05 * rng.standard_normal(), own_m * rng.standard_normal()
        learnt = LastingErrors(1, memory_s)
        for t, up in zip(T_S, UP_M, strict=True):
            s, known = np.array([0.05 * up]), KnownHeight(up_m=0.0, lasting_m=0.05, noise_m=noise_m)
            learnt.update(float(t), float(s[0] * theta + e - b + noise_m * rng.standard_normal()), s, own_m**2, known)
            here, e = e, kept * e + np.sqrt(1.0 - kept**2) * own_m * rng.standard_normal()
        off, covariance = learnt.corrected(float(T_S[-1]), s[None], np.array([[own_m**2]]), 0)
        left = s[0] * theta + here - off[0]
        nees.append(left**2 / covariance[0, 0])
        errors.append(left)
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 150)
    assert low < sum(nees) < high
    assert np.sqrt(np.mean(np.square(errors))) < 0.25 * own_m


def test_a_height_that_is_not_there_leaves_the_filters_covariance_and_the_errors_prior() -> None:
    own = np.array([[2.0, 0.3], [0.3, 0.5]])
    sensitivity = np.array([[1.0, 0.2], [0.4, 0.7]])
    off, covariance = LastingErrors(2, 3.0).corrected(1.0, sensitivity, own, 1)
    np.testing.assert_array_equal(off, [0.0, 0.0])
    np.testing.assert_allclose(covariance, own + sensitivity @ sensitivity.T)


def test_without_heights_nothing_is_learnt_and_heights_at_one_time_count_once() -> None:
    learnt, known = LastingErrors(1, 3.0), KnownHeight(up_m=10.0, lasting_m=1.0, noise_m=0.1)
    np.testing.assert_array_equal(learnt.mean, [0.0])
    np.testing.assert_array_equal(learnt.covariance, [[1.0]])
    learnt.update(1.0, 0.5, np.array([2.0]), 0.01, known)
    # the height's own metre of a constant error, a decimetre of noise and the filter's own
    gain = 2.0 / (4.0 + 1.0 + 0.01 + 0.01)
    assert learnt.mean[0] == pytest.approx(0.5 * gain)
    assert learnt.covariance[0, 0] == pytest.approx(1.0 - 2.0 * gain)
    before = learnt.mean.copy()
    learnt.update(1.0, 0.5, np.array([2.0]), 0.01, known)
    np.testing.assert_array_equal(learnt.mean, before)


def test_a_restarted_filters_own_error_is_forgotten_and_what_lasts_is_not() -> None:
    """Expected: right after a restart the height is off by what the width makes of it alone, as sure as is stated."""
    learnt, known = LastingErrors(1, 3.0), KnownHeight(up_m=10.0, lasting_m=0.1, noise_m=0.05)
    sensitivity, own = np.array([[0.5]]), np.array([[9.0]])
    for k in range(20):
        learnt.update(0.2 * k, 0.4, np.array([2.0]), 0.04, known)
    width = float(learnt.mean[0])
    learnt.restart()
    off, covariance = learnt.corrected(4.0, sensitivity, own, 0)
    np.testing.assert_allclose(off, [0.5 * width])
    np.testing.assert_allclose(covariance, own + 0.25 * learnt.covariance)
    assert 0.0 < learnt.covariance[0, 0] < 0.5


def test_a_wider_runway_is_wider_along_its_thresholds() -> None:
    pixels = np.array([[200.0, 300.0], [240.0, 200.0], [280.0, 201.0], [340.0, 302.0]])
    moved = pixels + width_mode(pixels, 0.1).reshape(4, 2)
    for near, far in ((0, 3), (1, 2)):
        np.testing.assert_allclose(moved[far] - moved[near], 1.1 * (pixels[far] - pixels[near]))
        np.testing.assert_allclose(moved[far] + moved[near], pixels[far] + pixels[near])


def test_a_flights_filter_learns_the_width_and_states_what_is_left() -> None:
    """Expected: NEES of the place inside its 99.9 % band with heights and without; the track's error halved by them."""
    found = {
        heights: [flown(seed, 0.08, heights=heights, seconds=7.0, camera_hz=5) for seed in range(300, 308)]
        for heights in (False, True)
    }
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 24)
    for flights in found.values():
        assert low < sum(one.nees for one in flights) < high
    rms = {heights: np.sqrt(np.mean([one.error_m[1] ** 2 for one in flights])) for heights, flights in found.items()}
    assert rms[True] < 0.5 * rms[False]
    bound_m = np.sqrt(np.mean([one.bound_m**2 for one in found[True]]))
    # eight flights: 1.2, and what a root mean square of eight varies by
    assert rms[True] < 1.2 * bound_m * np.sqrt(chi2.ppf(0.995, 8) / 8.0)
