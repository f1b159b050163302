"""Small cameras in a small world, so that a picture takes a fraction of a millisecond."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens
from groundstation.rig.rig import Rig, Station
from groundstation.simulation.airframes.airframe import Airframe
from groundstation.simulation.airframes.trainer import trainer
from groundstation.simulation.flights import site_rig
from groundstation.simulation.optics import Optics
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scenery import Scenery, Surroundings, surroundings_of
from groundstation.simulation.trajectory import SampledTrajectory

QUIET = Optics(pattern=None, electrons_per_level=1e9, read_noise_electrons=0.0)
AWAY = (0.0, -500.0, 100.0)


def small_station(name: str = "left", focal_px: float = 1600.0, size_px: tuple[int, int] = (320, 240)) -> Station:
    station = site_rig()[name]
    lens = Lens(
        image_size_px=size_px,
        focal_px=np.array([focal_px, 0.998 * focal_px]),
        principal_point_px=np.array([0.5 * size_px[0] + 3.2, 0.5 * size_px[1] - 2.7]),
        distortion=np.array([-0.21, 0.6, 4e-4, -3e-4, 0.0]),
    )
    return replace(station, lens=lens)


def small_rig(focal_px: float = 1600.0, size_px: tuple[int, int] = (320, 240)) -> Rig:
    return Rig(stations=tuple(small_station(name, focal_px, size_px) for name in ("left", "right")))


def straight(
    at_m: tuple[float, float, float], velocity_m_s: tuple[float, float, float] = (0.0, -20.0, 0.0)
) -> SampledTrajectory:
    """A flight that is at a place at time 0."""
    t = np.array([-10.0, 0.0, 10.0])
    velocity = np.array(velocity_m_s)
    return SampledTrajectory(
        t_s=t, position_m=np.array(at_m) + t[:, None] * velocity, velocity_m_s=np.tile(velocity, (3, 1))
    )


def ball(radius_m: float) -> Airframe:
    """A body centred at the nose, evenly lit from all directions ahead."""
    corners = []
    axes = radius_m * np.eye(3)
    for x in (axes[0], -axes[0]):
        for y in (axes[1], -axes[1]):
            for z in (axes[2], -axes[2]):
                corners.append([x, y, z])
    return Airframe(
        corners_body_m=np.array(corners),
        normals_body=np.tile([1.0, 0.0, 0.0], (8, 1)),
        colours_bgr=np.full((8, 3), 20.0),
        opacity=np.ones(8),
        span_m=2.0 * radius_m,
        rest_height_m=radius_m,
    )


def camera_at(
    place_m: tuple[float, float, float],
    optics: Optics = QUIET,
    airframe: Airframe | None = None,
    velocity_m_s: tuple[float, float, float] = (0.0, -20.0, 0.0),
    station: Station | None = None,
    seed: int = 0,
) -> RenderedCamera:
    shape = trainer() if airframe is None else airframe
    world = RenderedScene(trajectory=straight(place_m, velocity_m_s), airframe=shape)
    place = small_station() if station is None else station
    return RenderedCamera(world, place, optics, seed=seed, around=around(optics.pattern is None))


@lru_cache
def around(without_colour: bool) -> Surroundings:
    """The view of the left station of any of these worlds, drawn once."""
    eye = small_station().geometry().camera_pose(0.0, 0.0).position_runway_m
    return surroundings_of(Scenery(), eye, 1600.0, without_colour)


def grey(camera: RenderedCamera, t_s: float, *angles: float) -> FloatArray:
    return camera.picture(t_s, *angles).whole()[:, :, 0].astype(np.float64)
