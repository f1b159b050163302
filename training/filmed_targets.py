"""Targets filmed in train worlds: on the ground and before it, with shadows, behind posts, as a station's camera shows.

Drawn windows (`training.windows`) have real backgrounds and any light; these have the aircraft where it truly flies and
rolls, and everything that surrounds it there. Each picture also gives a window elsewhere, at its busiest place of some:
a plain sky teaches little.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.session_truth import LEAST_SHARE_SEEN, LEAST_SNR, LEAST_WIDTH_PX
from groundstation.box import Box
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.geometry.aim import aim_at
from groundstation.simulation.body_raster import BodyWindow
from groundstation.simulation.drawn_flights import build_flight
from groundstation.simulation.render_primitives import overlap
from groundstation.simulation.rendered_camera import RenderedCamera, Shot
from groundstation.simulation.scene_body import Body
from groundstation.simulation.traffic.bird_body import BirdBody
from groundstation.simulation.trajectory import Trajectory
from groundstation.simulation.world.render_world import built_stations, rendered_cameras
from groundstation.simulation.world.world import World
from groundstation.sources.true_silhouettes import TrueSilhouette
from training.kinds import world_kinds
from training.mined_places import false_place
from training.recorded_windows import LabelledPicture, RecordedTarget, target_in

# of half the picture: where in it the target is
_MOST_OFF_AXIS = 0.8
_RATE_SIGMA_RAD_S = math.radians(1.5)
_CODED_SHARE = 0.6
# of so many drawn moments the one nearest to the ground is filmed, now and then, and of so many places the busiest
_MOMENTS, _LOW_SHARE, _PLACES = 4, 0.6, 6
# height from which traffic is in the air: cars are below
_IN_THE_AIR_M = 15.0
# logarithm of the width that is expected of an aircraft where a bird is, over the bird's; and the largest such width
_BIRD_LOG_RATIO = (-0.3, 2.0)
_MOST_WIDTH_PX = 260.0


class BodyLabel(StrEnum):
    """Classes of the network besides the background."""

    AIRCRAFT = "aircraft"
    OTHER = "other"


def filmed_targets(
    world: World, pictures: int, generator: np.random.Generator, channel: LearnedChannel | None = None
) -> Iterator[RecordedTarget]:
    """Film a world at so many drawn moments; yield each visible target, and a place without one expected there.

    A bird in the picture is a place, too, and a ``channel`` adds, where there is one, what it takes for an aircraft.
    """
    flown = build_flight(world.flight, world.seed)
    cameras = list(rendered_cameras(world, built_stations(world), flown).values())
    kinds = world_kinds(world)
    for _ in range(pictures):
        camera = cameras[int(generator.integers(len(cameras)))]
        t_s = _moment(flown, camera, generator)
        filmed = _filmed(camera, t_s, flown.position(np.array([t_s]))[0], generator)
        if filmed is not None and _visible(filmed.shot):
            yield from _targets(filmed, kinds, generator, channel)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LabelledShot:
    """A shot, and what is in it that moves.

    ``cover``, of the target and other aircraft in the air, and ``other``, of birds, are (h, w) uint8, the share of each
    pixel up to 255 that is covered where nothing hides it. ``bird_boxes`` has a box, px, for each bird that covers a
    pixel by half or more.
    """

    shot: Shot
    cover: ImageArray
    other: ImageArray
    bird_boxes: tuple[Box[int], ...]


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
) -> _LabelledShot | None:
    """Return the picture of a head that follows the nose (3,) badly."""
    lens = camera.station.lens
    aim = aim_at(camera.station.geometry(), nose_runway_m)
    if aim is None:
        return None
    half = 0.5 * np.array(lens.image_size_px) / lens.focal_px
    off = generator.uniform(-_MOST_OFF_AXIS, _MOST_OFF_AXIS, 2) * half
    rates = generator.normal(0.0, _RATE_SIGMA_RAD_S, 2)
    head = (aim.pan_rad + float(off[0]), aim.tilt_rad + float(off[1]), float(rates[0]), float(rates[1]))
    shot = camera.film(t_s, *head)
    cover, other = (np.zeros(lens.image_size_px[::-1], np.uint8) for _ in range(2))
    birds = []
    for body, window in camera.bodies(t_s, *head):
        label = BodyLabel.AIRCRAFT if body is camera.target else label_of(body, t_s)
        if label is BodyLabel.AIRCRAFT:
            _laid_into(cover, window)
        elif label is BodyLabel.OTHER and (box := _laid_into(other, window)) is not None:
            birds.append(box)
    return _LabelledShot(shot=shot, cover=cover, other=other, bird_boxes=tuple(birds))


def label_of(body: Body, t_s: float) -> BodyLabel | None:
    """Return what a body of the traffic is learned as; None as background, as cars are."""
    if isinstance(body, BirdBody):
        return BodyLabel.OTHER
    return BodyLabel.AIRCRAFT if body.place(t_s)[2] > _IN_THE_AIR_M else None


def _laid_into(plane: ImageArray, window: BodyWindow) -> Box[int] | None:
    """Lay the cover of a body into a plane (h, w); return the box of what is seen of it, None for nothing."""
    both = overlap(plane, (0, 0), window.cover, window.corner)
    if both is None:
        return None
    share = window.cover[:, :, 3][both[1]]
    part = plane[both[0]]
    np.maximum(part, np.rint(255.0 * share.clip(0.0, 1.0)).astype(np.uint8), out=part)
    rows, columns = np.nonzero(share >= 0.5)
    if rows.size == 0:
        return None
    y, x = both[0][0].start, both[0][1].start
    return Box(x + int(columns.min()), y + int(rows.min()), x + int(columns.max()) + 1, y + int(rows.max()) + 1)


def _visible(shot: Shot) -> bool:
    truth = shot.truth
    seen = truth.silhouette.any() and truth.share_in_view * truth.visible_share >= LEAST_SHARE_SEEN
    return bool(seen) and truth.width_px >= LEAST_WIDTH_PX and shot.snr >= LEAST_SNR


def _targets(
    filmed: _LabelledShot, kinds: tuple[str, ...], generator: np.random.Generator, channel: LearnedChannel | None
) -> Iterator[RecordedTarget]:
    truth, image = filmed.shot.truth, filmed.shot.picture.whole()
    if float(generator.uniform()) < _CODED_SHARE:
        image = _coded(image, int(generator.integers(40, 96)))
    picture = LabelledPicture(image=image, cover=filmed.cover, other=filmed.other)
    silhouette = TrueSilhouette(x=truth.corner_px[0], y=truth.corner_px[1], mask=truth.silhouette)
    unknown = np.full(2, np.nan)
    nose = unknown if truth.pixel_px is None else truth.pixel_px
    middle, width = silhouette.centre_px, truth.width_px
    yield target_in(picture, middle, width, nose, kinds)
    yield target_in(picture, _busiest(image, width, generator), width, nose, kinds, around_target=False)
    if filmed.bird_boxes:
        bird = filmed.bird_boxes[int(generator.integers(len(filmed.bird_boxes)))]
        place, wide = np.array([bird.x0 + bird.x1 - 1, bird.y0 + bird.y1 - 1]) / 2.0, float(bird.x1 - bird.x0)
        # as wide as an aircraft that is expected there
        wide = min(max(wide * math.exp(float(generator.uniform(*_BIRD_LOG_RATIO))), LEAST_WIDTH_PX), _MOST_WIDTH_PX)
        yield target_in(picture, place, wide, nose, kinds, around_target=False)
    if channel is None:
        return
    mistaken = false_place(channel, image, np.maximum(filmed.cover, filmed.other), generator)
    if mistaken is not None:
        yield target_in(picture, *mistaken, nose, kinds, around_target=False)


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
