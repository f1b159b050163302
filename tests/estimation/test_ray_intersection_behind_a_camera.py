"""A point behind one of the cameras: as many residuals as before it, all far off, and no slope."""

import numpy as np
import pytest

from groundstation.estimation import range_initialisation
from groundstation.estimation.range_initialisation import _RayIntersection


def test_behind_a_camera_all_four_residuals_are_far_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_RayIntersection, "predictions", lambda self, point_m: None)
    meeting = _RayIntersection.__new__(_RayIntersection)
    np.testing.assert_array_equal(meeting.residuals(np.zeros(3)), np.full(4, range_initialisation._BEHIND))

    class BearingOnlyPrior:
        def velocity_slope(self, point_m: np.ndarray) -> np.ndarray:
            return np.zeros((3, 3))

    class Layout:
        position = velocity = slice(0, 3)

    meeting._prior, meeting._layout = BearingOnlyPrior(), Layout()
    np.testing.assert_array_equal(meeting.jacobian(np.zeros(3)), np.zeros((4, 3)))
