"""EdgeProfiles profiles about two lines: the outermost bin has no pixel of its own."""

import numpy as np

from groundstation.onboard.edges.profile_kernel import gather


def test_pixels_on_whole_places_fill_all_bins_but_the_last() -> None:
    image = np.full((10, 60, 3), 255, np.uint8)
    x = np.array([20.0, 20.0, 40.0, 40.0])
    total, weight = np.zeros((2, 2, 9, 3)), np.zeros((2, 2, 9))
    gather(image, x, np.array([0.0, 9.0]), np.ones(2), total, weight)
    assert weight[:, :, :-1].min() > 0.0
    np.testing.assert_array_equal(weight[:, :, -1], 0.0)
    np.testing.assert_allclose(total, np.repeat(weight[..., None], 3, axis=3))
    # each of ten rows once: five in a block
    np.testing.assert_allclose(weight[:, :, :-1].sum(axis=1), 10.0)
