"""A station that observes the runway's corners: as in its rig, and turned."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.onboard.pose.station_check import check_station
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station
from tests.stereo_rig import make_station

# a runway before the station, in its own frame, and a camera that sees all of it
CORNERS = np.array([[-8.0, 60.0, 0.0], [-8.0, 260.0, 0.5], [8.0, 260.0, 0.5], [8.0, 60.0, 0.0]])
PAN, TILT = 0.05, -0.012


def station() -> Station:
    made = make_station("left", -5.4)
    names = ("runway_from_base.x", "runway_from_base.y", "runway_from_base.z", "ptu_position.x")
    lens = replace(made.lens, focal_px=np.array([1500.0, 1500.0]))
    return replace(
        made,
        lens=lens,
        ptu_position_m=np.array([-5.4, 0.0, 4.0]),
        covariance_parameters=names,
        covariance=np.diag([1e-4, 1e-4, 1e-4, 0.02]) ** 2,
        ptu_sigma_rad=1e-4,
    )


def stated(one: Station) -> ParameterCovariance:
    return Rig(stations=(one,)).station_covariance(one.name)


def pixels(one: Station, pan: float, tilt: float) -> np.ndarray:
    found = [one.geometry().project(corner, pan, tilt) for corner in CORNERS]
    assert all(one is not None for one in found)
    return np.array([one.pixel for one in found if one is not None])


def turned(one: Station, vector: np.ndarray) -> Station:
    R = rotation_from_vector(vector) @ matrix_from_wxyz(one.runway_from_base_wxyz)
    return replace(one, runway_from_base_wxyz=wxyz_from_matrix(R))


def test_the_check_is_consistent(rng: np.random.Generator) -> None:
    """Rig, encoders and corners each wrong by their own sigmas: the statistic is χ² of six degrees of freedom."""
    reported = station()
    values = []
    for _ in range(200):
        turn = 1e-4 * rng.standard_normal(3)
        true = turned(reported, turn)
        true = replace(true, ptu_position_m=reported.ptu_position_m + [0.02 * rng.standard_normal(), 0, 0])
        pan, tilt = np.array([PAN, TILT]) + reported.angle_sigma_rad * rng.standard_normal(2)
        seen = pixels(true, PAN, TILT) + 0.2 * rng.standard_normal((4, 2))
        values.append(check_station(reported, stated(reported), pan, tilt, CORNERS, seen, np.full(4, 0.2)).statistic)
    low, high = chi2.ppf([0.0005, 0.9995], 6 * len(values)) / len(values)
    assert low < np.mean(values) < high


@pytest.mark.parametrize("axis", [0, 2])
def test_a_turned_base_is_found(axis: int, rng: np.random.Generator) -> None:
    """Half a degree about x (tilt) or z (pan) is not the rig that the file describes."""
    reported = station()
    turn = np.zeros(3)
    turn[axis] = np.radians(0.5)
    seen = pixels(turned(reported, turn), PAN, TILT) + 0.2 * rng.standard_normal((4, 2))
    check = check_station(reported, stated(reported), PAN, TILT, CORNERS, seen, np.full(4, 0.2))
    assert not check.agrees
    assert abs(check.difference[3 + axis] - turn[axis]) < 4 * np.sqrt(check.covariance[3 + axis, 3 + axis])


def test_an_unmoved_station_agrees(rng: np.random.Generator) -> None:
    reported = station()
    assert check_station(
        reported, stated(reported), PAN, TILT, CORNERS, pixels(reported, PAN, TILT), np.full(4, 0.2)
    ).agrees
