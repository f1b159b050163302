"""Whether a missed detection is distinguished from a frame without the target in view."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.tracking.frame_update import FrameUpdate


@pytest.mark.parametrize(
    ("predicted_px", "sigma_px", "likely"),
    [
        ((320.0, 240.0), 5.0, True),
        ((-40.0, 240.0), 5.0, False),
        (None, None, True),
        (None, 5.0, True),
        # where it is led to is known and how well is not
        ((-40.0, 240.0), None, True),
    ],
)
def test_what_is_not_predicted_counts_as_in_view(
    predicted_px: tuple[float, float] | None, sigma_px: float | None, likely: bool
) -> None:
    update = FrameUpdate.__new__(FrameUpdate)
    update._cameras = {"left": SimpleNamespace(geometry=SimpleNamespace(image_size_px=(640, 480)))}
    seen = SimpleNamespace(
        predicted_px=None if predicted_px is None else np.array(predicted_px),
        covariance_px2=None if sigma_px is None else sigma_px**2 * np.eye(2),
    )
    assert update._likely_in_view("left", seen) == likely
