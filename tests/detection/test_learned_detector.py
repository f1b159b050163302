"""The learned channel and its detector: a drawn aircraft is found with its nose, an empty sky gives none."""

import copy
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
import pytest

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX, ChannelWindow, channel_window
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.learned_channel import ChannelMaps, LearnedChannel, nose_of
from groundstation.detection.make_detector import make_detector
from groundstation.detection.working_image import DetectionHint
from groundstation.errors import InputError
from groundstation.files.channel_weights import MOST_BYTES, channel_weights, read_weights
from groundstation.messages import Detection, Miss
from groundstation.picture import Picture
from groundstation.simulation.world.draw_world import draw_world
from training.sprites import Sprite, SpriteStudio

SIZE_PX = (640, 480)
ROI = Box(0, 0, *SIZE_PX)
LEARNED = DetectionConfig(detector=DetectorKind.LEARNED)


def drawn(seed: int) -> Sprite:
    found = SpriteStudio().aircraft(draw_world(seed), np.random.default_rng(2 + seed))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def sprite() -> Sprite:
    """A low-wing aircraft that approaches."""
    return drawn(13)


def sky(generator: np.random.Generator) -> np.ndarray:
    rows = np.linspace(0.0, 1.0, SIZE_PX[1])[:, None, None]
    levels = np.array([235.0, 200.0, 165.0]) + rows * np.array([10.0, 25.0, 45.0])
    return levels + generator.normal(0.0, 2.0, (SIZE_PX[1], SIZE_PX[0], 3))


