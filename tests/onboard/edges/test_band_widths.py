"""How wide the bands about edges are: of so many metres, but not too narrow, too wide or beyond the middle."""

import numpy as np
import pytest

from groundstation.onboard.edges.line_kernel import BandLimits, band_widths_of


@pytest.mark.parametrize(
    ("metres", "least_px", "most_px", "expected"),
    [(4.0, 1.0, 50.0, 4.0), (4.0, 1.0, 2.5, 2.5), (4.0, 6.0, 50.0, 6.0), (40.0, 1.0, 50.0, 13.5)],
)
def test_they_are_of_so_many_metres_within_bounds(
    metres: float, least_px: float, most_px: float, expected: float
) -> None:
    """A map in which a metre is a pixel, and edges at columns 15 and 45."""
    mean, crossings = np.array([1.0, 0.0, -15.0, -45.0]), np.array([15.0, 15.0, 45.0, 45.0])
    widths = np.empty((2, 2))
    rows, across = np.array([10.0, 60.0]), np.zeros(2)
    band_widths_of(mean, np.eye(3), rows, crossings, BandLimits(metres, least_px, most_px), across, widths)
    np.testing.assert_allclose(widths, expected)
