import numpy as np
import pytest

from groundstation.geometry.aim import aim_at
from groundstation.geometry.station import StationGeometry
from tests.geometry.test_station import LENS, station


@pytest.mark.parametrize("range_m", [5.0, 200.0, 5000.0])
def test_the_point_is_projected_to_the_principal_point(rng: np.random.Generator, range_m: float) -> None:
    geometry = station(rng)
    for _ in range(20):
        direction = np.array([rng.normal(), abs(rng.normal()) + 0.1, abs(0.3 * rng.normal())])
        point = range_m * direction / np.linalg.norm(direction)
        aimed = aim_at(geometry, point)
        assert aimed is not None
        projected = geometry.project(point, aimed.pan_rad, aimed.tilt_rad)
        assert projected is not None
        np.testing.assert_allclose(projected.pixel, LENS.principal_point_px, atol=1e-5)


def test_a_point_in_the_station_cannot_be_aimed_at() -> None:
    plain = StationGeometry(
        name="s",
        ptu_position_m=np.zeros(3),
        runway_from_base_wxyz=np.array([1.0, 0, 0, 0]),
        head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0, 0]),
        camera_in_head_m=np.zeros(3),
        lens=LENS,
    )
    assert aim_at(plain, np.zeros(3)) is None
    assert aim_at(plain, np.array([0.0, 0.0, 50.0])) is None, "straight above, pan turns nothing"
