"""The background model: the content of a window in earlier frames, shifted into place, pixel by pixel."""

import math
import weakref

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, box_of_size, shift
from groundstation.detection import background as bg
from groundstation.detection.flatten import planes
from groundstation.picture import BgrPicture

TARGET = Box(90, 60, 120, 76)


def texture(rng: np.random.Generator, h: int = 150, w: int = 220) -> ImageArray:
    rough = cv2.GaussianBlur(rng.normal(0, 60, (h, w, 3)), (0, 0), 2.0)
    return np.clip(120 + 2 * rough, 0, 255).astype(np.uint8)


def opponents(colour: FloatArray) -> FloatArray:
    b, g, r = colour
    return np.array([0.114 * b + 0.587 * g + 0.299 * r, 0.5 * (b - r), 0.5 * g - 0.25 * (b + r)])


def by_pixel(
    window: ImageArray, frame: ImageArray, offset: tuple[float, float], hole: tuple[float, ...], misfit: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residual and misfit after one frame, one pixel after the other."""
    h, w = window.shape[:2]
    residual, misfit = np.full((3, h, w), np.nan), misfit.copy()
    for i in range(h):
        for j in range(w):
            x, y = offset[0] + j, offset[1] + i
            a, b = math.floor(x), math.floor(y)
            if not (0 <= a < frame.shape[1] - 1 and 0 <= b < frame.shape[0] - 1) or misfit[i, j] < 8.0:
                continue
            if hole.x0 <= x < hole.x1 and hole.y0 <= y < hole.y1:
                continue
            fx, fy = x - a, y - b
            four = frame[b : b + 2, a : a + 2].astype(float)
            above, below = (1 - fx) * four[0, 0] + fx * four[0, 1], (1 - fx) * four[1, 0] + fx * four[1, 1]
            under = (1 - fy) * above + fy * below
            found = opponents(window[i, j] - under)
            fit = abs(found[0]) + 2 * (abs(found[1]) + abs(found[2]))
            if fit < misfit[i, j]:
                misfit[i, j], residual[:, i, j] = fit, found
    return residual, misfit


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**31),
    st.tuples(st.integers(-192, 192), st.integers(-144, 144)),
    st.tuples(st.integers(-5, 30), st.integers(-5, 20), st.integers(0, 25), st.integers(0, 15)),
    st.booleans(),
)
def test_a_frame_is_laid_under_a_window_as_pixel_by_pixel(
    seed: int, sixteenths: tuple[int, int], hole: tuple[int, int, int, int], again: bool
) -> None:
    rng, offset = np.random.default_rng(seed), (sixteenths[0] / 16, sixteenths[1] / 16)
    window, frame = (rng.integers(90, 130, (18, 30, 3)).astype(np.uint8) for _ in range(2))
    edges = box_of_size(*hole)
    before = rng.choice([3.0, 20.0, 60.0], (18, 30)) if again else np.full((18, 30), bg._UNKNOWN)
    misfit, residual = before.astype(np.float32), np.zeros((3, 18, 30), np.float32)
    edge = np.zeros((18, 30), np.float32)
    args = (planes(window), planes(frame), offset, 0.2, Box(0, 0, 30, 18), edges)
    left = bg._subtract_background(*args, residual, edge, misfit)
    wanted, fit = by_pixel(window, frame, offset, edges, before)
    written = ~np.isnan(wanted[0])
    # of two fits that are the same to rounding either may be taken
    np.testing.assert_allclose(misfit, fit, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(residual[:, written], wanted[:, written], atol=1e-3)
    assert np.all(residual[:, ~written] == 0)
    assert left == bool((misfit >= 8.0).any())


def seen_after(scene: ImageArray, pictures: list[ImageArray], picture: ImageArray) -> bg.Difference:
    """Return the difference of a whole window after some pictures in which the target moved on."""
    memory = bg.BackgroundModel()
    h, w = scene.shape[:2]
    for k, earlier in enumerate(pictures):
        hidden = shift(TARGET, -45 * (len(pictures) - k), 0)
        memory.remember(BgrPicture(earlier), Box(30, 20, w - 30, h - 20), hidden, 30.0)
    found = memory.subtract(BgrPicture(picture), Box(30, 20, w - 30, h - 20), TARGET)
    assert found is not None
    return found


def test_the_scene_vanishes_and_the_target_stays(rng: np.random.Generator) -> None:
    scene = texture(rng)
    picture = scene.copy()
    picture[66:70, 95:115] = (20, 30, 200)
    found = seen_after(scene, [scene], picture)
    assert found.known.mean() > 0.9
    covered = np.zeros(found.known.shape, bool)
    covered[46:50, 65:85] = True
    assert np.abs(found.residual[:, found.known & ~covered]).max() < 1.0
    assert np.abs(found.residual[0][covered]).mean() > 20.0


def test_a_bird_in_one_earlier_frame_is_not_background(rng: np.random.Generator) -> None:
    scene = texture(rng)
    with_bird = scene.copy()
    with_bird[62:74, 98:112] = 10
    found = seen_after(scene, [scene, with_bird], scene)
    near = (slice(42, 54), slice(68, 82))
    assert found.known[near].all()
    assert np.abs(found.residual[(slice(None), *near)]).max() < 1.0


def test_pixels_in_no_frame_are_unknown_and_zero(rng: np.random.Generator) -> None:
    scene = texture(rng)
    memory = bg.BackgroundModel()
    hidden = shift(TARGET, -30, 0)
    # kept are 48 px more than what is around: columns up to 168
    memory.remember(BgrPicture(scene), Box(60, 30, 120, 110), hidden, 30.0)
    found = memory.subtract(BgrPicture(scene), Box(50, 20, 210, 130), TARGET)
    assert found is not None
    x = np.arange(50, 210)
    assert not found.known[:, x >= 168].any()
    assert found.known[:, (x < 167) & (x >= TARGET.x1)].all()
    assert np.all(found.residual[:, ~found.known] == 0)
    assert np.all(found.edge[~found.known] == 0)


def test_a_sky_without_texture_is_left_to_the_spatial_background() -> None:
    sky = np.full((150, 220, 3), 180, np.uint8)
    memory = bg.BackgroundModel()
    memory.remember(BgrPicture(sky), Box(30, 20, 190, 130), TARGET, 30.0)
    assert memory.subtract(BgrPicture(sky), Box(30, 20, 190, 130), TARGET) is None


def test_of_all_frames_kept_in_part_at_most_the_newest_is_held_whole(rng: np.random.Generator) -> None:
    scene, memory, held = texture(rng), bg.BackgroundModel(), []
    for k in range(3):
        frame = scene.copy()
        held.append(weakref.ref(frame))
        hidden = shift(TARGET, -45 * (3 - k), 0)
        memory.remember(BgrPicture(frame), Box(30, 20, 190, 130), hidden, 30.0)
        del frame
    assert [frame() is None for frame in held] == [True, True, False]
    assert memory.subtract(BgrPicture(scene), Box(30, 20, 190, 130), TARGET) is not None
    assert held[2]() is None


@pytest.mark.parametrize("shift", [(3.4, -2.3), (-30.0, 12.0)])
def test_a_turned_camera_s_scene_is_found_again(rng: np.random.Generator, shift: tuple[float, float]) -> None:
    scene = texture(rng, 220, 320)
    under = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    turned = np.asarray(cv2.warpAffine(scene, under, (320, 220), flags=flags), np.uint8)
    memory = bg.BackgroundModel()
    memory.remember(BgrPicture(scene), Box(60, 50, 260, 170), TARGET, 30.0)
    target = Box(190, 110, 220, 126)
    found = memory.subtract(BgrPicture(turned), Box(100, 60, 220, 150), target)
    assert found is not None
    assert found.known.mean() > 0.8
    assert float(np.abs(found.residual[:, found.known]).mean()) < 2.0
