"""Reference positions against triangulated points: drift is noticed, outliers among the points and returns are not."""

import numpy as np
import pytest

from groundstation.estimation.triangulation import TriangulationView
from groundstation.estimation.updates.reference_update import NosePosition
from groundstation.tracking.camera_cross_check import CameraCrossCheck
from tests.stereo_rig import make_rig

PLACE_M = np.array([2.0, 200.0, 15.0])


def nose(place_m: np.ndarray) -> NosePosition:
    return NosePosition(position_m=place_m, covariance_m2=np.eye(3) * 0.02**2, velocity_m_s=np.zeros(3))


def views(generator: np.random.Generator, off_px: float = 0.0) -> list[tuple[str, TriangulationView]]:
    found = []
    for station in make_rig().stations:
        geometry = station.geometry()
        projection = geometry.project(PLACE_M, 0.0, 0.0)
        assert projection is not None
        pixel = projection.pixel + generator.normal(0.0, 0.5, 2) + (off_px, 0.0)
        found.append(
            (
                station.name,
                TriangulationView(
                    station=geometry,
                    pixel=pixel,
                    covariance_px2=np.eye(2) * 0.25,
                    pan_rad=0.0,
                    tilt_rad=0.0,
                    angle_sigma_rad=0.0,
                ),
            )
        )
        off_px = 0.0
    return found


def checked() -> CameraCrossCheck:
    return CameraCrossCheck({s.name: 0.0 for s in make_rig().stations}, 1.0, 5.0)


def test_without_a_recent_point_nothing_is_contradicted(rng: np.random.Generator) -> None:
    check = checked()
    assert not check.contradicts(0.0, nose(PLACE_M + 50.0))
    for k in range(5):
        check.add(0.1 * k, views(rng))
        check.contradicts(0.1 * k, nose(PLACE_M + 50.0))
    assert check.contradicts(0.5, nose(PLACE_M + 50.0))
    assert not check.contradicts(1.6, nose(PLACE_M + 50.0))


def test_a_drift_is_noticed_and_a_return_accepted_at_once(rng: np.random.Generator) -> None:
    check, refused = checked(), []
    for k in range(60):
        check.add(0.1 * k, views(rng))
        drift = np.array([0.0, 0.1 * k, 0.0])
        refused.append(check.contradicts(0.1 * k + 0.01, nose(PLACE_M + drift)))
    # a point's sigma along the runway is some 0.7 m here
    assert not any(refused[:6])
    assert all(refused[40:])
    check.add(6.0, views(rng))
    assert not check.contradicts(6.01, nose(PLACE_M))


@pytest.mark.parametrize("every", [3, 5])
def test_outliers_among_the_points_contradict_nothing(every: int, rng: np.random.Generator) -> None:
    check, refused = checked(), 0
    for k in range(200):
        check.add(0.1 * k, views(rng, 30.0 if k % every == 0 else 0.0))
        refused += check.contradicts(0.1 * k + 0.01, nose(PLACE_M))
    # one in a hundred by the gate's probability
    assert refused <= 8
