"""The bounds against the closed forms, against the published table and against what estimators reach."""

import numpy as np
import pytest

from groundstation.evaluation.bounds import (
    StationView,
    fix_covariance,
    fix_information,
    motion_matrices,
    posterior_bound,
)
from groundstation.geometry.camera import Lens
from groundstation.geometry.station import StationGeometry

BASE_M, FOCAL_PX, HEIGHT_M, SPEED_M_S = 10.77, 6667.0, 1.5, 25.0
QUANTISATION_RAD = np.radians(0.00625) / np.sqrt(12.0)
CASES = {"B": (0.5, QUANTISATION_RAD), "C": (1.0, np.radians(0.00625))}


def _station(name: str, x_m: float, y_m: float = 0.0) -> StationGeometry:
    return StationGeometry(
        name=name,
        ptu_position_m=np.array([x_m, y_m, HEIGHT_M]),
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0]),
        camera_in_head_m=np.zeros(3),
        lens=Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([FOCAL_PX, FOCAL_PX]),
            principal_point_px=np.array([639.5, 479.5]),
            distortion=np.zeros(5),
        ),
    )


PAIR = (_station("left", -BASE_M / 2), _station("right", BASE_M / 2))


def _views(point: np.ndarray, case: str, stations: tuple[StationGeometry, ...] = PAIR) -> list[StationView]:
    """Every station points straight at the point."""
    sigma_px, sigma_rad = CASES[case]
    views = []
    for station in stations:
        d = point - station.packed[9:12]
        views.append(
            StationView(
                geometry=station,
                pan_rad=float(np.arctan2(-d[0], d[1])),
                tilt_rad=float(np.arctan2(d[2], np.hypot(d[0], d[1]))),
                pixel_covariance_px2=sigma_px**2 * np.eye(2),
                angle_sigma_rad=sigma_rad,
            )
        )
    return views


def _fix_sigma(y_m: float, case: str, z_m: float | None = None) -> np.ndarray:
    point = np.array([0.0, y_m, _glide_m(y_m) if z_m is None else z_m])
    covariance = fix_covariance(fix_information(point, _views(point, case)))
    assert covariance is not None
    return np.sqrt(np.diag(covariance))


def _glide_m(y_m: float) -> float:
    return float(np.tan(np.radians(3.5)) * (y_m - 60.0))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("y_m", [100.0, 200.0, 400.0])
def test_one_fix_meets_the_closed_form(case: str, y_m: float) -> None:
    """σx = yσ/√2, σy = √2y²σ/b, σz² = σx² + ((z−h)/y)²σy²."""
    sigma_px, sigma_rad = CASES[case]
    ray = np.hypot(sigma_px / FOCAL_PX, sigma_rad)
    across, along = y_m * ray / np.sqrt(2.0), np.sqrt(2.0) * y_m**2 * ray / BASE_M
    up = np.hypot(across, (_glide_m(y_m) - HEIGHT_M) / y_m * along)
    np.testing.assert_allclose(_fix_sigma(y_m, case), [across, along, up], rtol=0.01)


@pytest.mark.parametrize(
    ("case", "y_m", "expected"),
    [
        ("B", 100.0, (0.006, 0.107, 0.006)),
        ("B", 200.0, (0.0115, 0.43, 0.019)),
        ("B", 400.0, (0.023, 1.71, 0.086)),
        ("C", 100.0, (0.013, 0.24, 0.013)),
        ("C", 200.0, (0.026, 0.98, 0.043)),
        ("C", 400.0, (0.053, 3.9, 0.195)),
    ],
)
def test_one_fix_meets_the_table(case: str, y_m: float, expected: tuple[float, float, float]) -> None:
    """docs/derivation.md's table, to its own rounding (half a unit of the last digit, or 5 %)."""
    np.testing.assert_allclose(_fix_sigma(y_m, case), expected, rtol=0.05, atol=0.0006)


