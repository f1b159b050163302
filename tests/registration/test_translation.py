"""A shift of the scene is found to a small part of a pixel, and what it leaves is measured."""

import cv2
import numpy as np
import pytest

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.registration import translation as reg

NOWHERE = Box(0, 0, 0, 0)
WINDOW = Box(40, 30, 200, 130)


def scene(rng: np.random.Generator) -> ImageArray:
    texture = cv2.GaussianBlur(rng.normal(0, 60, (180, 260)), (0, 0), 2.0)
    return np.clip(np.repeat((120 + 2 * texture)[:, :, None], 3, axis=2), 0, 255).astype(np.uint8)


def moved(image: ImageArray, dx: float, dy: float) -> ImageArray:
    under = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]])
    size = (image.shape[1], image.shape[0])
    shifted = cv2.warpAffine(
        image, under, size, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT
    )
    return np.asarray(shifted, np.uint8)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.4, -0.3), (1.7, 1.2)])
def test_small_shifts_to_a_tenth_of_a_pixel(rng: np.random.Generator, shift: tuple[float, float]) -> None:
    reference = scene(rng)
    rows = reg.textured(moved(reference, *shift), WINDOW, NOWHERE)
    sx, sy, sigma = reg.refine(rows, reg.grey_of(reference), NOWHERE, 0.0, 0.0)
    assert (sx, sy) == pytest.approx(shift, abs=0.1)
    assert sigma < 0.1


def test_a_large_shift_needs_the_raster(rng: np.random.Generator) -> None:
    reference = scene(rng)
    rows = reg.textured(moved(reference, 22.0, -17.0), WINDOW, NOWHERE)
    start = reg.coarse(rows, reg.grey_of(reference), NOWHERE, 0.0, 0.0)
    assert start == pytest.approx((22.0, -17.0), abs=4.0)
    sx, sy, _ = reg.refine(rows, reg.grey_of(reference), NOWHERE, *start)
    assert (sx, sy) == pytest.approx((22.0, -17.0), abs=0.15)


def test_a_plain_sky_has_no_texture_for_registration(rng: np.random.Generator) -> None:
    sky = (180 + rng.normal(0, 1, (180, 260, 3))).astype(np.uint8)
    rows = reg.textured(sky, WINDOW, NOWHERE)
    assert rows.shape[0] < reg.MIN_TEXTURED
    assert reg.refine(rows, reg.grey_of(sky), NOWHERE, 0.0, 0.0)[2] > 1e6


def test_misplacement_is_measured_by_how_misfits_grow_with_the_gradient(rng: np.random.Generator) -> None:
    reference = scene(rng)
    rows = reg.textured(reference, WINDOW, NOWHERE)
    measured = [reg.misplacement(rows, reg.grey_of(reference), NOWHERE, s, 0.0) for s in (0.0, 0.18, 1.0)]
    assert measured[0] < measured[1] < measured[2] == reg.MAX_EDGE_PX
