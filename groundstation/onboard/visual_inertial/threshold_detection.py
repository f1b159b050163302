"""Detection of a threshold: along both tracked edges, the position where the ground between them stops differing
from the ground next to them.

Between the edges there is pavement, next to them there is not; before the near threshold and behind the far one both
are the same ground. Paint is inside, a slab of another colour still differs from the grass, and a road that crosses is
the same on both sides of an edge line: none of them is taken for the end. A threshold is *confirmed* only if the
difference rises, on both sides at one place, clearly above the noise, and is beyond it as far outside.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter1d, map_coordinates

from groundstation.arrays import FloatArray, ImageArray

_STEP_PX = 0.5
_SMOOTH_PX = 0.5
# weight of differences of colours next to brightness
_COLOUR = 2.0
# rows outside that show what no runway looks like, as far as the picture goes
_FLOOR_PX = 14.0
# across the strip in half widths: inside, and next to it on either side
_INSIDE = np.linspace(-0.85, 0.85, 18)
_BESIDE = np.linspace(1.35, 2.2, 9)
_COLUMNS = np.concatenate([-_BESIDE[::-1], _INSIDE, _BESIDE])
# the difference outside, just there and as far as the end was looked for, of what the pavement farther inside differs
# by (or of that just inside, if that is less): more is a bar's end or a change of pavement, not the pavement's end
_MOST_LEFT = 0.3
# rows farther inside that show what the pavement looks like, and how far on at most, of the runway's height
_PAVEMENT_PX, _PAVEMENT_SHARE = 14.0, 0.3
# of the strongest end, what another must have to be preferred for lying farther out
_LEAST_SHARE = 0.3
# rise over its noise, of both sides together and of each
_LEAST_RISE, _LEAST_SIDE = 5.0, 2.0
# the two sides' ends, in rows: farther apart they are not one threshold
_MOST_APART = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectedThreshold:
    """A confirmed threshold.

    ``shift_px`` (2,) and ``sigma_px`` (2,): rows by which it is below its prediction on the left and on the right
    edge; ``rise``: the difference over its noise; ``levels``: the difference in grey levels over all channels.
    """

    shift_px: FloatArray
    sigma_px: FloatArray
    rise: float
    levels: float


def detect_threshold(
    image: ImageArray, corners_px: FloatArray, reach_px: float, window_px: float, *, far: bool = False
) -> DetectedThreshold | None:
    """Return the position of a threshold, or None where none is confirmed within reach.

    Parameters
    ----------
    image : (h, w, 3) uint8 BGR, or (h, w, 1).
    corners_px : (4, 2) predicted, as `runway.CORNERS`, on the tracked edges.
    reach_px : how far up and down from the prediction it may lie. window_px : rows on either side that are compared.
    far : the far threshold instead of the near one.
    """
    margin = reach_px + max(window_px, _FLOOR_PX)
    # outward: down the picture for the near threshold, up for the far one
    height = abs(float(corners_px[[0, 3], 1].mean() - corners_px[[1, 2], 1].mean()))
    inward = reach_px + window_px + min(_PAVEMENT_PX, _PAVEMENT_SHARE * height)
    outward = np.arange(-inward, margin + 0.5 * _STEP_PX, _STEP_PX)
    shifts = -outward if far else outward
    sides = _differences(image, corners_px, shifts, far)
    usable = np.asarray(np.isfinite(sides).all(axis=0))
    count = max(round(window_px / _STEP_PX), 3)
    if not usable[: 2 * count].all() or usable.sum() < 2 * count + 4:
        return None
    last = int(np.argmin(usable)) if not usable.all() else usable.size
    sides, outward = sides[:, :last], outward[:last]
    both = sides.sum(axis=0)
    floor = both[outward > reach_px] if (outward > reach_px).sum() >= 6 else both[-max(count, 6) :]
    level, noise = float(np.median(floor)), _spread(floor)
    k = _end(both, outward, count, reach_px, level)
    if k is None:
        return None
    rise = float(np.median(both[k - count : k])) - level
    if rise < _LEAST_RISE * noise:
        return None
    on_left, on_right = (_crossing(side, outward, k, count) for side in sides)
    if on_left is None or on_right is None:
        return None
    (left, left_sigma), (right, right_sigma) = on_left, on_right
    if abs(left - right) > _MOST_APART + 2.0 * float(np.hypot(left_sigma, right_sigma)):
        return None
    sign = -1.0 if far else 1.0
    return DetectedThreshold(
        shift_px=sign * np.array([left, right]),
        sigma_px=np.array([left_sigma, right_sigma]),
        rise=rise / max(noise, 1e-9),
        levels=rise,
    )


def _end(both: FloatArray, outward: FloatArray, count: int, reach: float, level: float) -> int | None:
    """Return the number of the row where the difference ends, None where it ends nowhere or only changes."""
    drops = np.zeros(len(both))
    rows = [k for k in range(count, len(both) - count) if abs(outward[k]) <= reach]
    last = int(np.searchsorted(outward, reach))
    # of as many rows from each row on
    windows = np.median(sliding_window_view(both, count), axis=1)
    for k in rows:
        inside, outside = float(windows[k - count]), float(windows[k + 1])
        if outside - level > _MOST_LEFT * (inside - level):
            # the wider medians below make it no better
            continue
        pavement = float(np.median(both[: k - count])) if k >= 2 * count else inside
        beyond = float(np.median(both[k + 1 : max(last, k + 1 + count)]))
        # beyond the end nothing is left
        if max(outside, beyond) - level <= _MOST_LEFT * (min(inside, pavement) - level):
            drops[k] = inside - outside
    if drops.max() <= 0.0:
        return None
    strong = np.flatnonzero(drops > _LEAST_SHARE * drops.max())
    # of the outermost run of strong ones the strongest
    runs = np.split(strong, np.flatnonzero(np.diff(strong) > 1) + 1)
    return int(runs[-1][np.argmax(drops[runs[-1]])])


def _crossing(side: FloatArray, outward: FloatArray, k: int, count: int) -> tuple[float, float] | None:
    """Return where one side's difference crosses half its height next to row ``k``, and its sigma; None where faint."""
    smooth = gaussian_filter1d(side, _SMOOTH_PX / _STEP_PX)
    inside, outside = float(np.median(side[k - count : k])), float(np.median(side[k + 1 : k + 1 + count]))
    noise = _spread(side[k + 2 :])
    if inside - outside < _LEAST_SIDE * noise:
        return None
    half = 0.5 * (inside + outside)
    window = range(max(k - count, 0), min(k + count, len(side) - 1))
    crossings = [m for m in window if smooth[m] >= half > smooth[m + 1]]
    if not crossings:
        return None
    m = min(crossings, key=lambda i: abs(i - k))
    fall = float(smooth[m] - smooth[m + 1])
    place = float(outward[m]) + _STEP_PX * float(smooth[m] - half) / fall
    # the steepest a blurred end can be seen is its height over two rows
    slope = max(fall / _STEP_PX, 0.25 * (inside - outside))
    return place, noise / slope