@pytest.mark.parametrize(
    ("case", "rate_hz", "rows"),
    [
        ("B", 10.0, {100.0: (0.005, 0.066, 0.005), 200.0: (0.0095, 0.20, 0.012), 400.0: (0.017, 0.58, 0.033)}),
        ("C", 10.0, {100.0: (0.011, 0.13, 0.011), 200.0: (0.019, 0.39, 0.023), 400.0: (0.034, 1.14, 0.064)}),
        ("B", 30.0, {100.0: (0.004, 0.046, 0.004), 200.0: (0.007, 0.13, 0.009), 400.0: (0.0125, 0.38, 0.022)}),
    ],
)
def test_posterior_meets_the_table(case: str, rate_hz: float, rows: dict[float, tuple[float, float, float]]) -> None:
    """Constant velocity, PSD .05/.1/.05, 25 m/s from 600 m, prior 10 m and 5 m/s: within 6 % plus rounding."""
    t = np.arange(0.0, 21.0, 1.0 / rate_hz)
    y = 600.0 - SPEED_M_S * t
    points = np.column_stack([np.zeros_like(y), y, np.tan(np.radians(3.5)) * (y - 60.0)])
    information = np.array([fix_information(p, _views(p, case)) for p in points])
    bound = posterior_bound(t, information, np.array([0.05, 0.1, 0.05]), 10.0, 5.0)
    for y_m, expected in rows.items():
        k = int(np.argmin(np.abs(y - y_m)))
        np.testing.assert_allclose(np.sqrt(np.diag(bound[k])[:3]), expected, rtol=0.06, atol=0.0006)


def test_third_station_lowers_y() -> None:
    """A third station at (40, 100) m brings σy at 200 m from 0.198 to 0.027 m (case B, posterior at 10 Hz)."""
    stations = (*PAIR, _station("third", 40.0, 100.0))
    t = np.arange(0.0, 16.05, 0.1)
    points = np.column_stack([0 * t, 600.0 - SPEED_M_S * t, np.tan(np.radians(3.5)) * (540.0 - SPEED_M_S * t)])
    sigma = []
    for used in (PAIR, stations):
        information = np.array([fix_information(p, _views(p, "B", used)) for p in points])
        bound = posterior_bound(t, information, np.array([0.05, 0.1, 0.05]), 10.0, 5.0)
        sigma.append(float(np.sqrt(bound[-1][1, 1])))
    np.testing.assert_allclose(sigma, [0.198, 0.027], rtol=0.06)


def test_posterior_equals_the_inverse_form(rng: np.random.Generator) -> None:
    """P⁺ = (P⁻¹ + HᵀΛH)⁻¹ step by step, for well-conditioned information."""
    t = np.cumsum(rng.uniform(0.05, 0.2, size=12))
    roots = rng.normal(size=(12, 3, 3))
    information = roots @ roots.transpose(0, 2, 1)
    psd = np.array([0.3, 0.6, 0.3])
    found = posterior_bound(t, information, psd, 3.0, 2.0)
    P = np.diag([9.0] * 3 + [4.0] * 3)
    for k in range(12):
        if k:
            F, Q = motion_matrices(float(t[k] - t[k - 1]), psd)
            P = F @ P @ F.T + Q
        inverse = np.linalg.inv(P)
        inverse[:3, :3] += information[k]
        P = np.linalg.inv(inverse)
        np.testing.assert_allclose(found[k], P, rtol=1e-8, atol=1e-12)


def test_motion_noise_does_not_depend_on_the_frame_rate() -> None:
    """Two half steps of white acceleration are one whole step."""
    psd = np.array([0.3, 0.6, 0.2])
    F, Q = motion_matrices(0.2, psd)
    F2, Q2 = motion_matrices(0.1, psd)
    np.testing.assert_allclose(F2 @ F2, F)
    np.testing.assert_allclose(F2 @ Q2 @ F2.T + Q2, Q)


def test_one_view_is_no_fix_but_still_informs() -> None:
    point = np.array([0.0, 200.0, 8.0])
    information = fix_information(point, _views(point, "B")[:1])
    assert fix_covariance(information) is None
    t = np.arange(0.0, 1.0, 0.1)
    seen = posterior_bound(t, np.array([information] * 10), np.ones(3), 10.0, 5.0)
    blind = posterior_bound(t, np.zeros((10, 3, 3)), np.ones(3), 10.0, 5.0)
    assert seen[-1][0, 0] < 0.01 * blind[-1][0, 0]
    assert seen[-1][1, 1] > 0.5 * blind[-1][1, 1]


def test_nothing_seen_gives_no_information() -> None:
    behind = np.array([0.0, -50.0, 2.0])
    views = _views(np.array([0.0, 100.0, 2.0]), "B")
    np.testing.assert_array_equal(fix_information(behind, views), np.zeros((3, 3)))
    assert fix_covariance(np.zeros((3, 3))) is None
