"""Apparent directions: against ephem, which has other theories, and against the model of small changes."""

import math

import ephem
import numpy as np
import pytest

from calibration.mount.problem import changed_sky, lift_by_refraction
from calibration.stars.sky import ObservingSite, SkyOverSite, decimal_year, separation_rad, utc_text
from calibration.stars.star_solver import icrs_units
from groundstation.pointing.sun import SunOverPlace

UTC_S = 1_795_800_000.0
# almost no air: ephem's refraction is another formula
VACUUM_HPA = 1e-9
ARCSEC = math.radians(1.0 / 3600.0)


def site(**changes: float) -> ObservingSite:
    given = {"lat_deg": 47.1, "lon_deg": 8.2, "height_m": 480.0, "y_axis_azimuth_deg": 35.0, **changes}
    return ObservingSite(**given)


def some_stars(rng: np.random.Generator, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    return rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(-0.3, 1.4, count)


def test_stars_stand_where_ephem_has_them(rng: np.random.Generator) -> None:
    """Expected: within 2″, of which 1.3″ is UT1, which ephem takes for UTC, and the rest libastro's theories."""
    sky = SkyOverSite(site(pressure_hpa=VACUUM_HPA))
    ra, dec = some_stars(rng)
    observer = ephem.Observer()
    observer.lat, observer.lon = math.radians(47.1), math.radians(8.2)
    observer.elevation, observer.pressure = 480.0, 0.0
    observer.date = UTC_S / 86400.0 + 25567.5
    found = sky.stars(ra, dec, UTC_S)
    for unit, a, d in zip(found, ra, dec, strict=True):
        star = ephem.FixedBody()
        star._ra, star._dec, star._epoch = a, d, ephem.J2000
        star.compute(observer)
        aside = float(star.az) - math.radians(35.0)
        level = math.cos(star.alt)
        expected = np.array([level * math.sin(aside), level * math.cos(aside), math.sin(star.alt)])
        assert separation_rad(expected[None], unit)[0] < 2.0 * ARCSEC


def test_the_sun_is_that_of_the_keep_out_zone() -> None:
    sky = SkyOverSite(site(pressure_hpa=VACUUM_HPA))
    sun = SunOverPlace(lat_deg=47.1, lon_deg=8.2, height_m=480.0, y_axis_azimuth_deg=35.0)
    off = separation_rad(sky.body("sun", UTC_S)[None], sun.direction_runway(UTC_S))[0]
    assert off < 15.0 * ARCSEC


def test_the_sky_turns_as_the_clock_parameter_says(rng: np.random.Generator) -> None:
    sky = SkyOverSite(site(pressure_hpa=VACUUM_HPA))
    ra, dec = some_stars(rng)
    before, after = sky.stars(ra, dec, UTC_S), sky.stars(ra, dec, UTC_S + 20.0)
    moved, _ = changed_sky(before, sky.pole(), np.array([20.0, 0.0]))
    # of 300″; second order of the turn, and nutation's pole
    assert np.max(np.linalg.norm(moved - after, axis=1)) < 0.4 * ARCSEC


def test_refraction_lifts_as_its_parameter_says(rng: np.random.Generator) -> None:
    """Expected: more air by a tenth moves stars by the parameter's derivative, to a hundredth of the refraction."""
    ra, dec = some_stars(rng, 200)
    thin, thick = (SkyOverSite(site(pressure_hpa=p, air_c=10.0)).stars(ra, dec, UTC_S) for p in (1010.0, 1111.0))
    high = thin[:, 2] > math.sin(math.radians(8.0))
    assert high.sum() > 50
    moved, _ = changed_sky(thin[high], np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.1]))
    lifted = np.linalg.norm(lift_by_refraction(thin[high]), axis=1)
    assert np.all(np.linalg.norm(moved - thick[high], axis=1) < 0.015 * lifted)


def test_the_runway_frame_is_turned_from_icrs_as_the_stars_are(rng: np.random.Generator) -> None:
    sky = SkyOverSite(site(pressure_hpa=VACUUM_HPA))
    ra, dec = some_stars(rng)
    turned = icrs_units(ra, dec) @ sky.icrs_from_runway(UTC_S)
    off = np.linalg.norm(turned - sky.stars(ra, dec, UTC_S), axis=1)
    # aberration is 20.5″ and diurnal 0.3″
    assert np.max(off) < 21.0 * ARCSEC
    assert np.max(off) > 5.0 * ARCSEC


def test_the_standard_atmosphere_gets_thinner_with_height() -> None:
    assert site(height_m=0.0).pressure == pytest.approx(1013.25)
    assert site(height_m=1500.0).pressure == pytest.approx(845.6, rel=0.01)
    assert site(height_m=1500.0).temperature == pytest.approx(5.25)
    assert site(pressure_hpa=900.0, air_c=-3.0).pressure == 900.0
    assert site(pressure_hpa=900.0, air_c=-3.0).temperature == -3.0


def test_times_are_told_in_utc() -> None:
    assert utc_text(0.0) == "1970-01-01T00:00:00Z"
    assert decimal_year([946_728_000.0]) == pytest.approx(2000.0)
    assert decimal_year([946_728_000.0, 946_728_000.0 + 2 * 365.25 * 86400.0]) == pytest.approx(2001.0)
