"""Bounds with an uncertain calibration, against estimators that are wrong by it and against the known figures."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.evaluation.bounds import StationView, fix_covariance, posterior_bound
from groundstation.evaluation.calibration_bounds import (
    calibration_sensitivities,
    fix_consider,
    joint_information,
    track_consider,
    track_learning,
)
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, CalibrationError, perturbed_station
from groundstation.geometry.station import StationGeometry
from tests.evaluation.test_bounds import _glide_m, _views

MOUNTS = tuple(f"{s}.{p}" for s in ("left", "right") for p in ("runway_from_base.z", "head_from_camera.x"))
EVERYTHING = tuple(f"{s}.{p}" for s in ("left", "right") for p in CALIBRATION_PARAMETERS)
MOUNT_COVARIANCE = np.radians(0.05) ** 2 * np.eye(4)
PSD = np.array([0.05, 0.1, 0.05])
# pan and tilt errors of (left pan, left tilt, right pan, right tilt), in the units of `MOUNTS`
COMMON_PAN, RELATIVE_PAN = np.array([0.5, 0, 0.5, 0]), np.array([1.0, 0, -1.0, 0])
COMMON_TILT, RELATIVE_TILT = np.array([0, 0.5, 0, 0.5]), np.array([0, 1.0, 0, -1.0])


def _joint(point: np.ndarray, case: str, names: tuple[str, ...] = MOUNTS) -> np.ndarray:
    views = _views(point, case)
    return joint_information(point, views, calibration_sensitivities(point, views, names))


def _on_glide(y_m: float) -> np.ndarray:
    return np.array([0.0, y_m, _glide_m(y_m)])


def _approach(rate_hz: float, to_y_m: float = 200.0, case: str = "B") -> tuple[np.ndarray, np.ndarray]:
    """Times and joint informations of a glide at 25 m/s from 600 m, with the four mount biases."""
    t = np.arange(0.0, (600.0 - to_y_m) / 25.0 + 1e-6, 1.0 / rate_hz)
    return t, np.array([_joint(_on_glide(600.0 - 25.0 * s), case) for s in t])


def _sigma(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(covariance)[:3])


def _located(point: np.ndarray, true: list[StationGeometry], assumed: list[StationView]) -> np.ndarray:
    """Weighted least squares on the pixels of the true stations, with other assumed stations."""
    x = point.copy()
    for _ in range(6):
        information, right = np.zeros((3, 3)), np.zeros(3)
        for station, view in zip(true, assumed, strict=True):
            seen = station.project(point, view.pan_rad, view.tilt_rad)
            held = view.geometry.project(x, view.pan_rad, view.tilt_rad)
            assert seen is not None
            assert held is not None
            J, by_angle = held.jacobian[:, :3], held.jacobian[:, 3:]
            W = np.linalg.inv(view.pixel_covariance_px2 + view.angle_sigma_rad**2 * by_angle @ by_angle.T)
            information += J.T @ W @ J
            right += J.T @ W @ (seen.pixel - held.pixel)
        x = x + np.linalg.solve(information, right)
    return x


@settings(max_examples=25)
@given(y_m=st.floats(80.0, 500.0), x_m=st.floats(-10.0, 10.0), seed=st.integers(0, 2**31))
def test_sensitivity_is_how_far_a_wrong_rig_puts_the_point(y_m: float, x_m: float, seed: int) -> None:
    """Every parameter of both stations a little wrong at once: the fix moves by S·(assumed − true)."""
    generator = np.random.default_rng(seed)
    point = np.array([x_m, y_m, 12.0])
    views = _views(point, "C")
    scale = np.r_[[1e-5] * 3, [1e-3] * 3, [1e-5] * 3, [1e-4] * 3, [1e-1] * 4, [1e-3] * 5]
    error = generator.normal(0.0, 0.1, (2, 21)) * scale
    true = [perturbed_station(view.geometry, -e) for view, e in zip(views, error, strict=True)]
    moved = _located(point, true, views) - point
    bound = fix_consider(_joint(point, "C", EVERYTHING))
    assert bound is not None
    expected = bound.sensitivity @ error.ravel()
    np.testing.assert_allclose(moved, expected, atol=0.01 * np.abs(expected).max() + 1e-6)


@settings(max_examples=40)
@given(y_m=st.floats(60.0, 800.0), seed=st.integers(0, 2**31))
def test_considering_is_never_better_than_knowing_all_correlations(y_m: float, seed: int) -> None:
    """S·P·Sᵀ + Λ⁻¹ is at least the bound of an estimator that weighs with P, and that one at least Λ⁻¹."""
    generator = np.random.default_rng(seed)
    root = generator.normal(0.0, 1e-3, (4, 4))
    P = root @ root.T + 1e-12 * np.eye(4)
    joint = _joint(_on_glide(y_m), "B")
    bound = fix_consider(joint)
    assert bound is not None
    joint[3:, 3:] += np.linalg.inv(P)
    best = np.linalg.inv(joint)[:3, :3]
    for excess in (bound.covariance(P) - best, best - bound.noise):
        assert np.linalg.eigvalsh(excess).min() > -1e-6 * np.trace(bound.covariance(P))


def test_without_nuisances_it_is_the_plain_bound() -> None:
    point = _on_glide(200.0)
    joint = joint_information(point, _views(point, "B"), [np.zeros((2, 0))] * 2)
    bound = fix_consider(joint)
    assert bound is not None
    plain = fix_covariance(joint)
    assert plain is not None
    np.testing.assert_array_equal(bound.covariance(np.zeros((0, 0))), plain)


# ----------------------------------------------------------------------------------------- the known figures
@pytest.mark.parametrize(("y_m", "along_m"), [(200.0, 0.65), (400.0, 2.6)])
def test_a_hundredth_of_a_degree_of_relative_pan(y_m: float, along_m: float) -> None:
    """δy = y²·δ/b; nothing across."""
    bound = fix_consider(_joint(_on_glide(y_m), "B"))
    assert bound is not None
    moved = bound.sensitivity @ (0.5 * np.radians(0.01) * RELATIVE_PAN)
    assert abs(moved[1]) == pytest.approx(along_m, rel=0.01)
    assert abs(moved[0]) < 1e-6


def test_common_pan_moves_x_common_tilt_z_and_relative_tilt_neither() -> None:
    bound = fix_consider(_joint(_on_glide(200.0), "B"))
    assert bound is not None
    hundredth = np.radians(0.01)
    np.testing.assert_allclose(np.abs(bound.sensitivity @ (2 * hundredth * COMMON_PAN)), [0.035, 0, 0], atol=1e-4)
    np.testing.assert_allclose(np.abs(bound.sensitivity @ (2 * hundredth * COMMON_TILT)), [0, 0, 0.035], atol=1e-4)
    np.testing.assert_allclose(bound.sensitivity @ (hundredth * RELATIVE_TILT), 0.0, atol=1e-4)


def test_unknown_mounts_of_a_twentieth_of_a_degree() -> None:
    """0.12/1.0/0.13 m at 200 m when the track may learn them, 0.007/0.14/0.009 m after 8 s of 2 cm DGPS."""
    t, joint = _approach(30.0)
    learned = track_learning(t, joint, MOUNT_COVARIANCE, PSD, 10.0, 5.0)[-1]
    np.testing.assert_allclose(_sigma(learned), [0.12, 1.0, 0.13], rtol=0.04)
    referenced = joint.copy()
    referenced[t <= 8.0, :3, :3] += np.eye(3) / 0.02**2
    learned = track_learning(t, referenced, MOUNT_COVARIANCE, PSD, 10.0, 5.0)[-1]
    np.testing.assert_allclose(_sigma(learned), [0.007, 0.14, 0.009], rtol=0.04)


def test_observability_from_pictures_alone() -> None:
    """Differential tilt well, relative pan through the assumed motion to 0.015°, common pan and tilt not at all."""
    t, joint = _approach(30.0)
    known = track_learning(t, joint, MOUNT_COVARIANCE, PSD, 10.0, 5.0)[-1][6:, 6:]
    left = {
        name: np.degrees(np.sqrt(w @ known @ w))
        for name, w in (
            ("common pan", COMMON_PAN),
            ("relative pan", RELATIVE_PAN),
            ("common tilt", COMMON_TILT),
            ("relative tilt", RELATIVE_TILT),
        )
    }
    before = 0.05 / np.sqrt(2.0)
    assert left["common pan"] == pytest.approx(before, rel=0.005)
    assert left["common tilt"] == pytest.approx(before, rel=0.005)
    assert left["relative pan"] == pytest.approx(0.0155, rel=0.02)
    assert left["relative tilt"] == pytest.approx(0.0003, rel=0.1)


# ------------------------------------------------------------------------------------------------ tracks
def test_a_considered_track_equals_a_filter_with_a_wrong_rig(rng: np.random.Generator) -> None:
    """A linear filter run on noiseless measurements that are off by a mount error drifts by S·(assumed − true)."""
    t, joint = _approach(10.0, to_y_m=300.0)
    bound = track_consider(t, joint, PSD, 10.0, 5.0)
    np.testing.assert_array_equal(bound.noise, posterior_bound(t, joint[:, :3, :3], PSD, 10.0, 5.0))
    error = rng.normal(0.0, np.radians(0.05), 4)
    x = np.zeros(6)
    for k in range(len(t)):
        if k:
            x[:3] += (t[k] - t[k - 1]) * x[3:]
        # Kalman gain times innovation, in information form: P⁺ Hᵀ (z's information − Λ x)
        x = x + bound.noise[k][:, :3] @ (-joint[k, :3, 3:] @ error - joint[k, :3, :3] @ x[:3])
    np.testing.assert_allclose(bound.sensitivity[-1] @ error, x, atol=1e-9)


def test_no_averaging_goes_below_the_floor() -> None:
    """At 30 Hz the noise of y falls far below that of one fix; an unknown relative pan of 0.01° stays."""
    t, joint = _approach(30.0)
    P = 0.25 * np.radians(0.01) ** 2 * np.outer(RELATIVE_PAN, RELATIVE_PAN)
    bound = track_consider(t, joint, PSD, 10.0, 5.0)
    one = fix_consider(joint[-1])
    assert one is not None
    assert np.sqrt(bound.noise[-1][1, 1]) < 0.4 * np.sqrt(one.noise[1, 1])
    assert np.sqrt(bound.floor(P)[-1][1, 1]) == pytest.approx(0.65, rel=0.03)


def test_estimation_without_parameters_is_the_plain_bound() -> None:
    t, joint = _approach(10.0, to_y_m=400.0)
    learned = track_learning(t, joint, np.zeros((4, 4)), PSD, 10.0, 5.0)
    np.testing.assert_allclose(learned[:, :6, :6], posterior_bound(t, joint[:, :3, :3], PSD, 10.0, 5.0), atol=1e-12)


# ------------------------------------------------------------------------------------------------- edges
def test_shared_errors_of_stations_are_distinguished_from_their_own() -> None:
    """Two pans wrong by the same amount do not touch y; wrong each on its own they do."""
    bound = fix_consider(_joint(_on_glide(200.0), "B"))
    assert bound is not None
    own = np.diag(np.radians(0.05) ** 2 * np.array([1.0, 0, 1.0, 0]))
    shared = np.radians(0.05) ** 2 * np.outer([1.0, 0, 1.0, 0], [1.0, 0, 1.0, 0])
    assert np.sqrt(bound.floor(own)[1, 1]) == pytest.approx(4.59, rel=0.01)
    assert np.sqrt(bound.floor(shared)[1, 1]) < 1e-6


def test_one_view_or_none() -> None:
    point = _on_glide(200.0)
    views = _views(point, "B")[:1]
    joint = joint_information(point, views, calibration_sensitivities(point, views, MOUNTS))
    assert fix_consider(joint) is None
    assert not joint[:, 5:].any(), "the other station's parameters touch nothing here"
    behind = np.array([0.0, -50.0, 2.0])
    np.testing.assert_array_equal(
        joint_information(behind, views, calibration_sensitivities(behind, views, MOUNTS)), np.zeros((7, 7))
    )
    assert joint_information(point, [], []).shape == (3, 3)
    with pytest.raises(CalibrationError, match="no calibration parameter 'pan'"):
        calibration_sensitivities(point, views, ["left.pan"])
