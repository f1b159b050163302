"""One camera's part: the span it learns, the silhouette as a mask, the contrast of the paper's channel."""

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.config import DetectorKind, TargetPoint
from groundstation.detection.detector import DetectionHint
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_z, wxyz_from_matrix
from groundstation.messages import Detection, Frame, Miss, MissReason
from groundstation.picture import BgrPicture, PartialPicture, PicturePart
from groundstation.tracking.camera_tracker import (
    CameraTracker,
    SpanModel,
    hides_nose,
    level_extent_px,
    silhouette_mask,
)
from groundstation.tracking.config import Config
from tests.stereo_rig import make_station


def test_a_given_span_is_not_unlearnt() -> None:
    span = SpanModel(2.3)
    span.learn(100.0, 20.0)
    assert span.span_m == 2.3
    assert span.sigma_ratio < 0.3


@pytest.mark.parametrize(("roll_deg", "size_px"), [(0, (46, 12)), (180, (46, 12)), (90, (12, 46)), (-90, (12, 46))])
def test_wings_reach_along_the_horizon_however_a_camera_is_mounted(roll_deg: int, size_px: tuple[int, int]) -> None:
    """A camera on its side shows 46 px of wings as a height: taken as widths, they are those of a fuselage."""
    station = make_station("left", -5.0)
    rolled = matrix_from_wxyz(station.head_from_camera_wxyz) @ rotation_z(math.radians(roll_deg))
    geometry = replace(station, head_from_camera_wxyz=wxyz_from_matrix(rolled)).geometry()
    projection = geometry.project(np.array([-5.0, 300.0, 1.6]), 0.0, 0.0)
    assert projection is not None
    box = Box(0.0, 0.0, float(size_px[0]), float(size_px[1]))
    assert level_extent_px(box, projection.jacobian[:, :3]) == pytest.approx(46.0, abs=0.5)


def test_an_unknown_span_is_estimated_with_growing_confidence() -> None:
    """Widths of 46 px at 20 px/m: 2.3 m, whatever single frames give."""
    span = SpanModel(None)
    before = span.sigma_ratio
    generator = np.random.default_rng(2)
    for _ in range(60):
        span.learn(46.0 * float(generator.uniform(0.9, 1.1)), 20.0)
    assert span.span_m is not None
    assert abs(math.log(span.span_m / 2.3)) < 0.05
    assert span.sigma_ratio < before
    span.learn(-1.0, 20.0)
    span.learn(5.0, 0.0)
    assert abs(math.log(span.span_m / 2.3)) < 0.05


def test_a_silhouette_in_pieces_becomes_one_mask() -> None:
    def square(x: float, y: float) -> list[list[float]]:
        return [[x, y], [x + 9, y], [x + 9, y + 4], [x, y + 4]]

    nan = [[math.nan, math.nan]]
    found = Detection(
        u_px=0.0,
        v_px=0.0,
        covariance_px2=np.eye(2),
        noise_px2=0.1 * np.eye(2),
        centroid_px=np.zeros(2),
        box=Box(0.0, 0.0, 1.0, 1.0),
        area_px=100.0,
        contour_px=np.array(square(110, 60) + nan + square(130, 60), dtype=np.float32),
        contrast_to_noise=5.0,
        channel="grey",
    )
    mask = silhouette_mask(found, Box(100, 50, 160, 80))
    assert mask.shape == (30, 60)
    assert mask.sum() == 2 * 50
    assert mask[10, 10]
    assert mask[10, 30]
    assert not mask[10, 25]


@pytest.fixture
def picture(rng: np.random.Generator) -> np.ndarray:
    """A dark aircraft on a shaded sky whose colour is the aircraft's: saturation has little contrast."""
    sky = np.linspace(150, 190, 960)[:, None] * np.ones((1, 1280))
    image = np.repeat(sky[:, :, None], 3, axis=2) + rng.normal(0, 2, (960, 1280, 3))
    image[478:483, 600:681] -= 60
    image[470:492, 634:648] -= 60
    return np.clip(image, 0, 255).astype(np.uint8)


def hint_in_the_middle() -> DetectionHint:
    """The aircraft of the picture is expected where it is, as wide as it is."""
    return DetectionHint(
        predicted_px=np.array([640.0, 480.0]),
        predicted_covariance_px2=np.eye(2) * 9.0,
        expected_span_px=80.0,
        span_sigma_ratio=0.15,
        forward_px_per_m=None,
        up_px_per_m=np.array([0.0, -35.0]),
        px_per_m=35.0,
    )


