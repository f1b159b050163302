"""A sheet of drawn traffic as the stations of drawn worlds see it, to look at.

    python benchmarks/traffic_sheet.py OUT.png [--first SEED] [--count N] [--columns N] [--close PX]

Each picture is of a world with traffic, by the station and at the time at which most of it is near the aircraft in the
picture, at half size; with --close PX a square of so many px around one of what moves, at four times its size.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.drawn_flights import build_flight
from groundstation.simulation.drawn_stations import StationCamera, build_stations
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scenery import fine_range_around, surroundings_of
from groundstation.simulation.traffic import traffic_bodies, traffic_kind, with_roads
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world import World

_MAGNIFIED = 4
_STEP_S = 0.1


def scene_of(world: World) -> RenderedScene:
    """Return a world's scene."""
    return RenderedScene(
        trajectory=build_flight(world.flight, world.seed),
        airframe=build_airframe(world.airframe),
        scenery=with_roads(world.scenery, world.traffic),
        traffic=traffic_bodies(world.traffic),
    )


def angles_to(camera: RenderedCamera, point: FloatArray) -> tuple[float, float]:
    """Return pan and tilt, rad, that look at a point (3,), runway frame, within the station's mounting errors."""
    eye = camera.station.geometry().camera_pose(0.0, 0.0).position_runway_m
    x, y, z = (point - eye).tolist()
    pan, tilt = -math.atan2(x, y), math.atan2(z, math.hypot(x, y))
    for _ in range(4):
        axis = camera.station.geometry().camera_pose(pan, tilt).runway_from_camera[:, 2]
        pan -= math.atan2(x, y) - math.atan2(axis[0], axis[1])
        tilt += math.atan2(z, math.hypot(x, y)) - math.asin(axis[2])
    return pan, tilt


def best_moment(scene: RenderedScene, eyes: list[FloatArray], half_view_rad: float) -> tuple[int, float, FloatArray]:
    """Return station, time, and the place of what moves closest to the aircraft then, where most is in view."""
    best = (-1.0, 0, 0.0, np.zeros(3))
    start, end = scene.trajectory.span_s
    for number, eye in enumerate(eyes):
        for t_s in np.arange(start, end, _STEP_S).tolist():
            line = scene.target().place(t_s) - eye
            places = [body.place(t_s) for body in scene.traffic]
            offs = [math.acos(np.clip(_cosine(line, place - eye), -1.0, 1.0)) for place in places]
            score = sum(max(1.0 - off / half_view_rad, 0.0) for off in offs)
            if score > best[0]:
                best = (score, number, t_s, places[int(np.argmin(offs))])
    return best[1:]


def _cosine(one: FloatArray, other: FloatArray) -> float:
    return float(one @ other / (np.linalg.norm(one) * np.linalg.norm(other)))


def pictures(first: int, count: int, close_px: int) -> Iterator[ImageArray]:
    """Yield one picture for each world with traffic."""
    seed = first
    while count:
        world = draw_world(seed)
        seed += 1
        if world.traffic == type(world.traffic)():
            continue
        count -= 1
        scene = scene_of(world)
        cameras = [StationCamera(lens=c.lens(), readout_s=c.readout_s) for c in world.cameras]
        built = build_stations(world.stations, cameras, duration_s=world.flight.duration_s, seed=world.seed)
        stations = built.true_rig.stations
        eyes = [station.geometry().camera_pose(0.0, 0.0).position_runway_m for station in stations]
        spec = world.cameras[0]
        half_view = 0.5 * math.hypot(*spec.image_size_px) / spec.focal_px
        number, t_s, moving = best_moment(scene, eyes, half_view)
        spec, place = world.cameras[number], scene.target().place(t_s)
        fine = fine_range_around(np.array([place, moving]), eyes[number], 1.3 * half_view)
        around = surroundings_of(scene.scenery, eyes[number], spec.focal_px, not spec.colour, fine)
        camera = RenderedCamera(scene, stations[number], spec.optics(), seed=seed, around=around)
        shot = camera.film(t_s, *angles_to(camera, place if not close_px else moving))
        whole = shot.picture.whole()
        if close_px:
            row, column = (max((n - close_px) // 2, 0) for n in whole.shape[:2])
            part = whole[row : row + close_px, column : column + close_px]
            shown = cv2.resize(part, None, fx=_MAGNIFIED, fy=_MAGNIFIED, interpolation=cv2.INTER_NEAREST)
        else:
            shown = cv2.resize(whole, (640, 480), interpolation=cv2.INTER_AREA)
        words = f"{world.seed} {traffic_kind(world.traffic)} {t_s:.1f} s unhidden {shot.truth.visible_share:.2f}"
        words += f" {np.linalg.norm(moving - eyes[number]):.0f} m, snr {shot.snr:.0f}"
        picture = np.ascontiguousarray(shown, np.uint8)
        cv2.putText(picture, words, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 255), 1, cv2.LINE_AA)
        yield picture


def main() -> None:
    """Draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--columns", type=int, default=4)
    parser.add_argument("--close", type=int, default=0)
    given = parser.parse_args()
    made = list(pictures(given.first, given.count, given.close))
    while len(made) % given.columns:
        made.append(np.zeros_like(made[0]))
    rows = [np.hstack(made[k : k + given.columns]) for k in range(0, len(made), given.columns)]
    given.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(given.out), np.vstack(rows))


if __name__ == "__main__":
    main()
