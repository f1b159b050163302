"""EdgeProfiles profiles about two lines: the outermost bin has no pixel of its own."""

import numpy as np

from groundstation.onboard.edges.gather_kernel import gather


def test_pixels_on_whole_places_fill_all_bins_but_the_last() -> None:
    image = np.full((10, 60, 3), 255, np.uint8)
    x = np.array([20.0, 20.0, 40.0, 40.0])
    total, weight = np.zeros((2, 2, 9, 3)), np.zeros((2, 2, 9))
    gather(image, x, np.array([0.0, 9.0]), np.ones(2), total, weight, np.zeros((2, 0, 0)))
    assert weight[:, :, :-1].min() > 0.0
    np.testing.assert_array_equal(weight[:, :, -1], 0.0)
    np.testing.assert_allclose(total, np.repeat(weight[..., None], 3, axis=3))
    # each of ten rows once: five in a block
    np.testing.assert_allclose(weight[:, :, :-1].sum(axis=1), 10.0)


def test_squares_are_those_of_the_grey_with_the_weights_of_its_sums() -> None:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (40, 80, 3)).astype(np.uint8)
    x, rows, steps = np.array([25.0, 20.0, 45.0, 55.0]), np.array([3.0, 36.0]), np.array([0.7, 1.4])
    total, weight, square = np.zeros((2, 4, 11, 3)), np.zeros((2, 4, 11)), np.zeros((2, 4, 11))
    gather(image, x, rows, steps, total, weight, square)
    alone = np.zeros_like(total)
    gather(image, x, rows, steps, alone, np.zeros_like(weight), np.zeros((2, 0, 0)))
    np.testing.assert_array_equal(total, alone)
    # a picture whose blue is the square of the grey has its sums
    grey = image.astype(float).mean(axis=2) / 255.0
    squared, sums = np.repeat(255.0 * grey[..., None] ** 2, 3, axis=2), np.zeros_like(total)
    gather(squared, x, rows, steps, sums, np.zeros_like(weight), np.zeros((2, 0, 0)))
    np.testing.assert_allclose(square, sums[..., 0], rtol=1e-12)
