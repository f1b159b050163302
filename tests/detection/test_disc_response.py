"""Where a silhouette is thickest: the disc's running sums against OpenCV's filter."""

import cv2
import numpy as np
import pytest

from groundstation.detection.disc_response import disc_kernel, disc_maximum, filled_share


@pytest.mark.parametrize("steps", [12, 25, 30, 47, 90])
@pytest.mark.parametrize("size", [(40, 70), (9, 120), (3, 2), (1, 1)])
def test_the_share_of_a_disc_that_is_filled_is_the_filters(
    steps: int, size: tuple[int, int], rng: np.random.Generator
) -> None:
    """Pictures smaller than the disc, empty rows and whole rows included."""
    membership = rng.random(size).astype(np.float32)
    membership[size[0] // 3 : size[0] // 2] = 0
    membership[-1] = 1
    disc = disc_kernel(steps)
    expected = cv2.filter2D(membership, cv2.CV_32F, disc, borderType=cv2.BORDER_CONSTANT)
    np.testing.assert_allclose(filled_share(membership, disc), expected, rtol=0, atol=5e-6)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_the_thickest_place_of_a_disc_on_a_wing_is_the_discs_middle(angle: float) -> None:
    """A thin wing through it, level or banked, does not draw it away."""
    y, x = np.mgrid[0:60, 0:120]
    along = (x - 58.0) * np.cos(angle) + (y - 31.0) * np.sin(angle)
    across = (y - 31.0) * np.cos(angle) - (x - 58.0) * np.sin(angle)
    silhouette = (np.hypot(along, across) < 6) | ((abs(along) < 45) & (abs(across) < 1.5))
    place = disc_maximum(silhouette.astype(np.float32), 6.0)
    np.testing.assert_allclose(place, [58.0, 31.0], atol=0.1)
