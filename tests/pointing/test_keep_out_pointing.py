"""A head that follows, searches and parks with zones closed to its lens: never in them, and round them to its goal."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.geometry.aim import aim_at
from groundstation.live.keep_out_unit import KeepOutError, KeepOutUnit
from groundstation.messages import PtuSample, Purpose
from groundstation.pointing.detour import DetourPlanner
from groundstation.pointing.head_limits import AxisLimits, HeadLimits
from groundstation.pointing.keep_out import KeepOut, Sector, SunZone
from groundstation.pointing.keep_out_pointing import PLAN_MARGIN_RAD
from groundstation.pointing.pointing_law import HeadController, PointingConfig
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from ptu_drivers.messages import Reading
from tests.live.test_keep_out_unit import LENS, NOON_S, PLACE, insist_outside, zones
from tests.live.turning_unit import TurningUnit
from tests.stereo_rig import make_rig

DEG = math.radians(1.0)
GEOMETRY = make_rig().stations[0].geometry()
HEAD = HeadLimits(
    pan=AxisLimits(low_rad=-170 * DEG, high_rad=170 * DEG, fastest_rad_s=60 * DEG, acceleration_rad_s2=60 * DEG),
    tilt=AxisLimits(low_rad=-30 * DEG, high_rad=90 * DEG, fastest_rad_s=60 * DEG, acceleration_rad_s2=60 * DEG),
)


class Flight:
    """A controller, a guarded unit, and time: read at 50 Hz, commanded at 33 Hz."""

    def __init__(self, keep_out: KeepOut, start_deg: tuple[float, float]) -> None:
        self.unit = TurningUnit(*start_deg)
        self.keep_out = keep_out
        self.guard = KeepOutUnit(self.unit, keep_out, self.unit.clock, watch=False)
        self.controller = HeadController(GEOMETRY, HEAD, PointingConfig(latency_s=0.03), keep_out)
        self.purposes: list[Purpose] = []
        self.refusals: list[str] = []

    def fly(self, seconds: float, goal, *, by_rate: bool = True) -> None:  # type: ignore[no-untyped-def]
        """``goal`` makes a command at a time."""
        for k in range(round(seconds / 0.03)):
            self.unit.run(0.02 if k % 2 else 0.04)
            got = self.guard.read()
            assert isinstance(got, Reading)
            sample = PtuSample(
                t_s=self.unit.now_s, station="left", pan_rad=got.pan.angle_rad, tilt_rad=got.tilt.angle_rad
            )
            self.controller.read(sample)
            command = goal(self.unit.now_s)
            self.purposes.append(command.purpose)
            try:
                if command.purpose is Purpose.HOLD:
                    self.guard.halt()
                elif by_rate:
                    self.guard.move_at(pan_rad_s=command.pan_rate_rad_s, tilt_rad_s=command.tilt_rate_rad_s)
                else:
                    self.guard.move_to(pan_rad=command.pan_rad, tilt_rad=command.tilt_rad)
            except KeepOutError as fault:
                self.refusals.append(str(fault))

    def park(self, pan_deg: float, tilt_deg: float):  # type: ignore[no-untyped-def]
        return lambda t_s: self.controller.go_to(t_s, pan_deg * DEG, tilt_deg * DEG, Purpose.PARK)

    def off_deg(self, pan_deg: float, tilt_deg: float) -> float:
        return float(np.abs(np.degrees(self.unit.angles) - [pan_deg, tilt_deg]).max())


def low_sun(elevation_deg: float = 8.0, angle_deg: float = 15.0) -> KeepOut:
    """The Sun so high over +y, some time after noon."""
    for minute in range(600):
        at = PLACE.angles(NOON_S + 60.0 * minute)
        if at.elevation_rad < elevation_deg * DEG:
            break
    place = type(PLACE)(
        lat_deg=PLACE.lat_deg,
        lon_deg=PLACE.lon_deg,
        height_m=PLACE.height_m,
        y_axis_azimuth_deg=math.degrees(at.azimuth_rad),
    )
    sun = SunZone(sun=place, angle_rad=angle_deg * DEG)
    return KeepOut(lens=LENS, sun=sun, sectors=(), utc_zero_s=NOON_S + 60.0 * minute)


@pytest.mark.parametrize("sun", [SunZone(sun=PLACE, angle_rad=10 * DEG), None])
@pytest.mark.parametrize("sectors", [0, 1, 2])
def test_one_pair_of_angles_is_as_far_out_as_in_an_array(
    sun: SunZone | None, sectors: int, rng: np.random.Generator
) -> None:
    """Expected: to the last bit, all round; and what is no angle is nowhere clear in either way."""
    corners = rng.uniform([-2.5, -0.5], [2.0, 1.0], (sectors, 2)).tolist()
    closed = tuple(Sector(pan_rad=(pan, pan + 0.8), tilt_rad=(tilt, tilt + 0.3)) for pan, tilt in corners)
    found = KeepOut(lens=LENS, sun=sun, sectors=closed, utc_zero_s=NOON_S).zones(0.0)
    for pan, tilt in [*rng.uniform([-7.0, -2.0], [7.0, 2.0], (300, 2)), (math.nan, 0.0), (0.0, math.nan)]:
        one, array = found.at((pan, tilt)), float(found.clearance(np.array(pan), np.array(tilt)))
        assert one == array or (math.isnan(one) and math.isnan(array))


@settings(max_examples=25, deadline=None)
@given(
    zones,
    st.tuples(st.floats(-150.0, 150.0), st.floats(-20.0, 80.0)),
    st.tuples(st.floats(-170.0, 170.0), st.floats(-30.0, 90.0)),
    st.booleans(),
)
def test_parking_and_following_never_enter_a_zone(
    keep_out: KeepOut, start: tuple[float, float], park: tuple[float, float], by_rate: bool
) -> None:
    flight = Flight(keep_out, start)

    def passing(t_s: float) -> np.ndarray:
        return np.array([-300.0 + 60.0 * t_s, 200.0, 40.0])

    flight.fly(6.0, flight.park(*park), by_rate=by_rate)
    flight.fly(6.0, lambda t_s: flight.controller.follow(t_s, passing), by_rate=by_rate)
    insist_outside(flight.unit, keep_out)


@pytest.mark.parametrize("by_rate", [True, False])
@pytest.mark.parametrize("goal", [(60.0, 0.0), (60.0, -10.0), (50.0, 8.0)])
def test_it_goes_round_the_sun_over_the_horizon(goal: tuple[float, float], by_rate: bool) -> None:
    """From one side to the other at the Sun's own height, within 12 s: below it the head's limit is in the way."""
    keep_out = low_sun(elevation_deg=2.0, angle_deg=30.0)
    flight = Flight(keep_out, (-60.0, 0.0))
    flight.fly(12.0, flight.park(*goal), by_rate=by_rate)
    assert flight.off_deg(*goal) < 1.0
    insist_outside(flight.unit, keep_out)
    if by_rate:
        # the unit refuses no command of the controller
        assert not flight.refusals
        assert flight.guard.stops == 0


def test_a_target_that_passes_before_the_sun_is_waited_for_at_the_edge() -> None:
    keep_out = low_sun()
    flight = Flight(keep_out, (40.0, 5.0))

    def passing(t_s: float) -> np.ndarray:
        return np.array([-150.0 + 15.0 * t_s, 200.0, 25.0])

    flight.fly(4.0, lambda t_s: flight.controller.follow(t_s, passing))
    aim = aim_at(GEOMETRY, passing(flight.unit.now_s))
    assert aim is not None
    assert flight.off_deg(math.degrees(aim.pan_rad), math.degrees(aim.tilt_rad)) < 1.0
    flight.fly(6.0, lambda t_s: flight.controller.follow(t_s, passing))
    assert flight.controller.keep_out is not None
    assert flight.controller.keep_out.held.startswith("held outside the Sun (")
    flight.fly(9.0, lambda t_s: flight.controller.follow(t_s, passing))
    aim = aim_at(GEOMETRY, passing(flight.unit.now_s))
    assert aim is not None
    assert flight.off_deg(math.degrees(aim.pan_rad), math.degrees(aim.tilt_rad)) < 1.0
    assert flight.controller.keep_out.held == ""
    insist_outside(flight.unit, keep_out)
    assert not flight.refusals


def test_a_target_that_stays_in_a_closed_sector_is_not_followed_and_the_head_stands_still() -> None:
    closed = Sector(pan_rad=(-10 * DEG, 10 * DEG), tilt_rad=(-30 * DEG, 40 * DEG))
    keep_out = KeepOut(lens=LENS, sun=None, sectors=(closed,), utc_zero_s=NOON_S)
    flight = Flight(keep_out, (-40.0, 5.0))
    there = GEOMETRY.packed[9:12] + np.array([0.0, 200.0, 20.0])
    flight.fly(9.0, lambda t_s: flight.controller.follow(t_s, lambda _: there))
    assert flight.purposes[-1] is Purpose.HOLD
    assert flight.controller.keep_out is not None
    assert flight.controller.keep_out.held.startswith("held outside sector 1 (")
    assert not np.any(flight.unit.rates)
    assert flight.off_deg(-10.0, 5.0) < 4.0
    insist_outside(flight.unit, keep_out)


def test_a_head_at_rest_is_moved_out_of_the_suns_way() -> None:
    """Held without a target, half a degree off the edge: it leaves by itself, as far as the plan keeps off."""
    keep_out = low_sun()
    pans = np.linspace(0.0, 40.0, 4001)
    away = keep_out.zones(0.0).clearance(pans * DEG, np.full(4001, 5.0 * DEG))
    flight = Flight(keep_out, (float(pans[np.argmin(np.abs(away - 0.5 * DEG))]), 5.0))
    flight.fly(4.0, flight.controller.hold)
    assert Purpose.KEEP_OUT in flight.purposes
    assert flight.purposes[-1] is Purpose.HOLD
    left = keep_out.zones(flight.unit.now_s).at((float(flight.unit.angles[0]), float(flight.unit.angles[1])))
    assert math.degrees(left) == pytest.approx(1.0, abs=0.15)
    assert not flight.refusals


@pytest.mark.parametrize(("low_deg", "high_deg", "goal_deg"), [(-78.0, 258.0, 230.0), (0.0, 360.0, 300.0)])
def test_a_way_leads_beyond_half_a_turn_where_the_readings_do(low_deg: float, high_deg: float, goal_deg: float) -> None:
    """Expected: a unit that counts from another zero gets to all of its range, round what is closed in it."""
    closed = Sector(pan_rad=(170.0 * DEG, 200.0 * DEG), tilt_rad=(-30.0 * DEG, 20.0 * DEG))
    keep_out = KeepOut(lens=LENS, sun=None, sectors=(closed,), utc_zero_s=NOON_S)
    planner = DetourPlanner(np.array([low_deg, -30.0]) * DEG, np.array([high_deg, 90.0]) * DEG, PLAN_MARGIN_RAD)
    at, goal, zones_now = np.array([100.0, 0.0]) * DEG, np.array([goal_deg, 0.0]) * DEG, keep_out.zones(0.0)
    for _ in range(10):
        way = planner.next(0.0, zones_now, at, goal)
        assert planner.sees(zones_now, at, way.angles_rad)
        at = way.angles_rad
        if way.reaches:
            break
    np.testing.assert_allclose(np.degrees(at), [goal_deg, 0.0], atol=1e-6)


def test_the_search_skips_closed_zones() -> None:
    """A sweep over 40° with 20° of it closed: no time goes by in which all would wait."""
    pattern = SearchPattern({"left": GEOMETRY}, SearchConfig(azimuth_deg=(-20.0, 20.0), dwell_s=1.0))

    def allowed(point: np.ndarray) -> bool:
        return abs(math.degrees(math.atan2(point[0], point[1]))) > 10.0

    times = np.arange(0.0, 60.0, 0.1)
    assert not all(allowed(pattern.point(t)) for t in times)
    looked = [pattern.point(t + pattern.ahead_s(float(t), allowed)) for t in times]
    assert all(allowed(p) for p in looked)
    assert pattern.ahead_s(0.0, lambda _: False) == 0.0
    sides = {math.copysign(1.0, p[0]) for p in looked}
    assert sides == {-1.0, 1.0}


def test_a_closed_zone_costs_the_search_no_time() -> None:
    """Expected: what is open is swept as fast as without the zone, and no time is spent at its edge."""
    pattern = SearchPattern({"left": GEOMETRY}, SearchConfig(azimuth_deg=(-20.0, 20.0), dwell_s=1.0))

    def off_deg(point: np.ndarray) -> float:
        return abs(math.degrees(math.atan2(point[0], point[1])))

    ahead_s, looked = 0.0, []
    for t in np.arange(0.0, 120.0, 0.1).tolist():
        ahead_s = pattern.ahead_s(t, lambda point: off_deg(point) > 10.0, ahead_s)
        looked.append(off_deg(pattern.point(t + ahead_s)))
    assert min(looked) > 10.0
    swept = [off_deg(pattern.point(t)) for t in np.arange(0.0, 120.0, 0.1).tolist()]
    shares = [np.mean([a < 13.0 for a in part if a > 10.0]) for part in (looked, swept)]
    assert shares[0] == pytest.approx(shares[1], abs=0.15)
