"""Reference positions: when they replace the track, the covariance of a new start, considered parameters."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.estimation.config import CalibrationUse, EstimationConfig
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.estimation.updates.measurements import ReferencePosition
from groundstation.rig.rig import Rig
from groundstation.simulation import StationErrors, perturbed
from tests.stereo_rig import aim, make_rig

POINT, VELOCITY = np.array([0.5, 250.0, 12.0]), np.array([0.2, -20.0, -1.0])
PANS = ("left.runway_from_base.z", "right.runway_from_base.z")
SIGMA = np.radians(0.05)


def started(rig: Rig, config: EstimationConfig, names: tuple[str, ...] = PANS, sigma: float = SIGMA) -> StationEkf:
    prior = ParameterPrior.independent(names, [0.5 if "clock" in name else sigma for name in names])
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, config, prior)
    ekf.predict_to(0.0)
    for s in rig.stations:
        ekf.set_angles(s.name, aim(s.geometry(), POINT), (0.0, 0.0), 1e-6)
    return ekf


def test_going_back_forgets_refusals_too() -> None:
    ekf = started(make_rig(), EstimationConfig())
    ekf.start_target(POINT, VELOCITY, np.diag([1e-4] * 3 + [0.01] * 3))
    ekf.update_reference(ReferencePosition(POINT, 1e-4 * np.eye(3)))
    for _ in range(2):
        before = ekf.snapshot()
        for _ in range(4):
            assert not ekf.update_reference(ReferencePosition(POINT + [0.0, 50.0, 0.0], 1e-4 * np.eye(3))).accepted
        ekf.restore(before)
    assert not ekf.update_reference(ReferencePosition(POINT + [0.0, 50.0, 0.0], 1e-4 * np.eye(3))).accepted


def test_an_estimated_rig_is_not_replaced() -> None:
    """However often a receiver repeats what the pictures contradict, once the mounts are known it is refused."""
    ekf = started(make_rig(), EstimationConfig())
    ekf.start_target(POINT, VELOCITY, np.diag([1e-4] * 3 + [0.01] * 3))
    for _ in range(30):
        ekf.update_reference(ReferencePosition(POINT, 1e-4 * np.eye(3)))
        for name in ("left", "right"):
            prediction = ekf.predict_pixel(name)
            assert prediction is not None
            ekf.update_pixel(name, prediction.pixel, 0.01 * np.eye(2))
    for _ in range(12):
        assert not ekf.update_reference(ReferencePosition(POINT + [0.0, 20.0, 0.0], 1e-4 * np.eye(3))).accepted
    assert ekf.state[1] == pytest.approx(POINT[1], abs=0.2)


def test_a_new_start_is_placed_by_the_estimated_rig() -> None:
    """Pans wrong by 0.06° and −0.05° and estimated: triangulated by the rig file a point is 13 m off, the start not."""
    true = make_rig()
    off = {"left": np.radians(0.06), "right": np.radians(-0.05)}
    stated = perturbed(true, {n: StationErrors(mount_rad=np.array([0.0, 0.0, -o])) for n, o in off.items()})
    ekf = started(stated, replace(EstimationConfig(), calibration=CalibrationUse.ESTIMATE), sigma=1e-6)
    for name, value in off.items():
        place = ekf.layout.parameters[f"{name}.runway_from_base.z"]
        ekf._filter.imm.set_states(slice(place, place + 1), np.array([value]), np.eye(1) * 1e-12)
    pixels = {}
    for s in true.stations:
        projection = s.geometry().project(POINT, *ekf.angles(s.name))
        assert projection is not None
        pixels[s.name] = projection.pixel
    views = [
        TriangulationView(
            station=s.geometry(),
            pixel=pixels[s.name],
            covariance_px2=np.eye(2),
            pan_rad=ekf.angles(s.name)[0],
            tilt_rad=ekf.angles(s.name)[1],
            angle_sigma_rad=1e-3,
        )
        for s in stated.stations
    ]
    found = triangulate(views)
    assert found is not None
    assert abs(found.point_runway_m[1] - POINT[1]) > 5.0
    ekf.start_target(found.point_runway_m, VELOCITY, np.eye(6), triangulated=True)
    assert np.all(np.abs(ekf.state[:3] - POINT) < [0.1, 1.5, 0.1])


def test_an_adopted_place_errs_with_the_speed_that_carried_it(rng: np.random.Generator) -> None:
    """A clock that is known to be 0.33 s early, a speed that is not: NEES of position and velocity together, inside
    two-sided bounds where the speed is off as much as the rig may have made it: two fifths of it and 2 m/s besides."""
    squares = []
    n = 200
    psd = np.diag(EstimationConfig().acceleration_psd_m2_s3)
    speed = np.diag([2.0, 4.0, 2.0]) ** 2
    doubt = speed + np.eye(3) * (0.4 * np.linalg.norm(VELOCITY) + 2.0) ** 2
    for _ in range(n):
        ekf = started(make_rig(), EstimationConfig(), (*PANS, "dgps_clock.offset"))
        clock = ekf.layout.parameters["dgps_clock.offset"]
        ekf._filter.imm.set_states(slice(clock, clock + 1), np.array([0.33]), np.eye(1) * 1e-6)
        true = VELOCITY + rng.multivariate_normal(np.zeros(3), doubt)
        ekf.start_target(POINT, VELOCITY, np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), speed]]))
        # in a third of a second it flies as it likes besides
        away = rng.multivariate_normal(np.zeros(3), psd * 0.33**3 / 3.0)
        stamped = POINT + 0.33 * true + away + rng.normal(0, 0.02, 3)
        assert ekf.update_reference(ReferencePosition(stamped, 4e-4 * np.eye(3))).dof == 0
        e = ekf.state[:6] - np.concatenate([POINT, true])
        squares.append(float(e @ np.linalg.solve(ekf.covariance[:6, :6], e)))
    low, high = chi2.ppf([0.001, 0.999], 6 * n) / n
    assert low < np.mean(squares) < high


def test_a_miss_does_not_move_considered_parameters() -> None:
    ekf = started(make_rig(), EstimationConfig())
    ekf.start_target(POINT + [0.0, 0.0, 18.0], VELOCITY, np.diag([1.0, 16.0, 25.0, 1.0, 1.0, 1.0]), triangulated=True)
    places = list(ekf.layout.parameters.values())
    before = (ekf.state[places].copy(), np.diag(ekf.covariance)[places].copy(), ekf.state[:3].copy())
    ekf.update_miss("left", 0.9)
    assert not np.array_equal(ekf.state[:3], before[2]), "the scene is one in which a miss says something"
    np.testing.assert_array_equal(ekf.state[places], before[0])
    np.testing.assert_array_equal(np.diag(ekf.covariance)[places], before[1])
