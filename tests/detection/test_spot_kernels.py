"""The kernels of the search over whole frames against plain NumPy and OpenCV, on pictures of any size and fill."""

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from groundstation.detection.background_motion import _agreed, _block_means, _in_sigmas
from groundstation.detection.bilinear import places_between, widen
from groundstation.detection.connected_components import connected_runs
from groundstation.detection.spot_detection import _divide, _regions_beyond, _residual

# heights and widths below, at and beyond one and two blocks of 16 px
SIDES = st.integers(1, 53)
SIZES = st.tuples(SIDES, SIDES)
CELLS = st.tuples(st.integers(1, 9), st.integers(1, 9))
SEEDS = st.integers(0, 2**32 - 1)
FILLS = st.sampled_from([0.0, 0.02, 0.3, 0.5, 0.8, 1.0])
BLOCK_PX = 16


def any_picture(size: tuple[int, int], fill: float, rng: np.random.Generator) -> np.ndarray:
    """Return a grey picture (h, w) uint8 of which a share ``fill`` is above 0."""
    return (rng.integers(1, 256, size) * (rng.random(size) < fill)).astype(np.uint8)


def stretched(cells: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return a raster of cells as large as a picture (h, w), linear between the cells' middles, even beyond them."""
    for axis in (0, 1):
        n, px = cells.shape[axis], size[axis]
        places = (np.arange(px) + 0.5) * n / px - 0.5
        cells = np.apply_along_axis(lambda line, at=places, n=n: np.interp(at, np.arange(n), line), axis, cells)
    return cells


def reading_order(inside: np.ndarray) -> np.ndarray:
    """Return OpenCV's labels (h, w) of the 8-connected regions, counted from 1 in the order of their first pixels."""
    labels = cv2.connectedComponents(inside.astype(np.uint8), connectivity=8)[1]
    first = [int(np.argmax(labels.ravel() == k)) for k in range(1, labels.max() + 1)]
    number = np.zeros(len(first) + 1, np.int32)
    number[1 + np.argsort(first)] = np.arange(1, len(first) + 1)
    return np.asarray(number[labels])


def block_edges(px: int, blocks: int) -> list[tuple[int, int]]:
    return [(a * px // blocks, (a + 1) * px // blocks) for a in range(blocks)]


@given(size=SIZES, cells=CELLS, fill=FILLS, seed=SEEDS)
@example(size=(40, 1), cells=(3, 1), fill=1.0, seed=0)
@example(size=(1, 40), cells=(1, 3), fill=1.0, seed=0)
@example(size=(35, 50), cells=(4, 6), fill=0.0, seed=0)
def test_a_residual_is_the_difference_from_the_interpolated_background(
    size: tuple[int, int], cells: tuple[int, int], fill: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    grey, coarse = any_picture(size, fill, rng), any_picture(cells, fill, rng).astype(np.float32)
    residual, deviation = _residual(grey, coarse)
    expected = grey - stretched(coarse.astype(float), size)
    np.testing.assert_allclose(residual, expected, atol=2e-3)
    rows, columns = (block_edges(px, max(px // BLOCK_PX, 1)) for px in size)
    means = [[np.abs(expected[a:b, c:d]).mean() for c, d in columns] for a, b in rows]
    np.testing.assert_allclose(deviation, means, rtol=1e-5, atol=2e-3)


@given(size=SIZES, cells=CELLS, fill=FILLS, seed=SEEDS)
@example(size=(40, 1), cells=(3, 1), fill=1.0, seed=0)
@example(size=(1, 40), cells=(1, 3), fill=1.0, seed=0)
@example(size=(35, 50), cells=(4, 6), fill=0.0, seed=0)
def test_a_residual_is_divided_by_the_stretched_sigma(
    size: tuple[int, int], cells: tuple[int, int], fill: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    residual = (any_picture(size, fill, rng) - rng.integers(0, 2, size) * 100.0).astype(np.float32) * np.float32(fill)
    sigma = rng.uniform(0.7, 20.0, cells).astype(np.float32)
    expected = residual / stretched(sigma.astype(float), size)
    _divide(residual, sigma)
    np.testing.assert_allclose(residual, expected, rtol=2e-4)


@given(size=SIZES, fill=FILLS, seed=SEEDS)
@example(size=(40, 1), fill=0.5, seed=0)
@example(size=(1, 40), fill=0.5, seed=0)
@example(size=(20, 30), fill=0.0, seed=0)
@example(size=(20, 30), fill=1.0, seed=0)
@pytest.mark.parametrize("kind", [np.bool_, np.uint8, np.float32])
def test_runs_are_the_rows_of_the_connected_regions(
    size: tuple[int, int], fill: float, seed: int, kind: type[np.generic]
) -> None:
    inside = np.random.default_rng(seed).random(size) < fill
    picture = np.where(inside, 0.5, -0.5).astype(kind) if kind is np.float32 else inside.astype(kind)
    runs, number, count = connected_runs(picture)
    labels = reading_order(inside)
    painted = np.zeros(size, np.int32)
    for (i, first, end), own in zip(runs, number, strict=True):
        painted[i, first:end] = own
    np.testing.assert_array_equal(painted, labels)
    assert count == labels.max() + 1
    steps = np.diff(np.pad(inside.astype(int), ((0, 0), (1, 1))), axis=1)
    begun, ended = np.argwhere(steps > 0), np.argwhere(steps < 0)
    np.testing.assert_array_equal(runs, np.column_stack([begun, ended[:, 1]]))


@given(size=SIZES, fill=FILLS, seed=SEEDS)
@example(size=(40, 1), fill=0.5, seed=0)
@example(size=(1, 40), fill=0.5, seed=0)
@example(size=(20, 30), fill=0.0, seed=0)
@example(size=(20, 30), fill=1.0, seed=0)
def test_regions_beyond_a_limit_have_their_boxes_and_sums(size: tuple[int, int], fill: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    limit = 2.0
    # eighths: every sum is exact; signs are mixed within a region, and some pixels are just at the limit
    strength = np.where(rng.random(size) < fill, rng.integers(17, 90, size), rng.integers(0, 17, size)) / 8.0
    contrast = (strength * rng.choice([-1.0, 1.0], size) * (fill > 0.0)).astype(np.float32)
    table = _regions_beyond(contrast, limit)
    beyond = np.abs(contrast).astype(float)
    labels = reading_order(beyond > limit)
    assert len(table) == labels.max()
    for row, k in zip(table, range(1, len(table) + 1), strict=True):
        i, j = np.nonzero(labels == k)
        c = beyond[i, j]
        box = [j.min(), i.min(), j.max() + 1, i.max() + 1]
        sums = [i.size, c.sum(), (c * j).sum(), (c * i).sum(), (c * c).sum(), c.max()]
        np.testing.assert_allclose(row, [*box, *sums], rtol=1e-6)


@given(size=SIDES, count=st.integers(1, 60))
@example(size=1, count=1)
@example(size=40, count=1)
def test_places_are_between_two_cells_middles(size: int, count: int) -> None:
    first, second, share = places_between(size, count, count / size)
    assert first.min() >= 0
    assert second.max() < count
    assert np.all((second - first >= 0) & (second - first <= 1))
    assert np.all((share >= 0.0) & (share <= 1.0))
    place = np.clip((np.arange(size) + 0.5) * count / size - 0.5, 0, count - 1)
    np.testing.assert_allclose(first + share * (second - first), place, atol=1e-4)


@given(count=st.integers(1, 12), times=st.integers(1, 8), fill=FILLS, seed=SEEDS)
@example(count=1, times=8, fill=1.0, seed=0)
@example(count=5, times=4, fill=0.0, seed=0)
def test_a_row_is_widened_as_opencv_does_it(count: int, times: int, fill: float, seed: int) -> None:
    row = any_picture((1, count), fill, np.random.default_rng(seed)).astype(np.float32)
    size = count * times
    wide = np.empty(size, np.float32)
    widen(row[0], places_between(size, count, count / size), wide)
    expected = np.asarray(cv2.resize(row, (size, 1), interpolation=cv2.INTER_LINEAR))
    np.testing.assert_allclose(wide, expected[0], atol=2e-3)


def blocks_of(size: tuple[int, int]) -> tuple[int, int]:
    return -(-size[0] // BLOCK_PX), -(-size[1] // BLOCK_PX)


def in_every_pixel(blocks: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return np.kron(blocks, np.ones((BLOCK_PX, BLOCK_PX)))[: size[0], : size[1]]


@pytest.mark.parametrize("absolute", [False, True])
@given(size=SIZES, fill=FILLS, seed=SEEDS)
@example(size=(40, 1), fill=0.8, seed=0)
@example(size=(1, 40), fill=0.8, seed=0)
@example(size=(35, 50), fill=0.0, seed=0)
def test_block_means_are_of_every_second_known_pixel(
    size: tuple[int, int], fill: float, seed: int, absolute: bool
) -> None:
    rng = np.random.default_rng(seed)
    grey, laid = any_picture(size, 0.9, rng), any_picture(size, fill, rng)
    rows, columns = blocks_of(size)
    drift = (rng.integers(-40, 41, (rows, columns)) / 4.0).astype(np.float32)
    found = _block_means(grey, laid, drift if absolute else np.zeros((1, 1), np.float32), absolute)
    difference = grey.astype(float) - laid
    if absolute:
        difference = np.abs(difference - in_every_pixel(drift, size))
    expected = np.zeros((rows, columns))
    for a in range(rows):
        for b in range(columns):
            block = np.s_[a * BLOCK_PX : (a + 1) * BLOCK_PX : 2, b * BLOCK_PX : (b + 1) * BLOCK_PX : 2]
            known = laid[block] > 0
            if known.any():
                expected[a, b] = difference[block][known].mean()
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-4)


@given(size=SIZES, fill=FILLS, seed=SEEDS, misplaced_px=st.sampled_from([0.0, 0.3, 2.0]))
@example(size=(40, 1), fill=0.8, seed=0, misplaced_px=0.3)
@example(size=(1, 40), fill=0.8, seed=0, misplaced_px=0.3)
@example(size=(35, 50), fill=0.0, seed=0, misplaced_px=0.3)
def test_a_difference_is_in_sigmas_of_noise_misplacement_and_change(
    size: tuple[int, int], fill: float, seed: int, misplaced_px: float
) -> None:
    rng = np.random.default_rng(seed)
    laid = any_picture(size, fill, rng)
    # differences about those that noise explains, and large ones
    away = np.where(rng.random(size) < 0.7, rng.integers(-6, 7, size), rng.integers(-200, 201, size))
    grey = np.clip(laid + away, 0, 255).astype(np.uint8)
    slope = any_picture(size, 0.7, rng)
    # quarters are exact, and the ignored difference is not a quarter
    drift = (rng.integers(-12, 13, blocks_of(size)) / 4.0).astype(np.float32)
    common = rng.uniform(0.0, 5.0, blocks_of(size)).astype(np.float32)
    found = _in_sigmas(grey, laid, slope, drift, common, misplaced_px)
    noise = 2.0 * 1.2**2
    d = grey.astype(float) - laid - in_every_pixel(drift, size)
    anyway = 1.4 * in_every_pixel(common, size)
    sigmas = d / np.sqrt(noise + anyway**2 + (0.5 * misplaced_px * slope) ** 2)
    expected = np.where((laid == 0) | (np.abs(d) < 1.5 * np.sqrt(noise)), 0.0, sigmas)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@given(size=SIZES, fill=FILLS, seed=SEEDS)
@example(size=(40, 1), fill=0.5, seed=0)
@example(size=(1, 40), fill=0.5, seed=0)
@example(size=(20, 30), fill=0.0, seed=0)
def test_two_significances_agree_in_the_smaller_of_one_sign(size: tuple[int, int], fill: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = (
        (rng.normal(0, 5, size) * (rng.random(size) < min(2 * fill, 1.0))).astype(np.float32) for _ in range(2)
    )
    seen_first, seen_second = any_picture(size, fill, rng), any_picture(size, fill, rng)
    smaller = np.where(np.abs(first) < np.abs(second), first, second)
    expected = np.where(first * second > 0, smaller, 0)
    # the picture that sees nothing decides nothing; where neither does, the second's value stands
    expected = np.where(seen_second == 0, first, expected)
    expected = np.where(seen_first == 0, second, expected)
    np.testing.assert_array_equal(_agreed(first, seen_first, second, seen_second), expected)
