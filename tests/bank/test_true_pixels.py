"""True pixels with the stated noise: the noise is as stated, and only what was detected is replaced."""

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import true_pixels
from scipy.stats import chi2

from groundstation.box import box_of_size
from groundstation.errors import SessionError
from groundstation.estimation.state_model import CORRELATED_SHARE, CORRELATION_TIME_S
from groundstation.messages import Detection, DetectionStatus, Miss, MissReason, PointHypothesis
from groundstation.tracking.frame_update import FrameUpdate, _Outcome

RECORDINGS = Path(__file__).resolve().parents[2] / "recordings"
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


class NoNoise:
    def draw(self, station: str, t_s: float, covariance_px2: np.ndarray) -> np.ndarray:
        return np.array([0.25, -0.25])


def test_a_detected_pixel_is_the_true_one_inside_the_block_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: for the filter and for the cameras among themselves; what is not detected or not in view stays."""
    found, miss = detection(), Miss(reason=MissReason.NO_REGION)
    shown: dict[int, Any] = {0: found, 1: found, 2: miss}

    def detect(update: FrameUpdate, record: Any, prediction: Any) -> Any:
        return _Outcome(DetectionStatus.OK, shown[record.epoch], by_itself=found, expected_width_px=20.0)

    monkeypatch.setattr(FrameUpdate, "_detect", detect)
    truth: Any = SimpleNamespace(
        visible={"left": np.array([True, False, True])},
        pixels_px={"left": np.array([[70.0, 80.0], [0.0, 0.0], [1, 1]])},
    )
    pixels = true_pixels.TruePixels(truth, NoNoise())
    update: Any = FrameUpdate.__new__(FrameUpdate)
    with pixels.in_place():
        outcomes = [
            update._detect(SimpleNamespace(station=station, epoch=epoch, t_s=0.1), None)
            for station, epoch in (("left", 0), ("left", 1), ("left", 2), ("right", 0))
        ]
    assert (pixels.replaced, pixels.as_detected) == (1, 2)
    for each in (outcomes[0].result, outcomes[0].by_itself):
        assert (each.u_px, each.v_px, each.hypotheses) == (70.25, 79.75, ())
        np.testing.assert_allclose(each.covariance_px2, found.covariance_px2)
    assert [outcomes[1].result, outcomes[2].result, outcomes[3].result] == [found, miss, found]
    assert outcomes[0].expected_width_px == 20.0
    assert FrameUpdate._detect is detect


def test_the_filter_takes_the_true_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a replay's report has the pixel of the truth wherever it had a detected one."""
    station, frame = "left", SimpleNamespace(station="left", epoch=0, t_s=0.1, image=None)
    found = detection()
    camera = SimpleNamespace(
        geometry=SimpleNamespace(image_size_px=(640, 480)),
        station=SimpleNamespace(lens=SimpleNamespace(focal_px=np.array([1000.0, 1000.0]))),
        hint=lambda *arguments: None,
        detect=lambda *arguments: SimpleNamespace(result=found, roi=None, channel_contrast=None),
    )
    update: Any = FrameUpdate.__new__(FrameUpdate)
    update._cameras = {station: camera}
    state = SimpleNamespace(velocity=slice(3, 6), position=slice(0, 3))
    update._ekf = SimpleNamespace(
        layout=state, state=np.zeros(6), covariance=np.eye(6), pixel_covariance=lambda prediction: 4.0 * np.eye(2)
    )
    update._config = SimpleNamespace(estimation=SimpleNamespace(min_view_probability=0.1, labelled_sigma_px=1.0))
    update._span, update._assumed_span_m = SimpleNamespace(span_m=2.0), 2.0
    monkeypatch.setattr(FrameUpdate, "_roi_centre", lambda *arguments: np.zeros(2))
    prediction = SimpleNamespace(pixel=np.array([50.0, 50.0]), jacobian=np.zeros((2, 6)), depth_m=100.0)
    truth: Any = SimpleNamespace(visible={station: np.array([True])}, pixels_px={station: np.array([[70.0, 80.0]])})
    with true_pixels.TruePixels(truth, NoNoise()).in_place():
        outcome = update._detect(frame, prediction)
    assert (outcome.result.u_px, outcome.result.v_px) == (70.25, 79.75)
    assert outcome.by_itself is outcome.result
    # the covariance is that of the detection with all its hypotheses
    assert outcome.result.covariance_px2[0, 0] > 100.0


def test_ratios_are_of_the_same_sessions() -> None:
    rows = [{f"rmse_{axis}_m": k + 1.0 for axis in "xyz"} for k in range(3)]
    others = [{f"rmse_{axis}_m": 2.0 for axis in "xyz"}, *({f"rmse_{axis}_m": None for axis in "xyz"},) * 2]
    assert true_pixels.ratios(rows, others) == "0.50/0.50/0.50"


def tracked(*squares: float | None) -> list[dict[str, Any]]:
    return [
        {"nees_sum": 0.0 if each is None else 30.0 * each, "nees_count": 10 * (each is not None)} for each in squares
    ]


def test_sessions_are_compared_in_pairs(rng: np.random.Generator) -> None:
    """Expected: a ratio that all sessions have is found in worlds that differ by far more; two alike are alike."""
    worlds = rng.lognormal(0.0, 1.0, 40)
    alike = true_pixels.compared(tracked(*worlds), tracked(*worlds * rng.lognormal(0.0, 0.1, 40)))
    half = true_pixels.compared(tracked(*0.8 * worlds), tracked(*worlds * rng.lognormal(0.0, 0.1, 40)))
    p_alike, p_half = (float(text.split("p = ")[2].split(",")[0]) for text in (alike, half))
    assert p_alike > 0.01
    assert p_half < 1e-6
    assert half.startswith("40 sessions")
    # those that nothing was tracked in are none
    assert true_pixels.compared(tracked(1.0, 2.0, None), tracked(1.1, None, 1.0)).startswith("no test: 1 sessions")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--wrong", "1.5"], "--wrong: got 1.5"),
        (["--worlds", "0"], "--worlds"),
        (["--first", "-1"], "--first: got -1"),
        (["--session", "nothing"], "nothing"),
        (["--detected", "nothing"], "no row of world 1000000"),
        (["--detected", str(RECORDINGS), "--session", str(RECORDINGS / "landing-1")], "no row of world"),
    ],
)
def test_bad_arguments_are_named(
    options: list[str], words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["true_pixels.py", *options])
    with pytest.raises(SystemExit) as end:
        true_pixels.main()
    assert end.value.code == 2
    assert words in capsys.readouterr().err


def test_a_session_without_truth_is_refused(tmp_path: Path) -> None:
    for name in ("session.toml", "rig.toml", "frames.csv", "ptu.csv", "left.mp4", "right.mp4"):
        shutil.copy(RECORDINGS / "landing-1" / name, tmp_path / name)
    with pytest.raises(SessionError, match="no truth"):
        true_pixels.truth_of(tmp_path)
