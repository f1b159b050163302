"""Where heads look: all over the range, clear of horizon and Moon, from all four sides; refused by day."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from calibration.stars.pointing_plan import (
    APPROACH_DEG,
    LEAST_ALTITUDE_DEG,
    MOON_DEG,
    HeadRange,
    plan_pointings,
)
from groundstation.errors import InputError
from tests.calibration.mount.mounts import plain_station

WIDE = HeadRange(pan_deg=(-60.0, 60.0), tilt_deg=(0.0, 55.0))


def axis(pan_deg: float, tilt_deg: float) -> np.ndarray:
    pose = plain_station().geometry().camera_pose(float(np.radians(pan_deg)), float(np.radians(tilt_deg)))
    return pose.runway_from_camera[:, 2]


@given(
    low=st.floats(-150.0, -30.0),
    width=st.floats(30.0, 180.0),
    top=st.floats(25.0, 80.0),
    count=st.integers(3, 60),
    moon_pan=st.floats(-180.0, 180.0),
    moon_up=st.floats(1.0, 60.0),
)
def test_pointings_are_clear_and_within_the_range(low, width, top, count, moon_pan, moon_up) -> None:
    within = HeadRange(pan_deg=(low, low + width), tilt_deg=(-5.0, top))
    moon = axis(moon_pan, moon_up)
    try:
        plan = plan_pointings(plain_station(), within, count, moon)
    except InputError:
        # a low range, or one that the Moon is in the middle of
        assume(False)
        raise
    assert len(plan) == count
    for one in plan:
        for pan, tilt in (one.before_deg, (one.pan_deg, one.tilt_deg)):
            assert within.pan_deg[0] - 1e-3 <= pan <= within.pan_deg[1] + 1e-3
            assert within.tilt_deg[0] - 1e-3 <= tilt <= within.tilt_deg[1] + 1e-3
        towards = axis(one.pan_deg, one.tilt_deg)
        assert towards[2] >= np.sin(np.radians(LEAST_ALTITUDE_DEG - 0.01))
        assert towards @ moon < np.cos(np.radians(MOON_DEG - 0.01))


def test_the_range_is_filled_evenly_and_each_side_comes_in_turn() -> None:
    plan = plan_pointings(plain_station(), WIDE, 24, None)
    pan, tilt = (np.array([getattr(p, name) for p in plan]) for name in ("pan_deg", "tilt_deg"))
    for values, (low, high) in ((pan, (-60.0, 60.0)), (tilt, (LEAST_ALTITUDE_DEG, 55.0))):
        counts, _ = np.histogram(values, np.linspace(low, high, 4))
        assert counts.min() >= 6
    ways = [(p.pan_from, p.tilt_from) for p in plan]
    assert {ways.count(way) for way in set(ways)} == {6}
    assert len(set(ways)) == 4
    first = plan[0]
    assert first.before_deg == (
        first.pan_deg - APPROACH_DEG * first.pan_from,
        first.tilt_deg - APPROACH_DEG * first.tilt_from,
    )


def test_the_head_goes_once_there_and_once_back() -> None:
    plan = plan_pointings(plain_station(), WIDE, 24, None)
    assert sum(abs(b.pan_deg - a.pan_deg) for a, b in pairwise(plan)) < 2.2 * 120.0


def test_daylight_and_ranges_without_sky_are_refused() -> None:
    with pytest.raises(InputError, match="got the Sun at 3 deg; wanted night"):
        plan_pointings(plain_station(), WIDE, 24, None, 3.0)
    with pytest.raises(InputError, match="wanted a range of 10 deg or more"):
        plan_pointings(plain_station(), HeadRange(pan_deg=(0.0, 2.0), tilt_deg=(10.0, 50.0)), 24, None)
    with pytest.raises(InputError, match="got 0 of 24 pointings"):
        plan_pointings(plain_station(), HeadRange(pan_deg=(-50.0, 50.0), tilt_deg=(-20.0, 5.0)), 24, None)
