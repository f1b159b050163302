"""The block median takes away shading and edges and leaves what is small."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.detection.flatten import flatten

SIZE = (90, 200)


def shaded(rng: np.random.Generator, noise: float = 1.0) -> ImageArray:
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    base = np.stack([200 - 0.2 * x, 180 - 0.15 * x - 0.1 * y, 160 - 0.1 * y], axis=2)
    return np.clip(np.round(base + rng.normal(0, noise, base.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("window", [15, 31, 61])
def test_a_shaded_sky_is_flattened(rng: np.random.Generator, window: int) -> None:
    residual = flatten(shaded(rng), window)
    assert residual.shape == (3, *SIZE)
    assert np.abs(residual.mean(axis=(1, 2))).max() < 0.5
    assert residual[0].std() < 1.5


@pytest.mark.parametrize("window", [15, 31, 61])
def test_both_sides_of_a_horizon_are_flattened(rng: np.random.Generator, window: int) -> None:
    image = shaded(rng)
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    image[y > 40 + 0.15 * x] = (60, 90, 70)
    residual = flatten(image, window)
    assert np.percentile(np.abs(residual[0]), 99) < 5


WING, GROUND = (40, 40, 200), (60, 90, 70)


def difference(colour: tuple[int, int, int], behind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Grey and blue minus red of a colour less what lies behind it, (2, n)."""
    blue, green, red = (np.array(colour) - behind).T
    return np.array([0.114 * blue + 0.587 * green + 0.299 * red, 0.5 * (blue - red)])


@pytest.mark.parametrize("window", [15, 31, 61])
def test_a_thin_wing_stays_with_its_contrast(rng: np.random.Generator, window: int) -> None:
    image = shaded(rng, noise=0.0)
    expected = difference(WING, image[46].astype(float))
    image[45:48, 70 : 70 + window] = WING
    inner = slice(75, 65 + window)
    assert flatten(image, window)[:2, 46, inner] == pytest.approx(expected[:, inner], abs=6)


@pytest.mark.parametrize("window", [15, 31, 61])
def test_near_a_horizon_structures_unlike_either_side_remain(rng: np.random.Generator, window: int) -> None:
    image = shaded(rng, noise=0.0)
    above = difference(WING, image[46].astype(float))
    below = difference(WING, np.tile(np.array(GROUND, np.float64), (SIZE[1], 1)))
    image[60:] = GROUND
    image[45:48, 70 : 70 + window] = WING
    inner = slice(75, 65 + window)
    left = flatten(image, window)[:2, 46, inner]
    # against the side that explains it better; blocks that the wing has tinted take a part of it away
    contrast = np.minimum(*(np.hypot(*side[:, inner]) for side in (above, below)))
    assert np.all(np.hypot(*left) > 0.75 * contrast)


@settings(max_examples=30)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 80), st.integers(0, 255))
def test_one_colour_gives_zero_at_every_size(height: int, width: int, window: int, level: int) -> None:
    image = np.full((height, width, 3), level, np.uint8)
    assert flatten(image, window) == pytest.approx(np.zeros((3, height, width)), abs=1e-3)
