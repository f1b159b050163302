"""Where the strip between the tracked edges ends: a pose that is a little wrong moves both thresholds up or down alike.

Between the edges the ground looks other than beside them; beyond a threshold it does not. Paint lies inside, and a road
that crosses looks alike on both sides of an edge line, so neither is taken for the end.
"""

import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter1d

from groundstation.arrays import FloatArray

_STEP_PX = 0.5
# of all differences seen, what an end must make at least; and of the strongest end, the last one
_LEAST_SHARE, _LAST_SHARE = 0.2, 0.35
# grey levels, summed over channels and both sides: less is noise
_LEAST_LEVELS = 5.0
# across the strip in half widths: inside, and on either side
_INSIDE = np.linspace(-0.7, 0.7, 15)
_BESIDE = np.concatenate([np.linspace(-2.0, -1.35, 8), np.linspace(1.35, 2.0, 8)])


def strip_end_shift(
    image: FloatArray, corners_px: FloatArray, reach_px: float, window_px: float, far: bool = False
) -> float | None:
    """Return by how many rows a threshold lies below its predicted place, or None where nothing ends there.

    Parameters
    ----------
    image : (h, w) or (h, w, channels) brightness.
    corners_px : (4, 2) predicted, as `runway.CORNERS`, on the tracked edges.
    reach_px : how far up and down to look. window_px : rows above and below an end that are compared.
    far : the far threshold instead of the near one.
    """
    shifts = np.arange(-reach_px - window_px, reach_px + window_px + 0.5 * _STEP_PX, _STEP_PX)
    differences = _differences(np.atleast_3d(image), corners_px, shifts, far)
    count = max(round(window_px / _STEP_PX), 2)
    drops = np.zeros(len(shifts))
    for k in np.flatnonzero(np.abs(shifts) <= reach_px):
        above, below = differences[max(k - count, 0) : k], differences[k + 1 : k + 1 + count]
        if len(above) == count == len(below) and np.isfinite(above).all() and np.isfinite(below).all():
            drops[k] = (np.median(above) - np.median(below)) * (-1.0 if far else 1.0)
    spread = float(np.ptp(differences[np.isfinite(differences)])) if np.isfinite(differences).any() else 0.0
    if drops.max() <= max(_LEAST_SHARE * spread, _LEAST_LEVELS):
        return None
    # a slab of another colour before the asphalt ends too: the last end is the runway's
    strong = np.flatnonzero((drops == maximum_filter1d(drops, count)) & (drops > _LAST_SHARE * drops.max()))
    return float(shifts[strong[0 if far else -1]])


def _differences(image: FloatArray, corners_px: FloatArray, shifts: FloatArray, far: bool) -> FloatArray:
    """Return for each row (n,) how differently it looks between the edges and beside them; NaN out of the picture."""
    near_left, far_left, far_right, near_right = corners_px
    rows = []
    for low, high in ((near_left, far_left), (near_right, far_right)):
        along = (low - high) / (low[1] - high[1])
        rows.append((high if far else low) + shifts[:, None] * along)
    left, right = rows
    middle, half = 0.5 * (left + right), 0.5 * (right - left)
    out = np.zeros(len(shifts))
    for channel in range(image.shape[2]):
        inside = _across(image[..., channel], middle, half, _INSIDE)
        for side in (_BESIDE[_BESIDE < 0.0], _BESIDE[_BESIDE > 0.0]):
            beside = _across(image[..., channel], middle, half, side).mean(axis=1)
            # sample by sample: white bars on dark asphalt are on average like sand
            out += np.abs(inside - beside[:, None]).mean(axis=1)
    return out


def _across(channel: FloatArray, middle: FloatArray, half: FloatArray, across: FloatArray) -> FloatArray:
    points = middle[:, None] + across[None, :, None] * half[:, None]
    values = map_coordinates(channel, [points[..., 1], points[..., 0]], order=1, cval=np.nan)
    return np.asarray(values, dtype=np.float64)