def _sampled(image: ImageArray, points: FloatArray) -> list[FloatArray]:
    """Return each channel (n, m) at points (n, m, 2), NaN out of the picture."""
    places = [points[..., 1], points[..., 0]]
    return [
        map_coordinates(image[..., k], places, output=np.float64, order=1, cval=np.nan) for k in range(image.shape[2])
    ]


def _by_colour(channels: list[FloatArray]) -> list[FloatArray]:
    """Return brightness and two differences of colours, weighed: light and shade change brightness more than colour."""
    if len(channels) < 3:
        return channels
    blue, green, red = channels[:3]
    return [(blue + green + red) / 3.0, _COLOUR * (red - blue), _COLOUR * (green - 0.5 * (red + blue))]


def _spread(values: FloatArray) -> float:
    """Return a robust sigma."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) + 1e-9


def _differences(image: ImageArray, corners_px: FloatArray, shifts: FloatArray, far: bool) -> FloatArray:
    """Return (2, n): how differently each row looks inside and next to, left and right; NaN out of the picture."""
    near_left, far_left, far_right, near_right = corners_px
    ends = []
    for low, high in ((near_left, far_left), (near_right, far_right)):
        along = (low - high) / (low[1] - high[1])
        ends.append((high if far else low) + shifts[:, None] * along)
    middle, half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    points = middle[:, None] + _COLUMNS[None, :, None] * half[:, None]
    b, i = len(_BESIDE), len(_INSIDE)
    out = np.zeros((2, len(shifts)))
    for seen in _by_colour(_sampled(image, points)):
        inside = seen[:, b : b + i]
        for number, outside in enumerate((seen[:, :b], seen[:, b + i :])):
            # sample by sample: white bars on dark asphalt are on average like sand
            mine = inside[:, : i // 2] if number == 0 else inside[:, i // 2 :]
            out[number] += np.abs(mine - np.median(outside, axis=1)[:, None]).mean(axis=1)
    return out
