"""Every method behind the one interface: on a painted scene, on the bundled landing, from TOML, not installed."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.config import DetectionConfig, LevelSetConfig, SegmentationMethod, SnakeConfig
from groundstation.detection.detector import DetectionHint, Detector
from groundstation.detection.roi import place_roi
from groundstation.detection.segmentation import make_segmenter
from groundstation.messages import Detection
from groundstation.tracking.config import load_config
from tests.detection.painted import Painting, look_at, paint, sky, whole

SIZE = (260, 130)
METHODS = list(SegmentationMethod)
FRAME = 200


@pytest.fixture(scope="module")
def real(landing_from_20_s: Path) -> tuple[ImageArray, FloatArray, DetectionHint]:
    """One frame of the bundled landing, its true nose and what a filter would expect, 66 px wide against the sky."""
    video = cv2.VideoCapture(str(landing_from_20_s / "left.avi"))
    video.set(cv2.CAP_PROP_POS_FRAMES, FRAME)
    image = np.asarray(video.read()[1], np.uint8)
    video.release()
    table = np.genfromtxt(landing_from_20_s / "truth.csv", delimiter=",", names=True)
    nose = np.array([table["left_u_px"][FRAME], table["left_v_px"][FRAME]])
    hint = DetectionHint(
        predicted_px=nose + [3.0, -2.0],
        predicted_covariance_px2=16.0 * np.eye(2),
        expected_span_px=70.0,
        span_sigma_ratio=0.15,
        forward_px_per_m=np.array([0.0, 1.0]),
        up_px_per_m=np.array([0.0, -30.0]),
        px_per_m=30.0,
    )
    return image, nose, hint


@pytest.mark.parametrize("method", METHODS)
def test_finds_a_painted_aircraft(rng: np.random.Generator, method: SegmentationMethod) -> None:
    image = paint(sky(SIZE), Painting(nose_px=(131.0, 64.0), span_px=60.0), rng)
    detector = Detector(DetectionConfig(segmentation=method), SIZE)
    result = detector.detect(image, whole(image), look_at((133.0, 62.0), 60.0))
    assert isinstance(result, Detection), result
    assert np.hypot(result.u_px - 131.0, result.v_px - 64.0) < 2.0


@pytest.mark.parametrize("method", METHODS)
def test_finds_the_aircraft_of_the_bundled_landing(
    real: tuple[ImageArray, FloatArray, DetectionHint], method: SegmentationMethod
) -> None:
    image, nose, hint = real
    config = DetectionConfig(segmentation=method)
    size = (image.shape[1], image.shape[0])
    roi = place_roi(hint.predicted_px, hint.predicted_covariance_px2, None, config, size)
    assert roi is not None
    result = Detector(config, size).detect(image, roi, hint)
    assert isinstance(result, Detection), result
    assert np.hypot(*(np.array([result.u_px, result.v_px]) - nose)) < 3.0


@pytest.mark.parametrize(
    "method",
    [
        SegmentationMethod.CHAN_VESE_FULL,
        SegmentationMethod.SKIMAGE_CHAN_VESE,
        SegmentationMethod.SKIMAGE_CHAN_VESE_STEPPED,
        SegmentationMethod.CHAN_VESE,
    ],
)
def test_level_sets_agree_on_a_plain_blob(rng: np.random.Generator, method: SegmentationMethod) -> None:
    y, x = np.mgrid[0:40, 0:80]
    blob = np.hypot((x - 42) / 3.0, y - 20) < 6
    u = np.clip(0.1 + 0.8 * cv2.GaussianBlur(blob.astype(np.float32), (0, 0), 0.7), 0, 1)
    u += rng.normal(0, 0.02, u.shape).astype(np.float32)
    inside = np.hypot((x - 38) / 2.0, y - 19) < 9
    phi = make_segmenter(DetectionConfig(segmentation=method))(u, inside)
    assert phi.shape == u.shape
    assert phi.dtype == np.float32
    assert (blob & (phi > 0)).sum() / (blob | (phi > 0)).sum() > 0.93


@pytest.mark.parametrize("method", METHODS)
def test_an_empty_start_gives_a_level_set_of_finite_numbers(method: SegmentationMethod) -> None:
    u = np.full((12, 20), 0.2, np.float32)
    phi = make_segmenter(DetectionConfig(segmentation=method))(u, np.zeros(u.shape, np.bool_))
    assert phi.shape == u.shape
    assert np.isfinite(phi).all()


def test_at_most_the_given_iterations_are_done() -> None:
    """A morphological contour moves a pixel per iteration: after two it cannot be five px away."""
    u = np.zeros((60, 60), np.float32)
    u[10:50, 10:50] = 1.0
    inside = np.zeros(u.shape, np.bool_)
    inside[25:35, 25:35] = True
    method = SegmentationMethod.SKIMAGE_MORPHOLOGICAL
    for iterations, reached in ((2, False), (120, True)):
        config = DetectionConfig(segmentation=method, level_set=LevelSetConfig(iterations=iterations))
        assert bool(make_segmenter(config)(u, inside)[30, 15] > 0) is reached


def test_method_and_tuning_are_read_from_toml(tmp_path: Path) -> None:
    path = tmp_path / "tuning.toml"
    path.write_text('[detection]\nsegmentation = "gvf_snake"\n[detection.snake]\ntension = 0.5\ngvf_iterations = 10\n')
    detection = load_config(path).detection
    assert detection.segmentation is SegmentationMethod.GVF_SNAKE
    assert detection.snake == SnakeConfig(tension=0.5, gvf_iterations=10)


def test_only_the_methods_of_scikit_image_import_it(monkeypatch: pytest.MonkeyPatch) -> None:
    # None in sys.modules is how Python itself marks what cannot be imported
    monkeypatch.setitem(sys.modules, "skimage", None)
    for method in METHODS:
        if not method.value.startswith("skimage"):
            make_segmenter(DetectionConfig(segmentation=method))
