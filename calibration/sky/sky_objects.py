"""What stands out in a picture of the day's sky: small dark or bright objects, and the Moon's disc."""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray

# half the width of what counts as background, px
_BACKGROUND_PX = 40
_SMOOTH_PX = 3
_NOISE_SIGMAS = 6.0
_LEAST_CONTRAST = 3.0
_LEAST_AREA_PX, _MOST_EXTENT_PX = 4, 120
_BORDER_PX = 3
_MOST_OBJECTS = 30
# one sigma of an object's centre, px, and as a share of its extent: lit from one side, it is not where it seems to be
_SIGMA_PX, _SIGMA_SHARE = 0.3, 0.03
# of the disc's limb: points around it, how far they are looked for, and how many have to lie on one circle
_LIMB_POINTS = 180
_LIMB_SEARCH_PX = 6.0
_LIMB_NEAR_PX = 1.0
_LEAST_LIMB_SHARE = 0.35
# limb darkening, and air that trembles
_MOON_SIGMA_PX = 0.7
_LEAST_RADIUS_PX = 6.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyObjects:
    """Objects of one picture, the most striking first: ``pixel_px`` (n, 2), ``sigma_px`` (n,), ``extent_px`` (n,)."""

    pixel_px: FloatArray
    sigma_px: FloatArray
    extent_px: FloatArray

    def __len__(self) -> int:
        return len(self.sigma_px)


def find_objects(grey: FloatArray) -> SkyObjects:
    """Return the small objects of a picture (h, w) of grey levels, the strongest contrast first."""
    picture = np.asarray(grey, dtype=np.float32)
    off = cv2.blur(picture, (_SMOOTH_PX, _SMOOTH_PX)) - cv2.blur(picture, (2 * _BACKGROUND_PX + 1,) * 2)
    noise = 1.4826 * float(np.median(np.abs(off - np.median(off))))
    least = max(_NOISE_SIGMAS * noise, _LEAST_CONTRAST)
    strong = (np.abs(off) > least).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(strong, connectivity=8)
    h, w = picture.shape
    rows = []
    for label in range(1, count):
        x, y, wide, high, area = (int(n) for n in stats[label])
        extent = max(wide, high)
        inside = x >= _BORDER_PX and y >= _BORDER_PX and x + wide <= w - _BORDER_PX and y + high <= h - _BORDER_PX
        if area < _LEAST_AREA_PX or extent > _MOST_EXTENT_PX or not inside:
            continue
        own = labels[y : y + high, x : x + wide] == label
        weight = np.abs(off[y : y + high, x : x + wide]) * own
        total = float(weight.sum())
        u = x + float(weight.sum(axis=0) @ np.arange(wide)) / total
        v = y + float(weight.sum(axis=1) @ np.arange(high)) / total
        rows.append((total / np.sqrt(area), u, v, float(extent)))
    rows.sort(reverse=True)
    table = np.array(rows[:_MOST_OBJECTS]).reshape(-1, 4)
    return SkyObjects(
        pixel_px=table[:, 1:3],
        sigma_px=np.hypot(_SIGMA_PX, _SIGMA_SHARE * table[:, 3]),
        extent_px=table[:, 3],
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenMoon:
    """The Moon's centre in a picture, px, and its sigma along each axis."""

    pixel_px: tuple[float, float]
    sigma_px: float


def find_moon(grey: FloatArray, radius_px: float) -> SeenMoon | None:
    """Return the centre of the disc of a known radius by its lit limb; None where no such limb is in the picture."""
    if radius_px < _LEAST_RADIUS_PX:
        return None
    picture = cv2.GaussianBlur(np.asarray(grey, dtype=np.float32), (0, 0), 1.0)
    across, down = cv2.Sobel(picture, cv2.CV_32F, 1, 0) / 8.0, cv2.Sobel(picture, cv2.CV_32F, 0, 1) / 8.0
    steep = np.hypot(across, down)
    least = max(_NOISE_SIGMAS * 1.4826 * float(np.median(steep)), 0.5 * _LEAST_CONTRAST)
    v, u = np.nonzero(steep > least)
    if len(u) < radius_px or len(u) > steep.size // 4:
        return None
    # the disc is brighter than the sky: from each point of its limb its centre lies up the gradient
    towards = np.column_stack([across[v, u], down[v, u]]) / steep[v, u][:, None]
    voted = np.round(np.column_stack([u, v]) + radius_px * towards).astype(np.int64)
    h, w = picture.shape
    inside = np.all((voted >= 0) & (voted < (w, h)), axis=1)
    votes = np.zeros((h, w), dtype=np.float32)
    np.add.at(votes, (voted[inside, 1], voted[inside, 0]), 1.0)
    gathered = np.asarray(cv2.GaussianBlur(votes, (0, 0), max(1.0, 0.05 * radius_px)))
    best = np.unravel_index(int(np.argmax(gathered)), gathered.shape)
    start = np.array([float(best[1]), float(best[0])])
    return _by_limb(np.asarray(across, dtype=np.float64), np.asarray(down, dtype=np.float64), start, radius_px, least)


def _by_limb(
    across: FloatArray, down: FloatArray, centre: FloatArray, radius_px: float, least: float
) -> SeenMoon | None:
    """Return the centre by the steepest points along rays from it."""
    h, w = across.shape
    angle = np.linspace(0.0, 2.0 * np.pi, _LIMB_POINTS, endpoint=False)
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    search = np.arange(-_LIMB_SEARCH_PX, _LIMB_SEARCH_PX + 0.25, 0.5)
    kept, off = np.zeros(_LIMB_POINTS, dtype=np.bool_), np.zeros(_LIMB_POINTS)
    for _ in range(5):
        at = centre + ray[:, None, :] * (radius_px + search)[None, :, None]
        u, v = (np.asarray(at[..., k], dtype=np.float32) for k in (0, 1))
        inside = (u > 1) & (v > 1) & (u < w - 2) & (v < h - 2)
        # outwards it darkens
        falling = -(
            cv2.remap(np.asarray(across, dtype=np.float32), u, v, cv2.INTER_LINEAR) * ray[:, :1]
            + cv2.remap(np.asarray(down, dtype=np.float32), u, v, cv2.INTER_LINEAR) * ray[:, 1:]
        )
        falling[~inside] = 0.0
        best = np.clip(np.argmax(falling, axis=1), 1, len(search) - 2)
        rows = np.arange(_LIMB_POINTS)
        before, top, after = (falling[rows, best + k] for k in (-1, 0, 1))
        bow = np.maximum(2.0 * top - before - after, 1e-9)
        off = search[best] + 0.5 * np.clip(0.5 * (after - before) / bow, -0.5, 0.5)
        kept = top > least
        if int(kept.sum()) < _LEAST_LIMB_SHARE * _LIMB_POINTS:
            return None
        middle = off[kept] - ray[kept] @ np.linalg.lstsq(ray[kept], off[kept], rcond=None)[0]
        kept[np.flatnonzero(kept)] = np.abs(middle - np.median(middle)) < 2.0 * _LIMB_NEAR_PX
        centre = centre + np.linalg.lstsq(ray[kept], off[kept], rcond=None)[0]
    left = off[kept] - ray[kept] @ np.linalg.lstsq(ray[kept], off[kept], rcond=None)[0]
    good = int(np.count_nonzero(np.abs(left) < _LIMB_NEAR_PX))
    if good < _LEAST_LIMB_SHARE * _LIMB_POINTS:
        return None
    return SeenMoon(pixel_px=(float(centre[0]), float(centre[1])), sigma_px=_MOON_SIGMA_PX)
