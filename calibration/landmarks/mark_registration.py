"""A landmark's pixel in a picture, from another picture in which it is known: by the motion of the image around it.

A patch around the mark is searched for in the whole picture by normalised correlation, then its shift is refined by
the registration of `groundstation.registration.translation`, which states the sigma.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, clip
from groundstation.registration.translation import Float32Array, grey_of, refine, textured

# half the side of the patch, px: a mark and what is close to it, which moves as it does
HALF_PX = 32
# a patch that the search finds elsewhere is less like it than this: sky, grass, a row of equal posts
_LEAST_CORRELATION = 0.7
_LEAST_LEAD = 0.05
# peaks that close are one
_APART_PX = 8
# worse than this a row says little of the angles of a head
_MAX_SIGMA_PX = 0.3
# the interpolation between pixels, and their noise, leave about this
_MIN_SIGMA_PX = 0.02
# the correlation's peak is within a pixel
_MAX_REFINED_PX = 2.0
_NOTHING: Box[int] = Box(0, 0, 0, 0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MarkReference:
    """A picture (h, w, 3) BGR, and the pixel (2,) u, v of a landmark's mark in it."""

    image: ImageArray
    pixel_px: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegisteredMark:
    """The mark's pixel (2,) in a further picture, and one sigma of each coordinate relative to the reference, px."""

    pixel_px: FloatArray
    sigma_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NoRegisteredMark:
    """The mark was not found, and why."""

    reason: str


def register_mark(reference: MarkReference, image: ImageArray) -> RegisteredMark | NoRegisteredMark:
    """Find a mark in a picture (h, w, 3) BGR of the same camera."""
    h, w = reference.image.shape[:2]
    u, v = (round(float(c)) for c in reference.pixel_px)
    patch = clip(Box(u - HALF_PX, v - HALF_PX, u + HALF_PX + 1, v + HALF_PX + 1), (w, h))
    if patch is None or image.shape != reference.image.shape:
        return NoRegisteredMark(reason="its reference is another camera's picture")
    grey, reference_grey = grey_of(np.ascontiguousarray(image)), grey_of(np.ascontiguousarray(reference.image))
    if float(reference_grey[patch.slices].std()) < 1.0:
        return NoRegisteredMark(reason="nothing but an even area around it")
    place = _search(grey, reference_grey[patch.slices])
    if isinstance(place, NoRegisteredMark):
        return place
    x, y = place
    window: Box[int] = Box(x, y, x + patch.w, y + patch.h)
    rows = textured(image, window, _NOTHING)
    start = (float(patch.x0 - x), float(patch.y0 - y))
    shift_x, shift_y, sigma = refine(rows, reference_grey, _NOTHING, *start)
    if sigma > _MAX_SIGMA_PX:
        return NoRegisteredMark(reason="too little texture around it to tell its place")
    if max(abs(shift_x - start[0]), abs(shift_y - start[1])) > _MAX_REFINED_PX:
        return NoRegisteredMark(reason="what is around it has changed")
    pixel = reference.pixel_px - np.array([shift_x, shift_y])
    return RegisteredMark(pixel_px=pixel, sigma_px=max(float(sigma), _MIN_SIGMA_PX))


def _search(grey: Float32Array, patch: Float32Array) -> tuple[int, int] | NoRegisteredMark:
    """Return the column and row at which a patch fits best, if it does so at one place alone."""
    fit = cv2.matchTemplate(grey, patch, cv2.TM_CCOEFF_NORMED)
    _, best, _, (x, y) = cv2.minMaxLoc(fit)
    if best < _LEAST_CORRELATION:
        return NoRegisteredMark(reason="not in the picture, or it looks different now")
    fit[max(y - _APART_PX, 0) : y + _APART_PX + 1, max(x - _APART_PX, 0) : x + _APART_PX + 1] = -1.0
    if float(fit.max()) > best - _LEAST_LEAD:
        return NoRegisteredMark(reason="several places look alike")
    return x, y


def row_sigmas(registered_px: Sequence[float], picked_px: float) -> list[float]:
    """Return the sigma to state for each row of a stop, px.

    Each row has its own error of registration; that of the pixel picked by hand is shared by all n. A weighted mean
    treats rows as independent: with n times the shared variance in each its variance is right.
    """
    n = len(registered_px)
    return [float(np.sqrt(own**2 + n * picked_px**2)) for own in registered_px]