def test_a_detection_reports_the_contrast_of_every_channel(picture: np.ndarray) -> None:
    tracker = CameraTracker(make_station("left", 0.0), Config())
    hint = hint_in_the_middle()
    frame = Frame(t_s=0.0, station="left", epoch=0, image=BgrPicture(picture))
    look = tracker.detect(frame, hint.predicted_px, hint.predicted_covariance_px2, hint)
    assert look is not None
    assert isinstance(look.result, Detection)
    assert look.channel_contrast is not None
    assert look.channel_contrast["grey"] > 5 * look.channel_contrast["saturation"]
    assert tracker.detect(frame, np.array([-900.0, 480.0]), np.eye(2), hint) is None


def test_a_window_beyond_what_was_recorded_is_a_miss_with_that_reason(picture: np.ndarray) -> None:
    """Expected: the part around the prediction was recorded, the detector's own window was not; no error."""
    tracker = CameraTracker(make_station("left", 0.0), Config())
    hint = hint_in_the_middle()
    part = PicturePart(x=605, y=460, pixels=picture[460:500, 605:675])
    frame = Frame(t_s=0.0, station="left", epoch=0, image=PartialPicture((1280, 960), [part], None))
    look = tracker.detect(frame, hint.predicted_px, hint.predicted_covariance_px2, hint)
    assert look is not None
    assert isinstance(look.result, Miss)
    assert look.result.reason is MissReason.NOT_RECORDED
    assert "recording kept" in (look.result.detail or "")


def failing(*_: Any) -> Any:
    """Fail as OpenCV does."""
    return cv2.cvtColor(np.empty((0, 0, 3), np.uint8), cv2.COLOR_BGR2GRAY)


def test_a_frame_in_which_opencv_fails_is_a_miss(picture: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: with its reason and a line, in a window as in a whole frame; the next frame is searched as before."""
    lines: list[str] = []
    tracker = CameraTracker(make_station("left", 0.0), Config(), log=lambda t_s, line: lines.append(line))
    hint = hint_in_the_middle()
    frame = Frame(t_s=0.0, station="left", epoch=0, image=BgrPicture(picture))
    with monkeypatch.context() as patched:
        patched.setattr(tracker._detector, "detect", failing)
        patched.setattr(tracker._finder, "find", failing)
        look = tracker.detect(frame, hint.predicted_px, hint.predicted_covariance_px2, hint)
        assert not tracker.search(frame, 0.0, 0.0, 1e-4)
        assert tracker.search_fault is MissReason.DETECTION_FAILED
    words = "(-215:Assertion failed) !_src.empty() in function 'cvtColor'"
    assert look is not None
    assert look.result == Miss(reason=MissReason.DETECTION_FAILED, detail=words)
    assert lines == [f"left: the detection failed: {words}; the frame is a miss"] * 2
    tracker.search(frame, 0.0, 0.0, 1e-4)
    assert tracker.search_fault is None
    look = tracker.detect(frame, hint.predicted_px, hint.predicted_covariance_px2, hint)
    assert look is not None
    assert isinstance(look.result, Detection)


def test_errors_of_a_detector_given_by_the_caller_are_the_callers(picture: np.ndarray) -> None:
    tracker = CameraTracker(make_station("left", 0.0), Config(), failing)
    hint = hint_in_the_middle()
    frame = Frame(t_s=0.0, station="left", epoch=0, image=BgrPicture(picture))
    with pytest.raises(cv2.error, match="cvtColor"):
        tracker.detect(frame, hint.predicted_px, hint.predicted_covariance_px2, hint)
    with pytest.raises(cv2.error, match="cvtColor"):
        tracker.search(frame, 0.0, 0.0, 1e-4)


@pytest.mark.parametrize(("speed_m_s", "hidden"), [((0.0, 40.0, 0.0), True), ((0.0, -40.0, 1.0), False)])
def test_a_heading_away_from_the_camera_says_nothing_about_a_nose_that_is_hidden(
    speed_m_s: tuple[float, float, float], hidden: bool
) -> None:
    """A camera that looks along the runway: u to the right, v downwards."""
    jacobian = np.array([[8.0, 0.1, 0.0], [0.0, 0.1, -8.0]])
    heading = np.array(speed_m_s) / np.linalg.norm(speed_m_s)
    assert hides_nose(heading, jacobian) == hidden
    assert not hides_nose(None, jacobian)


def test_only_the_learned_channel_infers_a_hidden_nose() -> None:
    """Expected: neither the classic detector, nor one of the user's own, nor the silhouette's centroid has a lead."""
    station = make_station("left", 0.0)
    own = Config().detection
    classic = replace(Config(), detection=replace(own, detector=DetectorKind.CLASSIC))
    centroid = replace(Config(), detection=replace(own, target_point=TargetPoint.CENTROID))
    assert CameraTracker(station, Config()).infers_hidden_nose
    assert not CameraTracker(station, classic).infers_hidden_nose
    assert not CameraTracker(station, centroid).infers_hidden_nose
    assert not CameraTracker(station, Config(), lambda picture, roi, hint: []).infers_hidden_nose
