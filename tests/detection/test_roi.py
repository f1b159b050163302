import numpy as np
import pytest

from groundstation.detection.config import DetectionConfig
from groundstation.detection.roi import place_roi

SIZE = (1280, 960)


def test_size_is_basic_size_plus_target_plus_sigmas() -> None:
    config = DetectionConfig()
    roi = place_roi(np.array([600.0, 400.0]), np.diag([4.0, 9.0]), (40.0, 20.0), config, SIZE)
    assert roi is not None
    assert roi.w == pytest.approx(250 + 40 + 2 * 3 * 2, abs=1)
    assert roi.h == pytest.approx(100 + 20 + 2 * 3 * 3, abs=1)
    assert roi.x0 + (roi.w - 1) / 2 == pytest.approx(600, abs=1)
    assert roi.y0 + (roi.h - 1) / 2 == pytest.approx(400, abs=1)


def test_clips_to_the_image() -> None:
    roi = place_roi(np.array([5.0, 955.0]), np.eye(2), None, DetectionConfig(), SIZE)
    assert roi is not None
    assert roi.x0 == 0
    assert roi.y0 + roi.h == SIZE[1]
    assert roi.w > 100


@pytest.mark.parametrize("point", [(-500.0, 400.0), (600.0, 2000.0), (float("nan"), 3.0)])
def test_no_window_outside_the_image(point: tuple[float, float]) -> None:
    assert place_roi(np.array(point), np.eye(2), None, DetectionConfig(), SIZE) is None


def test_a_vague_prediction_does_not_widen_without_end() -> None:
    roi = place_roi(np.array([600.0, 400.0]), 1e12 * np.eye(2), None, DetectionConfig(), (100_000, 100_000))
    assert roi is not None
    assert roi.w <= 250 + 2 * 3 * 200 + 600


def test_the_window_lies_where_the_silhouette_hangs() -> None:
    """Seen from below an aircraft hangs under its nose: the window moves so far that it holds it."""
    point, config, size = np.array([600.0, 300.0]), DetectionConfig(), (330.0, 140.0)
    plain = place_roi(point, np.eye(2), size, config, SIZE)
    hanging = place_roi(point, np.eye(2), size, config, SIZE, (0.0, 66.0))
    assert plain is not None
    assert hanging is not None
    assert (hanging.w, hanging.h, hanging.x0) == (plain.w, plain.h, plain.x0)
    # 50 px are left around a silhouette about its nose, 25 around one that hangs
    assert hanging.y0 == pytest.approx(plain.y0 + 66 - 25, abs=1)
    assert place_roi(point, np.eye(2), size, config, SIZE, (10.0, 20.0)) == plain
