"""Traffic in pictures: what is nearer than the aircraft hides it, birds beat their wings, cars are on the ground."""

import numpy as np
import pytest

from groundstation.simulation.airframes.mesh import doubled_areas, volume
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scene_body import Body
from groundstation.simulation.traffic import TrafficSpec, traffic_bodies
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_spec import BirdSpec
from groundstation.simulation.traffic.traffic_spec import CarKind, CarSpec, RoadSpec
from tests.simulation.small_site import AWAY, QUIET, around, ball, grey, small_station, straight

TARGET = np.array([4.0, 200.0, 20.0])
STATION = small_station()
EYE = STATION.geometry().camera_pose(0.0, 0.0).position_runway_m


def look_at(point: np.ndarray) -> tuple[float, float]:
    x, y, z = point - EYE
    return -float(np.arctan2(x, y)), float(np.arctan2(z, np.hypot(x, y)))


def camera(bodies: tuple[Body, ...], target: np.ndarray = TARGET) -> RenderedCamera:
    x, y, z = target
    scene = RenderedScene(trajectory=straight((x, y, z), (0.0, -1.0, 0.0)), airframe=ball(1.0), traffic=bodies)
    return RenderedCamera(scene, STATION, QUIET, around=around(without_colour=True))


def bird(share: float, **changes: object) -> tuple[Body, ...]:
    """A large bird on the line of sight, so much of the way to the aircraft, that flies across it."""
    x, y, z = EYE + share * (TARGET - EYE)
    path = ArcPath(place_m=(float(x), float(y), float(z)), heading_rad=0.5 * np.pi, speed_m_s=6.0)
    numbers = {"span_m": 1.6, "length_per_span": 0.6, "flap_hz": 2.0, "flapping_share": 1.0, "path": path, **changes}
    return traffic_bodies(TrafficSpec(birds=(BirdSpec(**numbers),)))  # type: ignore[arg-type]


def test_a_bird_before_the_aircraft_hides_it_and_one_behind_it_does_not() -> None:
    angles = look_at(TARGET)
    alone, before, behind = (camera(b).film(0.0, *angles) for b in ((), bird(0.4), bird(1.5)))
    assert alone.truth.visible_share == 1.0
    assert 0.0 < before.truth.visible_share < 0.85
    assert before.snr < 0.95 * alone.snr
    assert behind.truth.visible_share == 1.0
    assert behind.snr > 0.9 * alone.snr
    np.testing.assert_array_equal(before.truth.silhouette, alone.truth.silhouette)
    # before and after it has crossed, it hides nothing
    assert camera(bird(0.4)).film(1.0, *angles).truth.visible_share == 1.0


def test_the_bodies_of_a_picture_are_what_nothing_nearer_hides() -> None:
    angles = look_at(TARGET)
    for bodies in ((), bird(0.4), bird(1.5), (*bird(0.4), *bird(0.5), *bird(0.6, span_m=4.0))):
        seen_by = camera(bodies)
        shot = seen_by.film(0.0, *angles)
        found = seen_by.bodies(0.0, *angles)
        assert len(found) == 1 + len(bodies)
        distances = [float(np.linalg.norm(body.place(0.0) - EYE)) for body, _ in found]
        assert distances == sorted(distances)
        planes = [np.zeros((480, 640)) for _ in found]
        for plane, (_, window) in zip(planes, found, strict=True):
            (x, y), (h, w) = window.corner, window.cover.shape[:2]
            plane[y : y + h, x : x + w] = window.cover[:, :, 3]
        own = next(k for k, (body, _) in enumerate(found) if body is seen_by.target)
        assert (planes[own] >= 0.5).sum() == round(shot.truth.visible_share * shot.truth.silhouette.sum())
        # no pixel is covered twice
        assert np.sum(planes, axis=0).max() <= 1.0 + 1e-5


def test_a_bird_beats_its_wings_and_holds_them_while_it_glides() -> None:
    (flapping,), (gliding,) = bird(0.4), bird(0.4, flapping_share=0.0)
    for body, moves in ((flapping, True), (gliding, False)):
        shapes = [body.skin(t).corners_runway_m - body.place(t) for t in (0.0, 0.25)]
        assert (np.abs(shapes[0] - shapes[1]).max() > 0.1) == moves
        assert np.linalg.norm(shapes[0], axis=2).max() <= body.reach_m
        turned = np.einsum("ij,ij->i", body.skin(0.25).normals_runway, doubled_areas(body.skin(0.25).corners_runway_m))
        assert np.all(turned > 0.0)
    x, y, z = EYE + 0.4 * (TARGET - EYE)
    still = ArcPath(place_m=(float(x), float(y), float(z)), heading_rad=2.0, speed_m_s=0.0)
    filmed = camera(bird(0.4, path=still), np.array(AWAY))
    beats, pair = [grey(filmed, t, *look_at(TARGET)) for t in (0.0, 0.25)], grey(filmed, 0.0, *look_at(TARGET))
    assert (np.abs(beats[0] - beats[1]) > 10.0).sum() > 20
    np.testing.assert_array_equal(pair, beats[0])


@pytest.mark.parametrize("kind", list(CarKind))
def test_a_car_stands_on_the_ground_and_drives_forward(kind: CarKind) -> None:
    road = RoadSpec(x_m=10.0, y_m=150.0, heading_rad=0.8, length_m=500.0, cars=(CarSpec(kind=kind, speed_m_s=-9.0),))
    (car,) = traffic_bodies(TrafficSpec(roads=(road,)))
    corners = car.skin(3.0).corners_runway_m
    assert 0.0 <= corners[..., 2].min() < 0.02
    assert corners[..., 2].max() == pytest.approx(road.cars[0].height_m, abs=0.01)
    forward = (car.place(3.1) - car.place(3.0)) / 0.1
    assert np.linalg.norm(forward) == pytest.approx(9.0)
    along = (corners - car.place(3.0)) @ (forward / 9.0)
    assert np.ptp(along) == pytest.approx(road.cars[0].length_m, rel=0.03)
    # all parts are closed and turn their outer sides outward
    size = road.cars[0].length_m * road.cars[0].width_m * road.cars[0].height_m
    assert 0.4 < volume(corners) / size < 1.1
    assert np.all(np.einsum("ij,ij->i", car.skin(3.0).normals_runway, doubled_areas(corners)) > 0.0)
