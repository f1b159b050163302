"""From the numbers of traffic to bodies in a scene, and to the roads under them."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.airframe import Airframe
from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.attitude import AircraftPose, pose_at
from groundstation.simulation.scene_body import AircraftBody, Body
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_body import BirdBody
from groundstation.simulation.traffic.bird_shape import BirdShape
from groundstation.simulation.traffic.car_mesh import car_mesh
from groundstation.simulation.traffic.traffic_spec import TrafficSpec


def traffic_bodies(traffic: TrafficSpec) -> tuple[Body, ...]:
    """Return all that moves, as bodies."""
    return tuple(_bodies(traffic))


def with_roads(scenery: Scenery, traffic: TrafficSpec) -> Scenery:
    """Return a scenery with the roads of traffic on its ground."""
    if not traffic.roads:
        return scenery
    return replace(scenery, patches=(*scenery.patches, *(road.patch() for road in traffic.roads)))


def _bodies(traffic: TrafficSpec) -> Iterator[Body]:
    for bird in traffic.birds:
        yield BirdBody(shape=BirdShape(bird), path=bird.path)
    for flock in traffic.flocks:
        shape = BirdShape(flock.bird)
        for offset, phase in zip(flock.offsets_m, flock.phases, strict=True):
            yield BirdBody(
                shape=shape,
                path=flock.bird.path,
                offset_m=offset,
                phase=phase,
                sway_m=flock.sway_m,
                sway_s=flock.sway_s,
            )
    for other in traffic.aircraft:
        # its shadow is far from it, behind trees and hills, and paler than one with sharp edges
        yield _moving(build_airframe(other.airframe), other.path, casts_shadow=False)
    for road in traffic.roads:
        for car in road.cars:
            yield _moving(car_mesh(car), road.car_path(car), casts_shadow=True)


def _moving(shape: Airframe, path: ArcPath, *, casts_shadow: bool) -> AircraftBody:
    return AircraftBody(airframe=shape, position=_place_on(path), pose=_pose_on(path, shape), casts_shadow=casts_shadow)


def _place_on(path: ArcPath) -> Callable[[float], FloatArray]:
    return lambda t_s: path.position(np.array([t_s]))[0]


def _pose_on(path: ArcPath, shape: Airframe) -> Callable[[float], AircraftPose]:
    return lambda t_s: pose_at(path, t_s, shape.rest_height_m)
