"""Pictures of train worlds, as a station's camera shows them, with what in them moves.

A head follows the aircraft badly, and the moments are those at which ground and horizon are behind it more often than
by chance.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.session_truth import LEAST_SHARE_SEEN, LEAST_SNR, LEAST_WIDTH_PX
from groundstation.box import Box
from groundstation.geometry.aim import aim_at
from groundstation.simulation.body_raster import BodyWindow
from groundstation.simulation.render_primitives import overlap
from groundstation.simulation.rendered_camera import RenderedCamera, Shot
from groundstation.simulation.scene_body import Body
from groundstation.simulation.traffic.bird_body import BirdBody
from groundstation.simulation.trajectory import Trajectory

# of half the picture: where in it the target is
_MOST_OFF_AXIS = 0.8
_RATE_SIGMA_RAD_S = math.radians(1.5)
_CODED_SHARE = 0.6
# of so many drawn moments the one nearest to the ground is filmed, now and then
_MOMENTS, _LOW_SHARE = 4, 0.6
# height from which traffic is in the air: cars are below
_IN_THE_AIR_M = 15.0
# share of a pixel from which it counts for the box around a body: wings of far aircraft are thin
_AIRCRAFT_COVER, _BIRD_COVER = 0.25, 0.5


class BodyLabel(StrEnum):
    """Classes of the network besides the background."""

    AIRCRAFT = "aircraft"
    OTHER = "other"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelledShot:
    """A shot, and what is in it that moves.

    ``cover``, of the target and other aircraft in the air, and ``other``, of birds, are (h, w) uint8, the share of each
    pixel up to 255 that is covered where nothing hides it. ``bird_boxes`` has a box, px, for each bird that covers a
    pixel by half or more, ``aircraft_boxes`` one for each aircraft that covers one by a quarter or more; ``target_box``
    is the target's own among them, None where nothing of it is in the picture.
    """

    shot: Shot
    cover: ImageArray
    other: ImageArray
    bird_boxes: tuple[Box[int], ...]
    aircraft_boxes: tuple[Box[int], ...]
    target_box: Box[int] | None


def filming_moment(flown: Trajectory, camera: RenderedCamera, generator: np.random.Generator) -> float:
    """Return a time of the flight, s; ground and horizon are behind the aircraft in more of them than by chance."""
    t_s = generator.uniform(*flown.span_s, _MOMENTS)
    if float(generator.uniform()) >= _LOW_SHARE:
        return float(t_s[0])
    eye = camera.station.geometry().camera_pose(0.0, 0.0).position_runway_m
    line = flown.position(t_s) - eye
    return float(t_s[np.argmin(line[:, 2] / np.hypot(line[:, 0], line[:, 1]))])


def film_badly_aimed(
    camera: RenderedCamera, t_s: float, nose_runway_m: FloatArray, generator: np.random.Generator
) -> LabelledShot | None:
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
    birds: list[Box[int]] = []
    aircraft: list[Box[int]] = []
    target = None
    for body, window in camera.bodies(t_s, *head):
        label = BodyLabel.AIRCRAFT if body is camera.target else label_of(body, t_s)
        if label is BodyLabel.AIRCRAFT and (box := _laid_into(cover, window, _AIRCRAFT_COVER)) is not None:
            aircraft.append(box)
            target = box if body is camera.target else target
        elif label is BodyLabel.OTHER and (box := _laid_into(other, window, _BIRD_COVER)) is not None:
            birds.append(box)
    return LabelledShot(
        shot=shot,
        cover=cover,
        other=other,
        bird_boxes=tuple(birds),
        aircraft_boxes=tuple(aircraft),
        target_box=target,
    )


def label_of(body: Body, t_s: float) -> BodyLabel | None:
    """Return what a body of the traffic is learned as; None as background, as cars are."""
    if isinstance(body, BirdBody):
        return BodyLabel.OTHER
    return BodyLabel.AIRCRAFT if body.place(t_s)[2] > _IN_THE_AIR_M else None


def _laid_into(plane: ImageArray, window: BodyWindow, least: float) -> Box[int] | None:
    """Lay the cover of a body into a plane (h, w); return the box of pixels that it covers by ``least`` or more."""
    both = overlap(plane, (0, 0), window.cover, window.corner)
    if both is None:
        return None
    share = window.cover[:, :, 3][both[1]]
    part = plane[both[0]]
    np.maximum(part, np.rint(255.0 * share.clip(0.0, 1.0)).astype(np.uint8), out=part)
    rows, columns = np.nonzero(share >= least)
    if rows.size == 0:
        return None
    y, x = both[0][0].start, both[0][1].start
    return Box(x + int(columns.min()), y + int(rows.min()), x + int(columns.max()) + 1, y + int(rows.max()) + 1)


def is_visible(shot: Shot) -> bool:
    """Return whether the target is large, clear and whole enough in a shot to be learned from."""
    truth = shot.truth
    seen = truth.silhouette.any() and truth.share_in_view * truth.visible_share >= LEAST_SHARE_SEEN
    return bool(seen) and truth.width_px >= LEAST_WIDTH_PX and shot.snr >= LEAST_SNR


def as_coded(image: ImageArray, generator: np.random.Generator) -> ImageArray:
    """Return a picture as a video or a camera's JPEG has it, now and then as it is."""
    if float(generator.uniform()) >= _CODED_SHARE:
        return image
    coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(generator.integers(40, 96))])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
