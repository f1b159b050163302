"""Targets filmed in train worlds: on the ground and before it, with shadows, behind posts, as a station's camera shows.

Drawn windows (`training.windows`) have real backgrounds and any light; these have the aircraft where it truly flies and
rolls, and everything that surrounds it there. Each picture also gives a window elsewhere, at its busiest place of some:
a plain sky teaches little.
"""

import math
from collections.abc import Iterator

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.session_truth import LEAST_SHARE_SEEN, LEAST_SNR, LEAST_WIDTH_PX
from groundstation.box import Box
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.geometry.aim import aim_at
from groundstation.simulation.drawn_flights import build_flight
from groundstation.simulation.rendered_camera import RenderedCamera, Shot
from groundstation.simulation.trajectory import Trajectory
from groundstation.simulation.world.render_world import built_stations, rendered_cameras
from groundstation.simulation.world.world import World
from groundstation.sources.true_silhouettes import TrueSilhouette
from training.mined_places import false_place
from training.recorded_windows import RecordedTarget, target_in

# of half the picture: where in it the target is
_MOST_OFF_AXIS = 0.8
_RATE_SIGMA_RAD_S = math.radians(1.5)
_CODED_SHARE = 0.6
# of so many drawn moments the one nearest to the ground is filmed, now and then, and of so many places the busiest
_MOMENTS, _LOW_SHARE, _PLACES = 4, 0.6, 6


def filmed_targets(
    world: World, pictures: int, generator: np.random.Generator, channel: LearnedChannel | None = None
) -> Iterator[RecordedTarget]:
    """Film a world at so many drawn moments; yield each visible target, and a place without one expected there.

    A ``channel`` adds, where there is one, a place that it takes for an aircraft.
    """
    flown = build_flight(world.flight, world.seed)
    cameras = list(rendered_cameras(world, built_stations(world), flown).values())
    for _ in range(pictures):
        camera = cameras[int(generator.integers(len(cameras)))]
        t_s = _moment(flown, camera, generator)
        shot = _filmed(camera, t_s, flown.position(np.array([t_s]))[0], generator)
        if shot is None or not _visible(shot):
            continue
        yield from _targets(shot, generator, channel)


def _moment(flown: Trajectory, camera: RenderedCamera, generator: np.random.Generator) -> float:
    """Return a time of the flight, s; ground and horizon are behind the aircraft in more of them than by chance."""
    t_s = generator.uniform(*flown.span_s, _MOMENTS)
    if float(generator.uniform()) >= _LOW_SHARE:
        return float(t_s[0])
    eye = camera.station.geometry().camera_pose(0.0, 0.0).position_runway_m
    line = flown.position(t_s) - eye
    return float(t_s[np.argmin(line[:, 2] / np.hypot(line[:, 0], line[:, 1]))])


def _filmed(
    camera: RenderedCamera, t_s: float, nose_runway_m: FloatArray, generator: np.random.Generator
) -> Shot | None:
    """Return the picture of a head that follows the nose (3,) badly."""
    lens = camera.station.lens
    aim = aim_at(camera.station.geometry(), nose_runway_m)
    if aim is None:
        return None
    half = 0.5 * np.array(lens.image_size_px) / lens.focal_px
    off = generator.uniform(-_MOST_OFF_AXIS, _MOST_OFF_AXIS, 2) * half
    rates = generator.normal(0.0, _RATE_SIGMA_RAD_S, 2)
    return camera.film(t_s, aim.pan_rad + float(off[0]), aim.tilt_rad + float(off[1]), float(rates[0]), float(rates[1]))


def _visible(shot: Shot) -> bool:
    truth = shot.truth
    seen = truth.silhouette.any() and truth.share_in_view * truth.visible_share >= LEAST_SHARE_SEEN
    return bool(seen) and truth.width_px >= LEAST_WIDTH_PX and shot.snr >= LEAST_SNR


def _targets(shot: Shot, generator: np.random.Generator, channel: LearnedChannel | None) -> Iterator[RecordedTarget]:
    truth, image = shot.truth, shot.picture.whole()
    if float(generator.uniform()) < _CODED_SHARE:
        image = _coded(image, int(generator.integers(40, 96)))
    silhouette = TrueSilhouette(x=truth.corner_px[0], y=truth.corner_px[1], mask=truth.silhouette)
    unknown = np.full(2, np.nan)
    nose = unknown if truth.pixel_px is None else truth.pixel_px
    middle, width = silhouette.centre_px, truth.width_px
    elsewhere = _busiest(image, width, generator)
    yield target_in(image, silhouette, middle, width, nose)
    yield target_in(image, silhouette, elsewhere, width, nose)
    if channel is None:
        return
    h, w = silhouette.mask.shape
    box = Box(float(silhouette.x), float(silhouette.y), float(silhouette.x + w), float(silhouette.y + h))
    if mistaken := false_place(channel, image, box, generator):
        yield target_in(image, silhouette, *mistaken, nose)


def _busiest(image: ImageArray, width_px: float, generator: np.random.Generator) -> FloatArray:
    """Return the point (2,) of some whose surroundings, as large as a target, vary most."""
    size = np.array(image.shape[1::-1])
    places = generator.uniform(0.0, 1.0, (_PLACES, 2)) * (size - 1)
    half = max(width_px, 8.0)

    def contrast(place: FloatArray) -> float:
        x0, y0 = np.maximum(place - half, 0.0).astype(int)
        x1, y1 = np.minimum(place + half, size).astype(int) + 1
        return float(image[y0:y1, x0:x1].std())

    return np.asarray(max(places, key=contrast))


def _coded(image: ImageArray, quality: int) -> ImageArray:
    coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
