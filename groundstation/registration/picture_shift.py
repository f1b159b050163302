"""Global image motion since the last frame (pan, tilt or shake of the camera), and detection of cuts.

The shift is measured on small grey copies by the motion of corners, those of the target left out. An even sky
has no corners; then the result is None.
"""

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box

REDUCTION = 4
_CORNERS, _QUALITY, _APART_PX = 60, 0.05, 6
_PATCH, _LEAST_TEXTURE = 5, 5.0  # px of the copy; grey levels, standard deviation
_LEAST_CORNERS = 8
_AGREE_PX, _AGREE_SHARE = 0.7, 0.6  # share of the corners that agree on the motion, to so many px of the copy
_WINDOW, _LEVELS = (11, 11), 3
_MARGIN_PX = 3  # around the target, px of the copy
_BIN = 8  # grey levels
_OTHER_GREYS, _ALL_OTHER_GREYS = 0.08, 0.3  # share of the pixels that changed their bin of the histogram
_ALIKE = 0.7  # correlation


def small_copy(image: ImageArray) -> ImageArray:
    """Return the green of a picture (h, w, 3), four times smaller: (h // 4, w // 4)."""
    h, w = image.shape[:2]
    size = (max(w // REDUCTION, 1), max(h // REDUCTION, 1))
    # every second pixel is enough to average over
    half = np.ascontiguousarray(image[::2, ::2, 1])
    return np.asarray(cv2.resize(half, size, interpolation=cv2.INTER_AREA), np.uint8)


def picture_shift(old: ImageArray, new: ImageArray, target_box: Box[float]) -> FloatArray | None:
    """Return the motion (2,) of the scene between two small copies, in px of the full image; None if unobservable.

    ``target_box``, in the old full image, is left out: the target has its own motion.
    """
    h, w = old.shape
    mask = np.full((h, w), 255, np.uint8)
    x, y, right, bottom = (v / REDUCTION for v in target_box)
    x0, y0 = max(int(x) - _MARGIN_PX, 0), max(int(y) - _MARGIN_PX, 0)
    mask[y0 : max(int(bottom) + _MARGIN_PX + 1, 0), x0 : max(int(right) + _MARGIN_PX + 1, 0)] = 0
    best = cv2.goodFeaturesToTrack(old, _CORNERS, _QUALITY, _APART_PX, mask=mask)
    found = np.zeros((0, 1, 2), np.float32) if best is None else np.asarray(best, np.float32)
    mean = cv2.blur(old.astype(np.float32), (_PATCH, _PATCH))
    square = cv2.blur(old.astype(np.float32) ** 2, (_PATCH, _PATCH))
    columns, rows = found.reshape(-1, 2).astype(np.intp).T
    # on a plain sky the best corners are noise
    corners = found[(square - mean**2)[rows, columns] >= _LEAST_TEXTURE**2]
    if len(corners) < _LEAST_CORNERS:
        return None
    moved, good, _ = cv2.calcOpticalFlowPyrLK(
        old, new, corners, np.empty_like(corners), winSize=_WINDOW, maxLevel=_LEVELS
    )
    steps = (moved - corners).reshape(-1, 2)[good.ravel() == 1]
    if len(steps) < _LEAST_CORNERS:
        return None
    agree = np.hypot(*(steps - np.median(steps, axis=0)).T) < _AGREE_PX
    if int(agree.sum()) < max(_LEAST_CORNERS, _AGREE_SHARE * len(corners)):
        return None
    return np.asarray(REDUCTION * steps[agree].mean(axis=0), np.float64)


def is_cut(old: ImageArray, new: ImageArray) -> bool:
    """Return whether two small copies show different scenes: a pan moves the scene, a cut replaces it."""
    bins = 256 // _BIN
    before, after = (np.bincount((c // _BIN).ravel(), minlength=bins) / c.size for c in (old, new))
    changed = 0.5 * float(np.abs(after - before).sum())
    if changed < _OTHER_GREYS:
        return False
    if changed > _ALL_OTHER_GREYS:
        return True
    a, b = old.astype(np.float64) - old.mean(), new.astype(np.float64) - new.mean()
    return float((a * b).sum()) < _ALIKE * float(np.sqrt((a * a).sum() * (b * b).sum()))
