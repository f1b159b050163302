"""Blur, noise, light and cuts of pictures with known values."""

import cv2
import numpy as np
import pytest

from groundstation.arrays import ImageArray
from groundstation.bank.composites.linear_light import levels_of, light_of, with_shoulder
from groundstation.bank.composites.picture_blur import USUAL_BLUR_PX, edge_blur_px
from groundstation.bank.composites.picture_light import is_sky, picture_light, sky_mask
from groundstation.bank.composites.picture_noise import PictureNoise, picture_noise
from groundstation.bank.composites.segment_view import longest_without_cut
from groundstation.registration.picture_shift import small_copy
from tests.bank.composites.made_clips import SKY_BGR, SKYLINE_ROW, scene


def grey(levels: np.ndarray) -> ImageArray:
    """Return a picture (h, w, 3) of grey levels."""
    return np.repeat(np.clip(np.rint(levels), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


@pytest.mark.parametrize("sigma", [0.7, 1.2, 2.0])
def test_the_blur_of_a_disc_is_measured(sigma: float) -> None:
    fine = np.full((960, 960), 150.0)
    cv2.circle(fine, (480, 480), 300, 60.0, -1)
    picture = cv2.resize(cv2.GaussianBlur(fine, (0, 0), 6.0 * sigma), (160, 160), interpolation=cv2.INTER_AREA)
    assert edge_blur_px([grey(picture)], [None]) == pytest.approx(sigma, rel=0.12)


def test_a_picture_full_of_edges_is_measured(rng: np.random.Generator) -> None:
    rough = cv2.GaussianBlur(rng.normal(130.0, 300.0, (300, 300)), (0, 0), 1.5)
    assert 0.5 < edge_blur_px([grey(rough)], [None]) < 2.0


def test_a_picture_without_edges_has_the_usual_blur() -> None:
    assert edge_blur_px([grey(np.full((96, 96), 150.0))], [None]) == USUAL_BLUR_PX


@pytest.mark.parametrize(("sigma", "blur"), [(2.0, 0.8), (1.0, 0.0)])
def test_drawn_noise_is_measured_as_it_was_drawn(rng: np.random.Generator, sigma: float, blur: float) -> None:
    """Expected: noise added where an aircraft covers has the level and the smoothness of the clip's own."""
    drawn = PictureNoise(sigma=sigma, blur_px=blur)
    found = picture_noise([grey(130.0 + drawn.draw(rng, (256, 256))) for _ in range(2)])
    # the calmest blocks are a little calmer than all
    assert found.sigma == pytest.approx(sigma, rel=0.15)
    assert found.blur_px == pytest.approx(blur, abs=0.25)


def test_noise_below_rounding_is_none() -> None:
    calm = picture_noise([grey(np.full((96, 96), 130.0))])
    assert calm.sigma == pytest.approx(12.0**-0.5)
    assert not calm.draw(np.random.default_rng(1), (8, 8)).any()


def test_light_of_a_scene_is_that_of_its_sky_and_its_ground() -> None:
    picture = scene(1)
    sky = sky_mask(picture)
    light = picture_light([picture], [sky])
    assert levels_of(light.sky_bgr.astype(np.float32)) == pytest.approx(np.array(SKY_BGR), abs=3.0)
    assert light.ground_bgr is not None
    assert light.ground_bgr.max() < light.sky_bgr.min()
    assert light.clearness == 1.0
    assert is_sky(sky, np.array([40.0, 60.0]))
    assert not is_sky(sky, np.array([40.0, SKYLINE_ROW + 25.0]))


def test_levels_come_back_from_light_and_bright_paint_stays_below_white() -> None:
    levels = np.arange(256, dtype=np.uint8)[None]
    assert levels_of(light_of(levels)) == pytest.approx(levels.astype(float), abs=1e-3)
    bright = with_shoulder(np.array([0.3, 0.9, 2.0, 5.0]))
    assert bright[0] == 0.3
    assert np.all(np.diff(bright) > 0.0)
    assert bright[-1] < 1.0


def test_a_segment_ends_where_another_scene_begins() -> None:
    one, other = small_copy(scene(1)), small_copy(grey(np.full((240, 320), 30.0)))
    assert longest_without_cut([one, one, other, other, other, one]) == (2, 4)
