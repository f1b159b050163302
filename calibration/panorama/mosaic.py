"""One head's panorama: frames laid where their encoders say, registered to what they make together, laid again.

Encoders' noise averages out over the frames; what they are off by slowly does within a field of view, since each frame
is registered as a whole, by the lens, to those around it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.registration.head_registration import STANDING, HeadRegistration, RegisteredAngles
from groundstation.registration.panorama import HALVED, GroundPanorama, PictureRays, halved_grey
from groundstation.rig.rig import Station

# at most, and until frames move by less of a pixel
ROUNDS, _STANDING_PX = 5, 0.02
# of the frames' scatter at one place, grey levels: clouds, an aircraft, what moves
_MOST_SCATTER = 12.0
_LEAST_FRAMES = 2
_MOST_SIDE = 30_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PanoramaFrame:
    """One frame: its halved grey levels (h, w), and pan and tilt (2,), rad, by the encoders, at its stamp.

    ``rates_rad_s`` are of a head that turns while the rows of a rolling shutter are read out.
    """

    grey: FloatArray
    angles_rad: FloatArray
    rates_rad_s: tuple[float, float] = STANDING


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mosaic:
    """The panorama, and which frames were registered to it in the last round, with rms change of their angles, rad."""

    panorama: GroundPanorama
    registered: int
    moved_rad: float


def make_mosaic(station: Station, frames: Sequence[PanoramaFrame], highest_rad: float) -> Mosaic:
    """Return the panorama of one head from frames, up to a height above the base's level."""
    rays = PictureRays(station)
    step = HALVED / float(station.lens.focal_px.mean())
    angles = np.array([frame.angles_rad for frame in frames])
    sigma = max(station.angle_sigma_rad, step)
    panorama = _laid(rays, frames, angles, step, highest_rad)
    registered, moved = 0, 0.0
    for _ in range(ROUNDS):
        registration = HeadRegistration(station, panorama)
        found = [
            registration.register_grey(frame.grey, float(a[0]), float(a[1]), sigma, frame.rates_rad_s)
            for frame, a in zip(frames, angles, strict=True)
        ]
        good = [k for k, one in enumerate(found) if isinstance(one, RegisteredAngles)]
        after = angles.copy()
        for k in good:
            one = found[k]
            if isinstance(one, RegisteredAngles):
                # at the stamp, as the encoders' are
                after[k] = np.array([one.pan_rad, one.tilt_rad]) - one.delay_s * np.array(frames[k].rates_rad_s)
        if not good:
            break
        # the whole stays where the encoders, on average, have it
        after[good] += (np.array([frames[k].angles_rad for k in good]) - after[good]).mean(axis=0)
        moved, registered = float(np.sqrt(np.mean((after[good] - angles[good]) ** 2))), len(good)
        angles = after
        # what could not be registered would blur it
        kept = [frames[k] for k in good]
        panorama = _laid(rays, kept, angles[good], step, highest_rad)
        if moved < _STANDING_PX * step:
            break
    # what the encoders' errors leave of the whole's place
    panorama = replace(panorama, sigma_rad=station.angle_sigma_rad / float(np.sqrt(max(registered, 1))))
    return Mosaic(panorama=panorama, registered=registered, moved_rad=moved)


def _laid(
    rays: PictureRays, frames: Sequence[PanoramaFrame], angles: FloatArray, step: float, highest_rad: float
) -> GroundPanorama:
    """Return the mean of frames at given angles (n, 2), known where several agree."""
    w, h = rays.size_px
    border = np.concatenate([np.arange(w), np.arange(w) + (h - 1) * w, np.arange(h) * w, np.arange(h) * w + w - 1])
    edges = [
        rays.directions(rays.rays[border], float(a[0]), float(a[1]), rays.turned(frame.rates_rad_s, border))
        for frame, a in zip(frames, angles, strict=True)
    ]
    every = np.concatenate(edges)
    left, top = float(every[:, 0].max()), min(float(every[:, 1].max()), highest_rad)
    wide = min(int((left - every[:, 0].min()) / step) + 2, _MOST_SIDE)
    high = min(max(int((top - every[:, 1].min()) / step) + 2, 2), _MOST_SIDE)
    total, square, count = (np.zeros((high, wide), dtype=np.float64) for _ in range(3))
    for frame, a in zip(frames, angles, strict=True):
        towards = rays.directions(rays.rays, float(a[0]), float(a[1]), rays.turned(frame.rates_rad_s))
        places = (np.array([left, top]) - towards) / step
        _lay(frame.grey, places.reshape(h, w, 2), total, square, count)
    mean = total / np.maximum(count, 1e-9)
    scatter = np.sqrt(np.maximum(square / np.maximum(count, 1e-9) - mean**2, 0.0))
    known = (count > _LEAST_FRAMES - 0.5) & (scatter < _MOST_SCATTER)
    return GroundPanorama(
        grey=np.asarray(np.where(count > 0.0, mean, 0.0), dtype=np.float32),
        known=np.asarray(known, dtype=np.uint8),
        left_rad=left,
        top_rad=top,
        step_rad=step,
    )


def _lay(grey: FloatArray, places: FloatArray, total: FloatArray, square: FloatArray, count: FloatArray) -> None:
    """Add a frame (h, w) to the sums; ``places`` (h, w, 2) are its pixels in the panorama."""
    h, w = grey.shape
    # a frame turned by degrees is nearly a similarity of the panorama: its inverse by a few fixed-point steps
    low = np.floor(places.reshape(-1, 2).min(axis=0)).astype(np.int64)
    top = np.ceil(places.reshape(-1, 2).max(axis=0)).astype(np.int64)
    x0, y0 = max(int(low[0]), 0), max(int(low[1]), 0)
    x1, y1 = min(int(top[0]) + 1, total.shape[1]), min(int(top[1]) + 1, total.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    wanted = np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)), axis=-1).astype(np.float32)
    corner = places[0, 0]
    at = (wanted - corner).astype(np.float32)
    field = np.asarray(places, dtype=np.float32)
    for _ in range(4):
        there = cv2.remap(field, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        at = at + (wanted - there)
    inside = (at[..., 0] >= 1.0) & (at[..., 1] >= 1.0) & (at[..., 0] <= w - 2.0) & (at[..., 1] <= h - 2.0)
    value = cv2.remap(np.asarray(grey, dtype=np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    part = np.s_[y0:y1, x0:x1]
    total[part] += np.where(inside, value, 0.0)
    square[part] += np.where(inside, value.astype(np.float64) ** 2, 0.0)
    count[part] += inside


def frame_of(image: ImageArray, angles_rad: FloatArray, rates_rad_s: tuple[float, float] = STANDING) -> PanoramaFrame:
    """Return a picture's frame."""
    return PanoramaFrame(grey=halved_grey(image), angles_rad=angles_rad, rates_rad_s=rates_rad_s)
