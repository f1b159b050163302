"""The baseline: exact on exact pixels, its covariance that of sampled noise, a named status without a solution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.estimation.triangulation import TriangulationView, midpoint, triangulate
from tests.stereo_rig import aim, make_rig


def exact_views(
    point: np.ndarray, names: tuple[str, ...] = ("left", "right"), angle_sigma_rad: float = 3e-5
) -> list[TriangulationView]:
    views = []
    for s in make_rig(names).stations:
        geometry = s.geometry()
        pan, tilt = aim(geometry, point + [2.0, 0.0, 0.5])
        projection = geometry.project(point, pan, tilt)
        assert projection is not None
        views.append(
            TriangulationView(
                station=geometry,
                pixel=projection.pixel,
                covariance_px2=np.diag([0.25, 0.16]),
                pan_rad=pan,
                tilt_rad=tilt,
                angle_sigma_rad=angle_sigma_rad,
            )
        )
    return views


@pytest.mark.parametrize("point", [(0.0, 10.0, 1.0), (1.0, 200.0, 9.0), (-20.0, 5000.0, 200.0)])
@pytest.mark.parametrize("names", [("left", "right"), ("left", "right", "third")])
def test_exact_pixels_give_the_exact_point(point: tuple[float, float, float], names: tuple[str, ...]) -> None:
    found = triangulate(exact_views(np.array(point), names))
    assert found is not None
    tolerance = 1e-6 * max(1.0, point[1] ** 2 / 1000)
    np.testing.assert_allclose(found.point_runway_m, point, atol=tolerance)
    np.testing.assert_allclose(found.midpoint_runway_m, point, atol=tolerance)
    assert found.residual_sigma < 1e-3


def test_covariance_is_that_of_sampled_noise(rng: np.random.Generator) -> None:
    point = np.array([1.0, 250.0, 11.0])
    views = exact_views(point)
    squares, errors = [], []
    n = 400
    for _ in range(n):
        noisy = [
            replace(
                v,
                pixel=v.pixel + rng.multivariate_normal([0, 0], v.covariance_px2),
                pan_rad=v.pan_rad + rng.normal(0, v.angle_sigma_rad),
                tilt_rad=v.tilt_rad + rng.normal(0, v.angle_sigma_rad),
            )
            for v in views
        ]
        found = triangulate(noisy)
        assert found is not None
        e = found.point_runway_m - point
        errors.append(e)
        squares.append(e @ np.linalg.solve(found.covariance_m2, e))
    low, high = chi2.ppf([0.005, 0.995], 3 * n) / n
    assert low < np.mean(squares) < high
    assert abs(np.mean(np.array(errors)[:, 1])) < 4 * np.std(np.array(errors)[:, 1]) / np.sqrt(n) + 0.01


def test_the_closed_form_bound(rng: np.random.Generator) -> None:
    """σ_x = y σ/√2, σ_y = √2 y² σ/b: so is the covariance."""
    y = 200.0
    views = [replace(v, covariance_px2=np.eye(2) * 0.25) for v in exact_views(np.array([0.0, y, 1.5]))]
    found = triangulate(views)
    assert found is not None
    sigma = np.hypot(0.5 / 6667.0, 3e-5)
    sx, sy, _ = np.sqrt(np.diag(found.covariance_m2))
    assert sx == pytest.approx(y * sigma / 2**0.5, rel=0.01)
    assert sy == pytest.approx(2**0.5 * y**2 * sigma / 10.77, rel=0.01)


def test_rays_that_do_not_meet_leave_a_residual() -> None:
    views = exact_views(np.array([0.0, 200.0, 8.0]))
    views[0] = replace(views[0], pixel=views[0].pixel + [0.0, 40.0])
    found = triangulate(views)
    assert found is not None
    assert found.residual_sigma > 10


def test_parallel_or_diverging_rays_have_no_point() -> None:
    views = exact_views(np.array([0.0, 200.0, 8.0]))
    apart = [replace(views[0], pan_rad=views[0].pan_rad + 0.05), replace(views[1], pan_rad=views[1].pan_rad - 0.05)]
    assert triangulate(apart) is None
    ray = views[0].station.ray(640.0, 480.0, 0.0, 0.0)
    assert midpoint([ray, ray]) is None
