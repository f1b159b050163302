"""Deviations, needles and lights on the approach: their signs, their full scale and their sigmas."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import InputError
from groundstation.landing.glide_path import ApproachDeviations, GlidePathDeviation, approach_deviations
from groundstation.messages import Kinematics
from tests.landing.approaches import GLIDE_RAD, SITE, SPEED_M_S, estimate

_RATES = np.array([SPEED_M_S, 0.3, -1.2])


def _at(along_m: float, right_m: float, above_m: float) -> ApproachDeviations:
    assert SITE.approach is not None
    there = np.array([along_m, right_m, SITE.approach.height_m(along_m) + above_m])
    return approach_deviations(SITE, 3.0, estimate(there, _RATES))


def _path(deviations: ApproachDeviations) -> GlidePathDeviation:
    assert deviations.glide_path is not None
    return deviations.glide_path


def test_values_are_those_of_the_aircraft_against_runway_and_plan() -> None:
    found = _at(-250.0, 2.0, 1.5)
    assert found.to_threshold.value == pytest.approx(250.0)
    assert found.height.value == pytest.approx(280.0 * math.tan(GLIDE_RAD) + 1.5)
    assert found.right.value == pytest.approx(2.0)
    assert found.right_rate.value == pytest.approx(0.3)
    assert found.sink_rate.value == pytest.approx(1.2)
    assert found.ground_speed.value == pytest.approx(SPEED_M_S)
    assert _path(found).above.value == pytest.approx(1.5)


def test_an_aircraft_above_and_to_the_right_sees_its_needles_below_and_to_the_left() -> None:
    found = _at(-250.0, 2.0, 1.5)
    assert found.centre_line_needle < 0.0
    assert _path(found).needle < 0.0
    other = _at(-250.0, -2.0, -1.5)
    assert other.centre_line_needle == pytest.approx(-found.centre_line_needle)
    assert _path(other).needle > 0.0


def test_the_glide_path_needle_is_at_full_scale_at_0_24_of_the_angle() -> None:
    # expected: at 0.24 θ off the path, seen from the aim point, half of it at 0.12 θ, as of an ILS
    for share, needle in ((0.24, -1.0), (0.12, -0.5), (-0.12, 0.5), (0.5, -1.0)):
        height = 280.0 * math.tan(GLIDE_RAD * (1.0 + share))
        found = approach_deviations(SITE, 0.0, estimate(np.array([-250.0, 0.0, height]), _RATES))
        assert _path(found).needle == pytest.approx(needle, abs=0.006)
        angle = _path(found).angle
        assert angle is not None
        assert angle.value == pytest.approx(share * GLIDE_RAD)


def test_needles_keep_a_full_scale_in_metres_near_the_runway() -> None:
    found = _at(29.0, 7.5, 1.5)
    assert found.centre_line_needle == pytest.approx(-1.0)
    assert _path(found).needle == pytest.approx(-1.0)
    # nearer than 5 m to the aim point there is no angle, and no light
    assert _path(found).angle is None
    assert _path(found).papi_white is None


@pytest.mark.parametrize(("minutes", "white"), [(-40, 0), (-20, 1), (0, 2), (20, 3), (40, 4)])
def test_the_lights_are_those_of_a_papi(minutes: int, white: int) -> None:
    height = 280.0 * math.tan(GLIDE_RAD + math.radians(minutes / 60.0))
    found = approach_deviations(SITE, 0.0, estimate(np.array([-250.0, 0.0, height]), _RATES))
    assert _path(found).papi_white == white


def test_without_a_plan_there_is_no_glide_path_and_the_rest_stays() -> None:
    found = approach_deviations(replace(SITE, approach=None), 0.0, estimate(np.array([-250.0, 2.0, 15.0]), _RATES))
    assert found.glide_path is None
    assert found.right.value == pytest.approx(2.0)


_METRES = st.floats(-300.0, 20.0)


@given(_METRES, st.floats(-20.0, 20.0), st.floats(-5.0, 20.0), st.integers(0, 2**32 - 1))
def test_sigmas_are_those_of_the_linearised_values(along: float, right: float, above: float, seed: int) -> None:
    """Expected: gᵀPg, with g by central differences, for any covariance."""
    generator = np.random.default_rng(seed)
    root = generator.normal(size=(6, 6))
    plain = estimate(np.array([along, right, above]), _RATES)
    kinematics = replace(plain, covariance=root @ root.T)

    def values(found: ApproachDeviations) -> list[float]:
        path = _path(found)
        numbers = [found.to_threshold, found.height, found.right, found.right_rate, found.sink_rate, path.above]
        return [n.value for n in numbers] + ([] if path.angle is None else [path.angle.value])

    def moved(step: np.ndarray) -> list[float]:
        there = replace(
            kinematics,
            position_runway_m=plain.position_runway_m + step[:3],
            velocity_runway_m_s=plain.velocity_runway_m_s + step[3:],
        )
        return values(approach_deviations(SITE, 0.0, there))

    found = approach_deviations(SITE, 0.0, kinematics)
    count = len(values(found))
    small = 1e-4
    ups, downs = ([moved(sign * small * unit) for unit in np.eye(6)] for sign in (1.0, -1.0))
    if any(len(v) != count for v in ups + downs):
        return  # across the edge within which there is no angle
    jacobian = (np.array(ups) - np.array(downs)).T / (2.0 * small)
    expected = np.sqrt(np.einsum("ki,ij,kj->k", jacobian, kinematics.covariance, jacobian))
    path = _path(found)
    sigmas = [found.to_threshold, found.height, found.right, found.right_rate, found.sink_rate, path.above]
    stated = [n.sigma for n in sigmas] + ([] if path.angle is None else [path.angle.sigma])
    np.testing.assert_allclose(stated, expected, rtol=1e-4)


@given(_METRES, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_needles_never_leave_their_scale(along: float, right: float, above: float) -> None:
    found = _at(along, right, above)
    assert -1.0 <= found.centre_line_needle <= 1.0
    assert -1.0 <= _path(found).needle <= 1.0


def test_an_estimate_that_is_not_finite_is_refused() -> None:
    plain = estimate(np.array([-250.0, 2.0, 15.0]), _RATES)
    broken = Kinematics(
        position_runway_m=np.array([np.nan, 0.0, 0.0]),
        velocity_runway_m_s=plain.velocity_runway_m_s,
        covariance=plain.covariance,
    )
    with pytest.raises(InputError, match="not finite"):
        approach_deviations(SITE, 0.0, broken)
