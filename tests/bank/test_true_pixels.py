"""True pixels with the stated noise: the noise is as stated, and only what was detected is replaced."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import true_pixels
from scipy.stats import chi2

from groundstation.box import box_of_size
from groundstation.estimation.state_model import CORRELATED_SHARE, CORRELATION_TIME_S
from groundstation.messages import Detection, PointHypothesis
from groundstation.tracking import frame_update
from groundstation.tracking.camera_tracker import CameraTracker

STATED_PX2 = np.array([[9.0, 3.0], [3.0, 4.0]])


def test_the_noise_has_the_stated_covariance() -> None:
    noise, count = true_pixels.StatedNoise(seed=1, gross_share=0.0), 4000
    # so far apart that successive draws are independent
    drawn = np.array([noise.draw("left", 20.0 * k * CORRELATION_TIME_S, STATED_PX2) for k in range(count)])
    squares = np.einsum("ni,ij,nj->", drawn, np.linalg.inv(STATED_PX2), drawn)
    low, high = chi2.ppf([0.0005, 0.9995], 2 * count)
    assert low < squares < high
    assert np.cov(drawn.T) == pytest.approx(STATED_PX2, abs=0.8)


def test_a_share_of_the_noise_lasts_in_each_camera() -> None:
    noise, count, step_s = true_pixels.StatedNoise(seed=2, gross_share=0.0), 20_000, 0.1
    drawn = np.array([[noise.draw(name, step_s * k, np.eye(2))[0] for name in ("left", "right")] for k in range(count)])
    expected = CORRELATED_SHARE * np.exp(-step_s / CORRELATION_TIME_S)
    for camera in drawn.T:
        assert np.corrcoef(camera[1:], camera[:-1])[0, 1] == pytest.approx(expected, abs=4.0 / np.sqrt(count))
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.0, abs=4.0 / np.sqrt(count) * 1.5)


def test_a_share_is_gross() -> None:
    noise, count = true_pixels.StatedNoise(seed=3, gross_share=0.1), 5000
    drawn = np.array([noise.draw("left", 0.1 * k, 0.01 * np.eye(2)) for k in range(count)])
    far = np.abs(drawn).max(axis=1) > 1.0
    # uniform within ± GROSS_PX: one in 10,000 of the gross ones is nearer than that
    assert far.mean() == pytest.approx(0.1, abs=4.0 * np.sqrt(0.09 / count))
    assert np.abs(drawn).max() <= true_pixels.GROSS_PX


def detection() -> Detection:
    hypotheses = tuple(
        PointHypothesis(pixel=np.array([at, 50.0]), covariance_px2=np.eye(2), probability=0.5) for at in (40.0, 60.0)
    )
    return Detection(
        u_px=50.0,
        v_px=50.0,
        covariance_px2=STATED_PX2,
        noise_px2=STATED_PX2,
        centroid_px=np.array([50.0, 50.0]),
        box=box_of_size(40.0, 45.0, 20.0, 10.0),
        area_px=100.0,
        contour_px=np.empty((0, 2), np.float32),
        contrast_to_noise=4.0,
        channel="learned",
        hypotheses=hypotheses,
    )


class Nothing:
    def draw(self, station: str, t_s: float, covariance_px2: np.ndarray) -> np.ndarray:
        return np.array([0.25, -0.25])


def test_a_detected_pixel_is_the_true_one_inside_the_block_only(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = SimpleNamespace(
        visible={"left": np.array([True, False])}, pixels_px={"left": np.array([[70.0, 80.0], [0.0, 0.0]])}
    )
    monkeypatch.setattr(true_pixels, "load_session", lambda folder: None)
    monkeypatch.setattr(true_pixels, "load_truth", lambda session: truth)
    monkeypatch.setattr(CameraTracker, "detect", lambda self, frame, *rest: rest)
    camera: Any = SimpleNamespace(station=SimpleNamespace(name="left"))
    arguments: Any = (detection(), np.array([50.0, 50.0]), np.eye(2), (640, 480))
    before = frame_update.weighed, CameraTracker.detect
    with true_pixels.true_pixels(Path("session"), Nothing()):
        for epoch, place in ((0, (70.25, 79.75)), (1, (40.0, 50.0))):
            frame: Any = SimpleNamespace(epoch=epoch, t_s=0.1 * epoch)
            assert CameraTracker.detect(camera, frame, "centre", "covariance") == ("centre", "covariance")
            found = frame_update.weighed(*arguments)
            assert (found.u_px, found.v_px) == pytest.approx(place)
            # what the point stands for is not changed
            assert np.linalg.eigvalsh(found.covariance_px2)[0] > 0.5
    assert (frame_update.weighed, CameraTracker.detect) == before


def test_ratios_are_of_the_same_sessions() -> None:
    rows = [{f"rmse_{axis}_m": k + 1.0 for axis in "xyz"} for k in range(3)]
    others = [{f"rmse_{axis}_m": 2.0 for axis in "xyz"}, *({f"rmse_{axis}_m": None for axis in "xyz"},) * 2]
    assert true_pixels.ratios(rows, others) == "0.50/0.50/0.50"
