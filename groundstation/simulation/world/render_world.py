"""Filming a world: the session folder that a receiver would have, the exact truth, and world.toml."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.drawn_flights import build_flight
from groundstation.simulation.drawn_stations import BuiltStations, StationCamera, build_stations
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.rendered_session_folder import checked_frames, write_rendered_session
from groundstation.simulation.scenery import fine_range_around, surroundings_of
from groundstation.simulation.session_folder import require_new_folder
from groundstation.simulation.simulate import simulate
from groundstation.simulation.traffic import traffic_bodies, with_roads
from groundstation.simulation.trajectory import Trajectory
from groundstation.simulation.world.world import World
from groundstation.simulation.world.world_file import FILE_NAME, world_text

# the fine panorama reaches half a picture's diagonal and the head's errors beyond the flight's directions
_MARGIN_OF_VIEW = 1.2
_PATH_STEP_S = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmedWorld:
    """Number of pairs, duration in s, and the folder."""

    pairs: int
    duration_s: float
    folder: Path


def render_world(
    world: World, folder: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> FilmedWorld:
    """Render a world into a session folder; ``progress(done, total)`` counts pairs.

    Raises `InputError` where the folder cannot be written or is not empty.
    """
    flown, built = build_flight(world.flight, world.seed), built_stations(world)
    duration = world.flight.duration_s
    flight = simulate(built.scenario(flown, frame_hz=world.frame_hz, seed=world.seed))
    checked_frames(flight, built.faults)
    require_new_folder(folder)
    write_rendered_session(
        folder,
        flight,
        rendered_cameras(world, built, flown),
        words=_words(world),
        faults=built.faults,
        recordings={s.name: c.recording() for s, c in zip(built.rig.stations, world.cameras, strict=True)},
        texts={FILE_NAME: world_text(world)},
        progress=progress,
    )
    return FilmedWorld(pairs=flight.truth.t_s.size, duration_s=duration, folder=folder)


def built_stations(world: World) -> BuiltStations:
    """Return a world's stations with their cameras."""
    cameras = [
        StationCamera(lens=c.lens(), readout_s=c.readout_s, phase_s=c.phase_s, pixel_sigma_px=0.5)
        for c in world.cameras
    ]
    return build_stations(world.stations, cameras, duration_s=world.flight.duration_s, seed=world.seed)


def rendered_cameras(world: World, built: BuiltStations, flown: Trajectory) -> dict[str, RenderedCamera]:
    """Return a camera for each true station, all in one scene."""
    scene = RenderedScene(
        trajectory=flown,
        airframe=build_airframe(world.airframe),
        scenery=with_roads(world.scenery, world.traffic),
        traffic=traffic_bodies(world.traffic),
    )
    start, end = flown.span_s
    path = flown.position(np.arange(start, end, _PATH_STEP_S))
    rendered = {}
    for number, (station, camera) in enumerate(zip(built.true_rig.stations, world.cameras, strict=True)):
        eye = station.geometry().camera_pose(0.0, 0.0).position_runway_m
        diagonal_rad = float(np.hypot(*camera.image_size_px)) / camera.focal_px
        fine = fine_range_around(path, eye, _MARGIN_OF_VIEW * 0.5 * diagonal_rad)
        around = surroundings_of(scene.scenery, eye, camera.focal_px, not camera.colour, fine)
        rendered[station.name] = RenderedCamera(
            scene, station, camera.optics(), seed=world.seed, number=number, around=around
        )
    return rendered


def _words(world: World) -> dict[str, str]:
    """Return the top of session.toml."""
    return {
        "name": f"world {world.seed}",
        "origin": f"Simulated and rendered from {FILE_NAME}; exact truth",
        "licence": "CC0",
        "notes": f"{world.airframe.family}, {world.flight.kind}; truth.csv, masks.npz, visibility.csv are exact",
    }
