"""Airliners and the Moon in drawn pictures of the day's sky: found where they are, nothing found where nothing is."""

import numpy as np
import pytest

from calibration.sky.sky_objects import find_moon, find_objects
from groundstation.arrays import FloatArray

SIZE = (320, 240)


def sky(seed: int) -> FloatArray:
    """A gradient with soft clouds and noise."""
    random = np.random.default_rng(seed)
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    clouds = np.cos(u / 70.0 + random.uniform(0.0, 6.0)) * np.cos(v / 55.0 + u / 150.0 + random.uniform(0.0, 6.0))
    return np.asarray(140.0 - 0.05 * v + 0.01 * u + 8.0 * clouds + random.normal(0.0, 1.5, u.shape))


def with_airliner(picture: FloatArray, u: float, v: float, contrast: float) -> FloatArray:
    """Draw a fuselage of 22 by 3 px and wings, eight times finer than the picture."""
    fine = np.zeros((40 * 8, 40 * 8))
    cu, cv = 8.0 * (u - round(u) + 20.0), 8.0 * (v - round(v) + 20.0)
    b, a = np.mgrid[: len(fine), : len(fine)] + 0.5
    fine[(np.abs(a - cu - 4.0) < 88.0) & (np.abs(b - cv - 4.0) < 12.0)] = 1.0
    fine[(np.abs(a - cu - 4.0) < 16.0) & (np.abs(b - cv - 4.0) < 72.0)] = 1.0
    coarse = fine.reshape(40, 8, 40, 8).mean(axis=(1, 3))
    out = picture.copy()
    x, y = round(u) - 20, round(v) - 20
    out[y : y + 40, x : x + 40] += contrast * coarse
    return out


@pytest.mark.parametrize("contrast", [-40.0, -15.0, 30.0])
def test_an_airliner_is_found_where_it_is(contrast: float) -> None:
    for seed in range(4):
        u, v = np.random.default_rng(seed).uniform((60.0, 60.0), (260.0, 180.0))
        seen = find_objects(np.round(with_airliner(sky(seed), u, v, contrast)))
        assert 1 <= len(seen) <= 3
        away = float(np.hypot(*(seen.pixel_px[0] - (u, v))))
        assert away < 3.0 * seen.sigma_px[0]
        assert 18.0 <= seen.extent_px[0] <= 28.0


def test_an_even_sky_shows_nothing() -> None:
    assert sum(len(find_objects(np.round(sky(seed)))) for seed in range(6)) == 0


def with_moon(picture: FloatArray, u: float, v: float, radius: float, light_rad: float, phase_rad: float) -> FloatArray:
    """Add a disc lit from one side, eight times finer than the picture; the dark part has the sky's light."""
    out = picture.copy()
    x, y = int(u - radius - 3), int(v - radius - 3)
    n = int(2 * radius + 8)
    b, a = (np.mgrid[: n * 8, : n * 8] + 0.5) / 8.0 - 0.5
    a, b = (a + x - u) / radius, (b + y - v) / radius
    inside = a**2 + b**2 < 1.0
    depth = np.sqrt(np.maximum(1.0 - a**2 - b**2, 0.0))
    lit = np.sin(phase_rad) * (a * np.cos(light_rad) + b * np.sin(light_rad)) + np.cos(phase_rad) * depth
    light = np.where(inside, np.maximum(lit, 0.0) ** 0.5, 0.0)
    out[y : y + n, x : x + n] += 50.0 * light.reshape(n, 8, n, 8).mean(axis=(1, 3))
    return out


@pytest.mark.parametrize("phase_deg", [0.0, 60.0, 90.0])
def test_the_moon_s_centre_is_found_by_its_lit_limb(phase_deg: float) -> None:
    for seed in range(3):
        random = np.random.default_rng([seed, 1])
        u, v = random.uniform((80.0, 80.0), (240.0, 160.0))
        light = float(random.uniform(0.0, 2.0 * np.pi))
        seen = find_moon(np.round(with_moon(sky(seed), u, v, 30.0, light, np.radians(phase_deg))), 30.0)
        assert seen is not None
        assert np.hypot(seen.pixel_px[0] - u, seen.pixel_px[1] - v) < 1.5


def test_no_moon_is_found_without_one_or_of_another_size() -> None:
    for seed in range(4):
        assert find_moon(np.round(sky(seed)), 30.0) is None
        assert find_moon(np.round(with_moon(sky(seed), 200.0, 120.0, 15.0, 0.0, 0.3)), 30.0) is None
        assert find_moon(np.round(with_airliner(sky(seed), 200.0, 120.0, -40.0)), 30.0) is None
    assert find_moon(np.round(sky(0)), 3.0) is None
