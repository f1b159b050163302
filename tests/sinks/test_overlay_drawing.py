"""What is drawn over a frame."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.messages import Detection
from groundstation.sinks.overlay_video import _CONTOUR, draw_track


def test_the_outline_is_closed_and_the_frame_is_unchanged() -> None:
    image = np.zeros((120, 160, 3), np.uint8)
    corners = np.array([[60, 40], [100, 40], [100, 80], [60, 80]], np.float32)
    found = Detection(
        u_px=80.0,
        v_px=60.0,
        covariance_px2=np.eye(2),
        noise_px2=np.eye(2),
        centroid_px=np.array([80.0, 60.0]),
        box=Box(60.0, 40.0, 100.0, 80.0),
        area_px=1600.0,
        contour_px=corners,
        contrast_to_noise=9.0,
        channel="grey",
    )
    track = SimpleNamespace(roi=None, result=found, t_s=1.5, status=SimpleNamespace(value="tracking"))
    picture = draw_track(image, 7, track)
    for u, v in ((80, 40), (100, 60), (80, 80), (60, 60)):
        # drawn smoothly, so not quite its colour
        assert picture[v, u].astype(int) == pytest.approx(np.array(_CONTOUR), abs=30)
    assert not image.any()
