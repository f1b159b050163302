"""Detection of motion against the static scene for a turning camera.

Older frames are laid under the newest one. What differs from all of them in the same sense, by more than noise
and a fraction of a pixel of misplacement explain, has moved: with two old frames of different age only the
place where something is now differs from both, the places where it was do not.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.camera import Lens
from groundstation.registration.frame_alignment import TurningView, align, image_motion, textured, widespread

Float32Array = NDArray[np.float32]

_NOISE = 1.2  # grey levels, one sigma of one image
_BLOCK_PX, _BLOCK_MEDIAN = 16, 5  # raster on which drift and common change are measured, and its median window
_RIM = np.ones((5, 5), np.uint8)
_MIDDLE = 1.0 / 3.0  # age of the second old frame, as a share of the first's


@dataclass(slots=True, kw_only=True, eq=False)
class _KeptFrame:
    """An earlier frame: ``grey`` (h, w), its rotation if known, and the homography from it to the newest frame.

    ``known`` is ``grey`` without zeros: in a warped picture 0 marks pixels outside it.
    """

    t_s: float
    grey: ImageArray
    known: ImageArray
    camera_from_runway: FloatArray | None
    newest_from_this: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BackgroundChange:
    """How much each pixel differs from the static scene: ``significance`` (h, w) float32, signed, in sigmas.

    ``earlier`` is the picture of ``age_s`` ago laid under the newest one, 0 where it shows nothing.
    """

    significance: Float32Array
    earlier: ImageArray
    age_s: float


class SceneModel:
    """Some seconds of one camera's frames, each with its place under the newest one.

    Parameters
    ----------
    size : (w, h) of the working images.
    scale : size of a working pixel in px of the full image.
    memory_s, spacing_s : how far back, and at what spacing frames are kept.
    limit_px : how far, in working px, the measured motion may be from the predicted one.
    """

    def __init__(
        self,
        size: tuple[int, int],
        scale: float,
        lens: Lens | None,
        *,
        memory_s: float,
        spacing_s: float,
        limit_px: float,
    ) -> None:
        self._view = None if lens is None else TurningView(lens, scale, size)
        self._memory_s, self._spacing_s, self._limit_px = memory_s, spacing_s, limit_px
        self._kept: deque[_KeptFrame] = deque()
        self._last: _KeptFrame | None = None
        self._rotation: FloatArray | None = None

    def reset(self) -> None:
        """Forget all frames."""
        self._kept.clear()
        self._last = None

    def change(self, grey: ImageArray, t_s: float, camera_from_runway: FloatArray | None) -> BackgroundChange | None:
        """Take the newest frame and return what differs from the scene; None while there is nothing to compare.

        A frame that is not newer than the last one starts the memory afresh.
        """
        if self._last is not None and t_s <= self._last.t_s:
            self.reset()
        self._rotation = camera_from_runway
        self._carry_over(grey)
        while self._kept and t_s - self._kept[0].t_s > self._memory_s:
            self._kept.popleft()
        result = self._difference(grey, t_s)
        newest = _KeptFrame(
            t_s=t_s,
            grey=grey,
            known=np.maximum(grey, np.uint8(1)),
            camera_from_runway=camera_from_runway,
            newest_from_this=np.eye(3),
        )
        if not self._kept or t_s - self._kept[-1].t_s >= self._spacing_s:
            self._kept.append(newest)
        self._last = newest
        return result

    def _carry_over(self, grey: ImageArray) -> None:
        """Follow the motion of the picture where no angles are given; clear the memory where it is not found."""
        if not self._kept or self._last is None or all(self._turned(k) is not None for k in self._kept):
            return
        step = image_motion(self._last.grey, grey)
        if step is None:
            self._kept.clear()
            return
        for kept in self._kept:
            kept.newest_from_this = step @ kept.newest_from_this

    def _turned(self, kept: _KeptFrame) -> FloatArray | None:
        """Return the rotation from a kept frame's camera to the newest one's, None if one of them is unknown."""
        if self._view is None or self._rotation is None or kept.camera_from_runway is None:
            return None
        return np.asarray(self._rotation @ kept.camera_from_runway.T, np.float64)

    def _difference(self, grey: ImageArray, t_s: float) -> BackgroundChange | None:
        """Compare with the oldest frame and with a younger one."""
        if not self._kept:
            return None
        oldest = self._kept[0]
        wanted_s = t_s - _MIDDLE * (t_s - oldest.t_s)
        middle = min(self._kept, key=lambda k: abs(k.t_s - wanted_s))
        rows = textured(grey)
        if not widespread(rows, grey.shape[1], grey.shape[0]):
            rows = rows[:0]
        slope = _steepness(grey)
        recent = self._against(grey, middle, rows, slope)
        old = None if middle is oldest else self._against(grey, oldest, rows, slope)
        if recent is None or old is None:
            one, kept = (recent, middle) if recent is not None else (old, oldest)
            if one is None:
                return None
            return BackgroundChange(significance=one.significance, earlier=one.earlier, age_s=t_s - kept.t_s)
        agreed = _agreed(old.significance, old.earlier, recent.significance, recent.earlier)
        return BackgroundChange(significance=agreed, earlier=recent.earlier, age_s=t_s - middle.t_s)

    def _against(
        self, grey: ImageArray, kept: _KeptFrame, rows: FloatArray, slope: ImageArray
    ) -> BackgroundChange | None:
        """Compare with one kept frame, and remember how it fitted; None where it shows another part of the scene."""
        turned = self._turned(kept)
        predicted: FloatArray | None = kept.newest_from_this
        if turned is not None and self._view is not None:
            predicted = self._view.homography(turned)
        if predicted is None:
            return None
        fit = align(rows, kept.grey, _inverse(predicted), self._limit_px)
        kept.newest_from_this = _inverse(fit.old_from_new)
        h, w = grey.shape
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        laid = np.asarray(cv2.warpPerspective(kept.known, fit.old_from_new, (w, h), flags=flags), np.uint8)
        # the rims of both pictures are mixed with the nothing beyond them
        shown = cv2.erode((laid > 0).astype(np.uint8), _RIM, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        covered = laid * np.asarray(shown, np.uint8)
        return BackgroundChange(
            significance=_significance(grey, covered, slope, fit.misplaced_px), earlier=covered, age_s=0.0
        )


def _inverse(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(matrix), np.float64)


def _steepness(grey: ImageArray) -> ImageArray:
    """Return twice the largest gradient around each pixel, grey levels per px."""
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.subtract(cv2.dilate(grey, kernel), cv2.erode(grey, kernel)), np.uint8)


def _significance(grey: ImageArray, laid: ImageArray, slope: ImageArray, misplaced_px: float) -> Float32Array:
    """Return the difference in sigmas of noise, misplacement and what changes around it anyway."""
    # a slow change of brightness is not motion
    drift = cv2.medianBlur(_block_means(grey, laid, np.zeros((1, 1), np.float32), False), _BLOCK_MEDIAN)
    common = cv2.medianBlur(_block_means(grey, laid, np.asarray(drift, np.float32), True), _BLOCK_MEDIAN)
    return _in_sigmas(grey, laid, slope, np.asarray(drift, np.float32), np.asarray(common, np.float32), misplaced_px)


@njit(cache=True, nogil=True)
def _block_means(grey: ImageArray, laid: ImageArray, drift: Float32Array, absolute: bool) -> Float32Array:
    """Return the mean of the difference, or of its size without the drift, in blocks; 0 where nothing is known."""
    h, w = grey.shape
    rows, columns = -(-h // _BLOCK_PX), -(-w // _BLOCK_PX)
    means = np.empty((rows, columns), np.float32)
    # every second pixel of every second row is enough; column by column, so that the compiler works on many at once
    total, seen = np.empty((w + 1) // 2, np.float32), np.empty((w + 1) // 2, np.int32)
    away, nothing = np.zeros(total.size, np.float32), np.float32(0)
    half = _BLOCK_PX // 2
    for y in range(rows):
        total[:], seen[:] = 0, 0
        for x in range(columns if absolute else 0):
            away[x * half : (x + 1) * half] = drift[y, x]
        for i in range(y * _BLOCK_PX, min((y + 1) * _BLOCK_PX, h), 2):
            new, old = grey[i], laid[i]
            for k in range(total.size):
                d = np.float32(new[2 * k]) - np.float32(old[2 * k]) - away[k]
                known = old[2 * k] > 0
                total[k] += (abs(d) if absolute else d) if known else nothing
                seen[k] += known
        for x in range(columns):
            part = slice(x * half, (x + 1) * half)
            means[y, x] = total[part].sum() / np.float32(max(seen[part].sum(), 1))
    return means


@njit(cache=True, nogil=True, error_model="numpy")
def _in_sigmas(
    grey: ImageArray,
    laid: ImageArray,
    slope: ImageArray,
    drift: Float32Array,
    common: Float32Array,
    misplaced_px: float,
) -> Float32Array:
    """Return the difference without the drift over its sigma; what noise alone explains is 0."""
    h, w = grey.shape
    out = np.empty((h, w), np.float32)
    noise = np.float32(2.0 * _NOISE**2)
    half = np.float32(0.5 * misplaced_px)
    ignored, nothing = np.float32(1.5 * np.sqrt(noise)), np.float32(0)
    for i in range(h):
        y = i // _BLOCK_PX
        for x in range(drift.shape[1]):
            first, last = x * _BLOCK_PX, min((x + 1) * _BLOCK_PX, w)
            # of one block at a time, and without a condition that skips: so the compiler works on many pixels at once
            new, old, steep, to = grey[i, first:last], laid[i, first:last], slope[i, first:last], out[i, first:last]
            away, anyway = drift[y, x], np.float32(1.4) * common[y, x]
            floor = noise + anyway * anyway
            for j in range(last - first):
                d = np.float32(new[j]) - np.float32(old[j]) - away
                a = half * np.float32(steep[j])
                sigmas = d / np.sqrt(floor + a * a)
                to[j] = nothing if (old[j] == 0) | (abs(d) < ignored) else sigmas
    return out


@njit(cache=True, nogil=True)
def _agreed(first: Float32Array, seen_first: ImageArray, second: Float32Array, seen_second: ImageArray) -> Float32Array:
    """Return the smaller of two significances of one sign, otherwise 0; without a value in one, the other is used."""
    out = np.empty_like(first)
    nothing = np.float32(0)
    for i in range(first.shape[0]):
        one, other, to = first[i], second[i], out[i]
        seen_one, seen_other = seen_first[i], seen_second[i]
        for j in range(one.size):
            a, b = one[j], other[j]
            # above 0 in both, or below 0 in both
            agreed = max(min(a, b), nothing) + min(max(a, b), nothing)
            either = a if seen_other[j] == 0 else agreed
            to[j] = b if seen_one[j] == 0 else either
    return out
