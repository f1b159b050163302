"""The kernels of one detection against plain NumPy: the silhouette cut out, its colours, the palette, the levels."""

import cv2
import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.appearance import features_of_regions
from groundstation.detection.background_histogram import suppress_background_colours
from groundstation.detection.flatten import _edges, _keep_edges, planes
from groundstation.detection.level_set_input import _levels, _soften
from groundstation.detection.regions import soft_silhouette

BOX = Box(6, 3, 31, 22)


@pytest.fixture
def labels(rng: np.random.Generator) -> np.ndarray:
    """Blocks of nine labels, some of them nothing, in (28, 44) px."""
    blocks = rng.integers(0, 9, (7, 11)) * rng.integers(0, 2, (7, 11))
    return np.kron(blocks, np.ones((4, 4))).astype(np.int32)


@pytest.mark.parametrize("members", [[1], [3, 5, 8], [2, 7]])
def test_a_silhouette_is_its_members_and_a_pixel_around_them(
    members: list[int], labels: np.ndarray, rng: np.random.Generator
) -> None:
    u = rng.random(labels.shape).astype(np.float32)
    mask, soft = soft_silhouette(labels, np.array(members), BOX, u)
    x0, y0, x1, y1 = BOX
    inside = np.isin(labels[y0:y1, x0:x1], members).astype(np.uint8)
    assert np.array_equal(mask, inside)
    around = cv2.dilate(inside, np.ones((3, 3), np.uint8)) > 0
    assert np.array_equal(soft, np.where(around, u[y0:y1, x0:x1], np.float32(0)))


@pytest.mark.parametrize("members", [[1], [3, 5, 8]])
def test_features_are_the_members_mean_colour_and_their_shape(
    members: list[int], labels: np.ndarray, rng: np.random.Generator
) -> None:
    image = rng.integers(0, 256, (*labels.shape, 3), dtype=np.uint8)
    seen = features_of_regions(image, labels, np.array(members), BOX, 77.0)
    x0, y0, x1, y1 = BOX
    inside = np.isin(labels[y0:y1, x0:x1], members)
    blue, green, red = image[y0:y1, x0:x1][inside].astype(float).mean(axis=0)
    colour = [0.114 * blue + 0.587 * green + 0.299 * red, 0.5 * (blue - red), 0.5 * green - 0.25 * (blue + red)]
    np.testing.assert_allclose(seen, [*colour, np.log(19 / 25), np.log(77.0 / 25**2)], rtol=1e-12)


def test_a_colour_counts_the_less_the_more_of_it_is_around(rng: np.random.Generator) -> None:
    """The shares of every second pixel's bins outside the box, spread over the neighbouring bins."""
    colours = np.array([[0.0, 0.0, 0.0], [20.0, 3.0, -6.0], [-15.0, 8.0, 4.0], [30.0, -9.0, 9.0]])
    which = rng.choice(4, (28, 44), p=[0.93, 0.05, 0.013, 0.007])
    residual = (colours[which].transpose(2, 0, 1) + rng.normal(0, 0.5, (3, 28, 44))).astype(np.float32)
    contrast = (rng.random((28, 44)) * 6.0).astype(np.float32)
    sigmas = np.array([2.0, 1.5, 1.2])
    bins = np.array([32, 24, 16])
    per_level = (1.0 / (1.5 * sigmas)).astype(np.float32)
    places = residual * per_level[:, None, None] + 0.5 * bins.astype(np.float32)[:, None, None]
    place = tuple(np.clip(places, 0, bins[:, None, None] - 1).astype(int))
    counted = np.zeros((28, 44), bool)
    counted[::2, ::2] = True
    counted[BOX.slices] = False
    count = np.zeros(bins + 2)
    np.add.at(count, tuple(p[counted] + 1 for p in place), 1.0 / np.count_nonzero(counted))
    share = sum(count[a : a + 32, b : b + 24, c : c + 16] for a in range(3) for b in range(3) for c in range(3))
    with np.errstate(divide="ignore"):
        factor = np.clip(np.log(np.asarray(share) / 0.02) / np.log(0.002 / 0.02), 0.0, 1.0)
    expected = np.where(contrast > 2.0, contrast * factor[place], contrast)
    assert len(np.unique(factor[place].round(3))) >= 3  # common, rare and between
    suppress_background_colours(residual, sigmas, BOX, contrast)
    np.testing.assert_allclose(contrast, expected, rtol=1e-4, atol=1e-5)


