"""Where the Sun stands: against NREL's published example, and in the runway frame."""

import math
from datetime import UTC, datetime

import numpy as np
import pytest

from groundstation.pointing.sun import SunOverPlace

# Reda & Andreas, Solar Position Algorithm for Solar Radiation Applications, NREL/TP-560-34302, Table A5.1
NREL = SunOverPlace(lat_deg=39.742476, lon_deg=-105.1786, height_m=1830.14, y_axis_azimuth_deg=0.0)
NREL_S = datetime(2003, 10, 17, 19, 30, 30, tzinfo=UTC).timestamp()


def test_it_is_where_the_published_algorithm_puts_it() -> None:
    """Topocentric azimuth 194.34024°; zenith 50.11162° with a refraction of 0.016332°, which is left out here."""
    found = NREL.angles(NREL_S)
    assert math.degrees(found.azimuth_rad) == pytest.approx(194.34024, abs=1e-3)
    assert 90.0 - math.degrees(found.elevation_rad) == pytest.approx(50.11162 + 0.016332, abs=1e-3)


def test_the_runway_frames_y_axis_points_to_its_azimuth() -> None:
    found = NREL.angles(NREL_S)
    turned = SunOverPlace(lat_deg=39.742476, lon_deg=-105.1786, height_m=1830.14, y_axis_azimuth_deg=194.34024)
    x, y, z = turned.direction_runway(NREL_S)
    assert (x, z) == pytest.approx((0.0, math.sin(found.elevation_rad)), abs=1e-4)
    assert y == pytest.approx(math.cos(found.elevation_rad), abs=1e-4)
    # +y to the east puts south, where it nearly stands, to the right
    east = SunOverPlace(lat_deg=39.742476, lon_deg=-105.1786, height_m=1830.14, y_axis_azimuth_deg=90.0)
    assert east.direction_runway(NREL_S)[0] > 0.6
    assert np.linalg.norm(east.direction_runway(NREL_S)) == pytest.approx(1.0)


@pytest.mark.parametrize(("month", "day", "declination_deg"), [(3, 20, 0.0), (6, 21, 23.44), (12, 21, -23.44)])
def test_noon_on_the_equator_is_at_the_declination(month: int, day: int, declination_deg: float) -> None:
    place = SunOverPlace(lat_deg=0.0, lon_deg=0.0, height_m=0.0, y_axis_azimuth_deg=0.0)
    day_s = datetime(2026, month, day, tzinfo=UTC).timestamp()
    highest = max((place.angles(day_s + 60.0 * m) for m in range(660, 780)), key=lambda a: a.elevation_rad)
    assert 90.0 - math.degrees(highest.elevation_rad) == pytest.approx(abs(declination_deg), abs=0.2)
    if declination_deg:
        north = declination_deg > 0
        assert math.cos(highest.azimuth_rad) * (1 if north else -1) > 0.9