def picture(
    sprite: Sprite, place: tuple[int, int], width_px: float, generator: np.random.Generator
) -> tuple[ImageArray, np.ndarray]:
    """Return a picture with the sprite's upper left at a place, and its nose's pixel."""
    levels, zoom = sky(generator), width_px / sprite.width_px
    size = round(sprite.light.shape[1] * zoom), round(sprite.light.shape[0] * zoom)
    light = cv2.GaussianBlur(cv2.resize(sprite.light, size, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    part = levels[place[1] : place[1] + size[1], place[0] : place[0] + size[0]]
    part[:] = (1.0 - light[:, :, 3:]) * part + light[:, :, :3]
    nose = (sprite.nose_px + 0.5) * (np.array(size) / sprite.light.shape[1::-1]) - 0.5 + place
    return np.clip(levels, 0.0, 255.0).round().astype(np.uint8), nose


def hint(at_px: np.ndarray, span_px: float, sigma_px: float = 6.0) -> DetectionHint:
    return DetectionHint(
        predicted_px=at_px,
        predicted_covariance_px2=np.eye(2) * sigma_px**2,
        expected_span_px=span_px,
        span_sigma_ratio=0.1,
    )


@pytest.mark.parametrize("seed", [13, 14, 16, 17, 18])
@pytest.mark.parametrize(("width_px", "grey"), [(24.0, False), (44.0, True), (80.0, False)])
def test_an_approaching_aircraft_is_found_with_its_nose(
    seed: int, width_px: float, grey: bool, rng: np.random.Generator
) -> None:
    """Two low or high wings, a flying wing, a twin boom and a glider, of train worlds."""
    image, nose = picture(drawn(seed), (280, 200), width_px, rng)
    if grey:
        image = np.repeat(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[:, :, None], 3, axis=2)
    near = hint(nose + [4.0, -3.0], 1.2 * width_px)
    found = make_detector(LEARNED, SIZE_PX).detect(image, ROI, near)
    assert isinstance(found, Detection)
    off = np.array([found.u_px, found.v_px]) - nose
    assert np.hypot(*off) < max(0.08 * width_px, 1.5)
    assert off @ np.linalg.solve(found.covariance_px2, off) < 13.8
    assert found.channel == "learned"
    assert found.box.x0 < nose[0] < found.box.x1
    assert 0.7 * width_px < found.box.w < 1.3 * width_px
    again = make_detector(LEARNED, SIZE_PX).detect(image, ROI, near)
    assert isinstance(again, Detection)
    assert (again.u_px, again.v_px) == (found.u_px, found.v_px)


def test_a_hidden_nose_costs_accuracy_and_is_stated_so(rng: np.random.Generator) -> None:
    tail_view, front_view = drawn(12), drawn(16)
    assert tail_view.nose_hidden
    sigmas = []
    for sprite in (tail_view, front_view):
        image, nose = picture(sprite, (280, 200), 60.0, rng)
        found = make_detector(LEARNED, SIZE_PX).detect(image, ROI, hint(nose, 60.0))
        assert isinstance(found, Detection)
        assert np.hypot(found.u_px - nose[0], found.v_px - nose[1]) < 0.3 * 60.0
        sigmas.append(float(np.sqrt(np.trace(found.covariance_px2))))
    assert sigmas[0] > 1.5 * sigmas[1]


def test_a_silhouette_that_the_border_cuts_may_have_its_nose_outside(sprite: Sprite, rng: np.random.Generator) -> None:
    """The left third of the wings is outside: the covariance covers a nose that is there, too."""
    image, nose = picture(sprite, (280, 200), 80.0, rng)
    whole = make_detector(LEARNED, SIZE_PX).detect(image, ROI, hint(nose, 80.0))
    part = np.ascontiguousarray(image[:, 280 + 27 :])
    size = part.shape[1], part.shape[0]
    cut = make_detector(LEARNED, size).detect(part, Box(0, 0, *size), hint(nose - [307.0, 0.0], 80.0))
    assert isinstance(whole, Detection)
    assert isinstance(cut, Detection)
    assert (whole.cut, cut.cut) == (False, True)
    sigmas = [float(np.sqrt(found.covariance_px2[0, 0])) for found in (whole, cut)]
    assert sigmas[1] > 4.0 * sigmas[0]
    assert sigmas[1] > 8.0


def test_a_prediction_that_is_far_off_is_searched_around(sprite: Sprite, rng: np.random.Generator) -> None:
    image, nose = picture(sprite, (280, 200), 30.0, rng)
    found = make_detector(LEARNED, SIZE_PX).detect(image, ROI, hint(nose + [70.0, 10.0], 30.0, sigma_px=40.0))
    assert isinstance(found, Detection)
    assert abs(found.u_px - nose[0]) < 8.0


def test_what_is_in_the_picture_is_found_though_the_point_is_expected_outside(
    sprite: Sprite, rng: np.random.Generator
) -> None:
    """The aircraft is at the right border, its point expected 30 px beyond it with a sigma of 40 px."""
    image, nose = picture(sprite, (540, 200), 90.0, rng)
    expected = np.array([SIZE_PX[0] + 30.0, nose[1]])
    found = make_detector(LEARNED, SIZE_PX).detect(image, ROI, hint(expected, 90.0, sigma_px=40.0))
    assert isinstance(found, Detection)
    assert np.hypot(found.u_px - nose[0], found.v_px - nose[1]) < 10.0


@pytest.mark.parametrize("seed", [13, 14, 17])
def test_an_aircraft_of_which_the_middle_alone_is_seen_is_found(seed: int, rng: np.random.Generator) -> None:
    """It shows three tenths of what is expected, as thin or pale wings do: a window for all of it does not know it."""
    for width_px, expected_px in ((24.0, 80.0), (30.0, 100.0)):
        image, nose = picture(drawn(seed), (280, 200), width_px, rng)
        found = make_detector(LEARNED, SIZE_PX).detect(image, ROI, hint(nose + [3.0, -2.0], expected_px))
        assert isinstance(found, Detection)
        assert np.hypot(found.u_px - nose[0], found.v_px - nose[1]) < 0.1 * width_px


@pytest.mark.parametrize(("sigma_rad", "shown_px"), [(0.1, (44.0, 50.0, 63.0)), (2.0, (44.0, 44.0, 44.0))])
def test_a_window_is_no_finer_than_the_picture_and_no_coarser_than_need_be(
    sprite: Sprite,
    rng: np.random.Generator,
    monkeypatch: pytest.MonkeyPatch,
    sigma_rad: float,
    shown_px: tuple[float, ...],
) -> None:
    """A target has 44 px in its window as far as 44 px wide, then its own, and 63 px from there on.

    Where it is not known which way it flies it always has 44 px.
    """
    spans: list[float] = []

    def noted(image: Picture, centre: np.ndarray, span_px: float) -> ChannelWindow | None:
        spans.append(span_px)
        return channel_window(image, centre, span_px)

    def flying(at_px: np.ndarray, width_px: float, sigma_px: float = 6.0) -> DetectionHint:
        forward = {"forward_px_per_m": np.array([0.0, 1.0]), "px_per_m": 10.0, "forward_sigma_rad": sigma_rad}
        return replace(hint(at_px, width_px, sigma_px), **forward)

    monkeypatch.setattr("groundstation.detection.learned_detector.channel_window", noted)
    for width_px, shown in zip((24.0, 50.0, 126.0), shown_px, strict=True):
        image, nose = picture(sprite, (280, 200), width_px, rng)
        spans.clear()
        found = make_detector(LEARNED, SIZE_PX).detect(image, ROI, flying(nose, width_px))
        assert isinstance(found, Detection)
        assert [width_px * TARGET_PX / span for span in spans] == pytest.approx([shown])
    # where so fine windows would be too many the target has 44 px
    spans.clear()
    make_detector(LEARNED, SIZE_PX).detect(image, ROI, flying(nose, 126.0, sigma_px=150.0))
    assert spans[0] == 126.0


def test_what_is_hardly_an_aircraft_counts_where_one_is_expected_and_that_place_is_known(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Log odds of −0.9 and a prior of 1.5: enough next to the prediction, not in a place ten times as large."""
    aircraft = np.full(WINDOW_PX[::-1], -6.0, np.float32)
    aircraft[38:58, 42:86] = -0.9
    nose = np.zeros(WINDOW_PX[::-1], np.float32)
    nose[48, 64] = 1.0
    monkeypatch.setattr(LearnedChannel, "maps", lambda *arguments: ChannelMaps(aircraft=aircraft, nose=nose))
    image = np.clip(sky(rng), 0.0, 255.0).round().astype(np.uint8)
    for sigma_px, result in ((5.0, Detection), (40.0, Miss)):
        near = hint(np.array([320.0, 240.0]), 44.0, sigma_px)
        assert isinstance(make_detector(LEARNED, SIZE_PX).detect(image, ROI, near), result)


def test_an_empty_sky_and_a_place_outside_give_none(rng: np.random.Generator) -> None:
    detector = make_detector(LEARNED, SIZE_PX)
    image = np.clip(sky(rng), 0.0, 255.0).round().astype(np.uint8)
    for place in ([320.0, 240.0], [100.0, 100.0], [-900.0, 100.0]):
        assert isinstance(detector.detect(image, ROI, hint(np.array(place), 40.0)), Miss)


def test_the_nose_of_a_map_is_its_mean_with_its_covariance() -> None:
    rows, columns = np.mgrid[0 : WINDOW_PX[1], 0 : WINDOW_PX[0]]
    mark = np.exp(-0.5 * (((columns - 70.3) / 3.0) ** 2 + ((rows - 40.6) / 1.5) ** 2))
    mean, covariance = nose_of((mark / mark.sum()).astype(np.float32))
    np.testing.assert_allclose(mean, [70.3, 40.6], atol=1e-3)
    np.testing.assert_allclose(covariance, np.diag([9.0, 2.25]), atol=0.02)


def test_maps_of_a_constant_window_know_nothing() -> None:
    maps = LearnedChannel(channel_weights()).maps(np.full((WINDOW_PX[1], WINDOW_PX[0], 3), 120, np.uint8))
    assert maps.aircraft.max() < 0.0
    assert float(maps.nose.sum()) == pytest.approx(1.0, abs=1e-4)
    assert WINDOW_PX[0] > TARGET_PX


def test_cameras_share_what_their_weights_are_read_into(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: at most one session of ONNX Runtime for one file of weights, however many channels there are."""
    made = []

    class Counted(onnxruntime.InferenceSession):
        def __init__(self, *arguments: object, **options: object) -> None:
            made.append(arguments)
            super().__init__(*arguments, **options)

    monkeypatch.setattr(onnxruntime, "InferenceSession", Counted)
    window = np.full((WINDOW_PX[1], WINDOW_PX[0], 3), 120, np.uint8)
    channels = [LearnedChannel(channel_weights()) for _ in range(3)]
    assert len(made) <= 1
    first = channels[0].maps(window)
    for channel in (*channels, copy.deepcopy(channels[0])):
        np.testing.assert_array_equal(channel.maps(window).aircraft, first.aircraft)
    assert len(made) <= 1


def test_weights_that_are_missing_other_or_no_network_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "aircraft.onnx"
    with pytest.raises(InputError, match="weights"):
        read_weights(path, None)
    path.write_bytes(b"no network")
    with pytest.raises(InputError, match="SHA-256"):
        read_weights(path, "0" * 64)
    with pytest.raises(InputError, match="ONNX"):
        LearnedChannel(read_weights(path, None))
    path.write_bytes(bytes(MOST_BYTES + 1))
    with pytest.raises(InputError, match="at most"):
        read_weights(path, None)