def test_levels_are_quantiles_near_the_prediction_and_elsewhere(rng: np.random.Generator) -> None:
    """To the width of the histogram's bins."""
    contrast = rng.gamma(2.0, 3.0, (101, 251)).astype(np.float32)
    x0, y0, x1, y1 = box = Box(81, 30, 170, 79)
    columns, rows = rng.random(x1 - x0).astype(np.float32), rng.random(y1 - y0).astype(np.float32)
    near, far = _levels(contrast, box, columns, rows, 200.0)
    share = 200.0 / ((x1 - x0) * (y1 - y0))
    likely = contrast[y0:y1, x0:x1] * columns * rows[:, None]
    outside = np.ones(contrast.shape, bool)
    outside[y0:y1, x0:x1] = False
    assert near == pytest.approx(np.quantile(likely, 1.0 - share), rel=0.02)
    assert far == pytest.approx(np.quantile(contrast[::2, ::2][outside[::2, ::2]], 1.0 - share), rel=0.02)


@pytest.mark.parametrize("step", [1, 3, 5, 16])
def test_at_an_edge_a_pixel_goes_by_the_block_that_it_resembles_most(step: int, rng: np.random.Generator) -> None:
    """The first of the block's own and its neighbours' colours that is hardly any different, or else the nearest."""
    rows, columns = -(-28 // step), -(-44 // step)
    # few colours, so that many blocks are equal, and pixels a little off them
    colours = np.array([[60, 90, 70], [62, 91, 70], [64, 88, 72], [180, 190, 200]])
    median = colours[rng.integers(0, 4, (rows, columns))].astype(np.uint8)
    median[:, columns // 2 :], median[0, 0] = colours[0], colours[3]
    image = colours[rng.integers(0, 4, (28, 44))] + rng.integers(-6, 7, (28, 44, 3))
    edges, out = np.empty((rows, columns), bool), np.full((3, 28, 44), -1.0, np.float32)
    assert _edges(median, edges)
    _keep_edges(planes(image.astype(np.uint8)), median, edges, step, out)
    order = [(0, 0), (0, 1), (1, -1), (1, 0), (1, 1), (-1, -1), (-1, 0), (-1, 1), (0, -1)]
    for i, j in np.ndindex(28, 44):
        a, b = i // step, j // step
        if not edges[a, b]:
            assert np.all(out[:, i, j] == -1.0)
            continue
        near = [median[a + p, b + q] for p, q in order if 0 <= a + p < rows and 0 <= b + q < columns]
        away = image[i, j] - np.array(near, int)
        misfit = (away**2).sum(axis=1)
        blue, green, red = away[np.argmax(misfit <= 12) if (misfit <= 12).any() else np.argmin(misfit)]
        wanted = [0.114 * blue + 0.587 * green + 0.299 * red, 0.5 * (blue - red), 0.5 * green - 0.25 * (blue + red)]
        np.testing.assert_allclose(out[:, i, j], wanted, atol=1e-4)


def test_contrast_is_reduced_by_possible_misplacement_and_spatial_without_a_background(
    rng: np.random.Generator,
) -> None:
    contrast, edge, spatial = rng.gamma(2.0, 3.0, (3, 28, 44)).astype(np.float32)
    known = rng.random((28, 44)) < 0.8
    wanted = np.where(known, contrast / np.sqrt(1.0 + edge.astype(float) ** 2 / 2.5), spatial)
    _soften(contrast, edge, 2.5, known, spatial)
    np.testing.assert_allclose(contrast, wanted, rtol=1e-6)
