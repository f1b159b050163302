"""Stars in pictures: places without bias and with true sigmas; what is none is not taken for one."""

import numpy as np
import pytest
from scipy.stats import chi2

from calibration.stars.simulated.star_field import StarField
from calibration.stars.simulated.star_renderer import hot_pixel_map, render_stars
from calibration.stars.star_images import find_stars, hot_pixels

SIZE = (640, 480)
GRID = 8


def field(rng: np.random.Generator, flux: float) -> StarField:
    """Return stars of one brightness, far apart, each somewhere within its pixel."""
    u, v = np.meshgrid(np.linspace(40, SIZE[0] - 40, GRID), np.linspace(40, SIZE[1] - 40, GRID))
    places = np.column_stack([u.ravel(), v.ravel()]) + rng.uniform(-0.5, 0.5, (GRID**2, 2))
    return StarField(pixel_px=places, flux=np.full(GRID**2, flux), number=np.arange(GRID**2))


def shifted(stars: StarField, by_px: float) -> StarField:
    return StarField(pixel_px=stars.pixel_px + by_px, flux=stars.flux, number=stars.number)


def dark() -> np.ndarray:
    return np.zeros(SIZE[::-1])


def matched(seen_px: np.ndarray, true_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    away = np.linalg.norm(seen_px[:, None] - true_px[None], axis=2)
    return away.argmin(axis=1), away.min(axis=1) < 2.0


@pytest.mark.parametrize("drift", [(0.0, 0.0), (0.8, 0.3)])
@pytest.mark.parametrize("flux", [250.0, 1500.0])
def test_places_are_unbiased_and_their_sigmas_true(rng: np.random.Generator, flux: float, drift) -> None:
    stars = field(rng, flux)
    seen = find_stars(render_stars(stars, np.array(drift), dark(), rng))
    nearest, good = matched(seen.pixel_px, stars.pixel_px)
    assert good.sum() > 0.9 * GRID**2
    error = (seen.pixel_px - stars.pixel_px[nearest])[good] / seen.sigma_px[good, None]
    n = 2 * int(good.sum())
    assert abs(error.mean(axis=0)).max() < 3.3 / np.sqrt(good.sum())
    # sigmas may be a fifth too small or too large: the noise of a star's own light is not in them
    low, high = chi2.ppf([0.0005, 0.9995], n) / n
    assert 0.8**2 * low < float(np.mean(error**2)) < 1.2**2 * high


def test_sixteen_bits_give_what_eight_do(rng: np.random.Generator) -> None:
    picture = render_stars(field(rng, 900.0), np.zeros(2), dark(), rng)
    eight, sixteen = find_stars(picture), find_stars(picture.astype(np.uint16) * 200)
    assert len(eight) == len(sixteen)
    np.testing.assert_allclose(eight.pixel_px, sixteen.pixel_px, atol=0.02)


def test_hot_pixels_are_known_from_all_pictures_and_are_no_stars(rng: np.random.Generator) -> None:
    hot = hot_pixel_map(SIZE, rng)
    rendered = [
        render_stars(shifted(field(rng, 900.0), 9.0 * k), np.zeros(2), hot, rng).astype(float) for k in range(6)
    ]
    found = hot_pixels(np.min(rendered, axis=0))
    bright = hot > 40.0
    assert found[bright].mean() > 0.95
    assert found[~(hot > 0.0)].mean() < 1e-3
    empty = StarField(pixel_px=np.zeros((0, 2)), flux=np.zeros(0), number=np.zeros(0, dtype=np.int64))
    nothing = render_stars(empty, np.zeros(2), hot, np.random.default_rng(5))
    assert len(find_stars(nothing, found)) <= 3


def test_a_dark_picture_and_an_even_one_have_no_stars(rng: np.random.Generator) -> None:
    assert len(find_stars(np.zeros(SIZE[::-1], dtype=np.uint8))) == 0
    assert len(find_stars(np.full(SIZE[::-1], 130, dtype=np.uint8))) == 0
    assert len(find_stars(np.clip(rng.normal(20, 2, SIZE[::-1]), 0, 255).astype(np.uint8))) <= 3


def test_saturated_stars_are_placed_by_their_flanks(rng: np.random.Generator) -> None:
    stars = field(rng, 6000.0)
    picture = render_stars(stars, np.zeros(2), dark(), rng)
    assert (picture == 255).sum() > GRID**2
    seen = find_stars(picture)
    nearest, good = matched(seen.pixel_px, stars.pixel_px)
    assert good.sum() > 0.9 * GRID**2
    assert np.sqrt(np.mean((seen.pixel_px - stars.pixel_px[nearest])[good] ** 2)) < 0.08
