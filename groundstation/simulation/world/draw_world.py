"""A world drawn at random from its seed; each part from a stream of its own, so that one does not move another."""

from dataclasses import replace
from enum import StrEnum
from typing import TypeVar

import numpy as np

from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.airframes.draw import draw_airframe
from groundstation.simulation.airframes.kinds import AirframeFamily
from groundstation.simulation.drawn_cameras import CameraSpec, draw_camera
from groundstation.simulation.drawn_flights import build_flight, draw_flight
from groundstation.simulation.drawn_stations import draw_stations
from groundstation.simulation.scenery import SceneryName, SkyName, draw_scenery
from groundstation.simulation.specification_table import rounded
from groundstation.simulation.traffic import draw_traffic
from groundstation.simulation.world.world import World
from groundstation.simulation.world.world_sets import WorldSet, set_of

# what occurs in the test set alone
WITHHELD_FAMILIES = (AirframeFamily.CANARD, AirframeFamily.T_TAIL)
WITHHELD_SCENERIES = (SceneryName.SNOW, SceneryName.VILLAGE)
WITHHELD_SKIES = (SkyName.DUSK, SkyName.BROKEN)

KindT = TypeVar("KindT", bound=StrEnum)
DURATION_S = 20.0
FRAME_HZ = 10.0
_AIRFRAME, _FLIGHT, _SCENERY, _STATIONS, _CAMERAS, _TRAFFIC = range(401, 407)
# how often the stations of a site have cameras of different kinds
_MIXED_CAMERAS = 0.2


def draw_world(seed: int, *, duration_s: float = DURATION_S, frame_hz: float = FRAME_HZ) -> World:
    """Draw the world of a seed; its set decides which airframes, sceneries and skies may occur.

    Raises `ScenarioError` for a seed of no set.
    """
    withholds = set_of(seed) is not WorldSet.TEST

    def stream(number: int) -> np.random.Generator:
        return np.random.default_rng([seed, number])

    def allowed(kinds: type[KindT], withheld: tuple[KindT, ...]) -> tuple[KindT, ...]:
        return tuple(kind for kind in kinds if not (withholds and kind in withheld))

    airframe = rounded(draw_airframe(stream(_AIRFRAME), allowed(AirframeFamily, WITHHELD_FAMILIES)))
    built = build_airframe(airframe)
    flight = rounded(draw_flight(stream(_FLIGHT), built.span_m, built.rest_height_m, duration_s))
    stations = rounded(draw_stations(stream(_STATIONS), duration_s=duration_s, span_m=built.span_m))
    sceneries, skies = allowed(SceneryName, WITHHELD_SCENERIES), allowed(SkyName, WITHHELD_SKIES)
    scenery = rounded(draw_scenery(stream(_SCENERY), sceneries, skies))
    traffic = draw_traffic(
        stream(_TRAFFIC),
        flown=build_flight(flight, seed),
        eyes_m=[np.array(station.position_m) for station in stations.stations],
        scenery=scenery,
        duration_s=duration_s,
        families=allowed(AirframeFamily, WITHHELD_FAMILIES),
    )
    return World(
        seed=seed,
        frame_hz=frame_hz,
        airframe=airframe,
        flight=flight,
        scenery=scenery,
        traffic=rounded(traffic),
        stations=stations,
        cameras=_cameras(stream(_CAMERAS), len(stations.stations), frame_hz=frame_hz, duration_s=duration_s),
    )


def _cameras(
    generator: np.random.Generator, count: int, *, frame_hz: float, duration_s: float
) -> tuple[CameraSpec, ...]:
    """Return cameras of one kind, each with its own principal point and exposure steps; now and then of several."""

    def draw() -> CameraSpec:
        return draw_camera(generator, frame_hz=frame_hz, duration_s=duration_s)

    first = draw()
    mixed = bool(generator.uniform() < _MIXED_CAMERAS)
    others = [draw() for _ in range(count - 1)]
    if not mixed:
        others = [_of_kind(first, other) for other in others]
    return tuple(rounded(camera) for camera in (first, *others))


def _of_kind(first: CameraSpec, other: CameraSpec) -> CameraSpec:
    """Return a camera of the first one's kind with what differs from piece to piece of another."""
    return replace(
        first,
        principal_offset_px=other.principal_offset_px,
        exposure_steps=other.exposure_steps,
        phase_s=other.phase_s if first.phase_s else 0.0,
    )
