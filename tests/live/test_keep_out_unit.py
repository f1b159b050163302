"""No command turns a lens within the set angle of the Sun, or into a sector: by the log of the unit itself."""

import copy
import math
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.live.keep_out_unit import KeepOutError, KeepOutUnit
from groundstation.pointing.keep_out import KeepOut, LensAxis, Sector, SunZone
from groundstation.pointing.sun import SunOverPlace
from ptu_drivers.health import FailureReason, UnitState
from ptu_drivers.lease import Lease, LeaseKind
from ptu_drivers.messages import NoReading
from tests.live.turning_unit import TurningUnit
from tests.stereo_rig import make_rig

LENS = LensAxis.of(make_rig().stations[0].geometry())
NOON_S = 1_782_036_000.0  # 2026-06-21 10:00 UTC
PLACE = SunOverPlace(lat_deg=47.1, lon_deg=8.6, height_m=480.0, y_axis_azimuth_deg=35.0)
RATE = math.radians(20.0)

angles = st.tuples(st.floats(-150.0, 150.0), st.floats(-20.0, 80.0))
rates = st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
places = st.builds(
    SunOverPlace,
    lat_deg=st.floats(-70.0, 70.0),
    lon_deg=st.floats(-180.0, 180.0),
    height_m=st.floats(0.0, 3000.0),
    y_axis_azimuth_deg=st.floats(0.0, 360.0),
)
sectors = st.builds(
    lambda pan, tilt, wide, high: Sector(
        pan_rad=(math.radians(pan), math.radians(pan + wide)), tilt_rad=(math.radians(tilt), math.radians(tilt + high))
    ),
    st.floats(-120.0, 90.0),
    st.floats(-20.0, 50.0),
    st.floats(2.0, 60.0),
    st.floats(2.0, 40.0),
)
zones = st.builds(
    lambda place, angle, closed, hours: KeepOut(
        lens=LENS,
        sun=None if angle < 2.0 else SunZone(sun=place, angle_rad=math.radians(angle)),
        sectors=tuple(closed),
        utc_zero_s=NOON_S + 3600.0 * hours,
    ),
    places,
    st.floats(0.0, 25.0),
    st.lists(sectors, max_size=2),
    st.floats(0.0, 8760.0),
)


def kept(unit: TurningUnit, keep_out: KeepOut) -> KeepOutUnit:
    return KeepOutUnit(unit, keep_out, unit.clock, watch=False)


def clearances(unit: TurningUnit, keep_out: KeepOut) -> np.ndarray:
    """How far outside the lens was all the time, rad; far from a zone with the Sun where it stood at the start."""
    t_s, pan, tilt = np.array(unit.log[::2]).T
    # in a minute the Sun moves by a quarter of a degree; its exact position matters near a zone only
    assert t_s[-1] - t_s[0] < 60.0
    away = keep_out.zones(t_s[0]).clearance(pan, tilt)
    near = np.flatnonzero(away < max(away.min(), 0.0) + math.radians(1.0))
    # and within a twentieth of a second by less than 0.001°
    moment = np.round(20.0 * t_s[near])
    for one in np.unique(moment):
        k = near[moment == one]
        away[k] = keep_out.zones(one / 20.0).clearance(pan[k], tilt[k])
    return away


def insist_outside(unit: TurningUnit, keep_out: KeepOut) -> None:
    """Outside all the time; or, from inside, further out all the time until outside for good."""
    away = np.minimum(clearances(unit, keep_out), 0.0)
    assert np.all(np.diff(away) >= -math.radians(0.02)), np.degrees(away.min())
    if away[0] == 0.0:
        # a start on the edge itself is outside to within rounding
        assert np.all(np.abs(away) < 1e-12), np.degrees(away.min())


def obeyed(unit: KeepOutUnit, way: str, values: tuple[float, float]) -> bool:
    first, second = (math.radians(v) for v in values)
    try:
        if way == "to":
            unit.move_to(pan_rad=first, tilt_rad=second)
        elif way == "pan":
            unit.move_to(pan_rad=first)
        else:
            unit.move_at(pan_rad_s=first, tilt_rad_s=second)
    except KeepOutError:
        return False
    return True


commands = st.one_of(
    st.tuples(st.just("to"), angles), st.tuples(st.just("pan"), angles), st.tuples(st.just("at"), rates)
)


@settings(max_examples=60, deadline=None)
@given(
    zones,
    angles,
    st.lists(st.tuples(commands, st.floats(0.05, 1.5)), min_size=1, max_size=8),
    st.floats(20.0, 120.0),
    st.floats(0.0, 0.08),
)
def test_whatever_is_commanded_the_lens_stays_outside(
    keep_out: KeepOut,
    start: tuple[float, float],
    orders: list[tuple[tuple[str, tuple[float, float]], float]],
    acceleration_deg_s2: float,
    latency_s: float,
) -> None:
    """Rates and positions one after the other, in motion too, rates repeated as a worker does; read at 50 Hz."""
    unit = TurningUnit(*start, acceleration_deg_s2=acceleration_deg_s2, latency_s=latency_s)
    guard = kept(unit, keep_out)
    guard.read()
    for (way, values), seconds in orders:
        obeyed(guard, way, values)
        for _ in range(math.ceil(seconds / 0.02)):
            unit.run(0.02)
            guard.read()
            if way == "at":
                obeyed(guard, way, values)
    insist_outside(unit, keep_out)


def sun_at(t_s: float) -> tuple[float, float]:
    """Pan and tilt of the lens that points into the Sun, deg, of the zones below."""
    direction = PLACE.direction_runway(NOON_S + t_s)
    base = LENS.base_from_runway @ direction
    return math.degrees(math.atan2(-base[0], base[1])), math.degrees(math.asin(base[2]))


def about_the_sun(angle_deg: float = 10.0) -> KeepOut:
    return KeepOut(lens=LENS, sun=SunZone(sun=PLACE, angle_rad=math.radians(angle_deg)), sectors=(), utc_zero_s=NOON_S)


def settled(unit: TurningUnit, guard: KeepOutUnit, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        unit.run(0.02)
        guard.read()


def test_the_suns_angles_are_the_lenses() -> None:
    """The angles of `sun_at` put the optical axis on the Sun, to a boresight's error."""
    pan, tilt = (math.radians(a) for a in sun_at(0.0))
    zones_now = about_the_sun().zones(0.0)
    assert zones_now.at((pan, tilt)) < math.radians(-8.0)


@given(angles, angles)
def test_nothing_outside_is_refused(start: tuple[float, float], goal: tuple[float, float]) -> None:
    """Expected: a move is let through if all between, by either axis first, is 1.5° clear; by day and by night."""
    for keep_out in (about_the_sun(), about_the_sun().since(12 * 3600.0)):
        unit = TurningUnit(*start)
        guard = kept(unit, keep_out)
        pan = np.radians(np.linspace(start[0], goal[0], 120))[:, None]
        tilt = np.radians(np.linspace(start[1], goal[1], 120))[None, :]
        if keep_out.zones(0.0).clearance(pan, tilt).min() > math.radians(1.5):
            assert obeyed(guard, "to", goal)


@pytest.mark.parametrize(("rate_deg_s", "room_deg"), [(5.0, 5.0), (20.0, 20.0), (40.0, 45.0)])
def test_a_rate_towards_the_sun_is_executed_as_long_as_it_can_be_stopped(rate_deg_s: float, room_deg: float) -> None:
    pan, tilt = sun_at(0.0)
    unit = TurningUnit(pan - 10.5 / math.cos(math.radians(tilt)) - room_deg / math.cos(math.radians(tilt)), tilt)
    guard = kept(unit, about_the_sun())
    guard.read()
    assert obeyed(guard, "at", (rate_deg_s, 0.0))
    taken = 0
    while taken < 1000 and obeyed(guard, "at", (rate_deg_s, 0.0)):
        settled(unit, guard, 0.02)
        taken += 1
    assert 5 < taken < 1000
    settled(unit, guard, 2.0)
    away = clearances(unit, about_the_sun())
    assert away.min() > 0.0
    # and it came near: only the lease, the check's period and the braking keep it off
    reach = rate_deg_s * 0.8 + rate_deg_s**2 / 120.0 + 0.5
    assert math.degrees(away.min()) < reach
    assert np.all(unit.rates == 0.0)


def test_without_further_commands_motion_is_halted_before_it() -> None:
    """Without the unit's own watchdog: a rate that continues without end is stopped by the readings."""
    pan, tilt = sun_at(0.0)
    unit = TurningUnit(pan - 60.0, tilt)
    reported: list[str] = []
    guard = KeepOutUnit(unit, about_the_sun(), unit.clock, watch=False, report=reported.append)
    guard.read()
    guard.move_at(pan_rad_s=RATE, tilt_rad_s=0.0)
    settled(unit, guard, 6.0)
    assert clearances(unit, about_the_sun()).min() > 0.0
    assert guard.stops >= 1
    assert reported[0].startswith("halted before the Sun (")


def test_a_line_that_falls_silent_halts_it_earlier() -> None:
    pan, tilt = sun_at(0.0)
    unit = TurningUnit(pan - 60.0, tilt)
    guard = kept(unit, about_the_sun())
    guard.read()
    guard.move_at(pan_rad_s=RATE, tilt_rad_s=0.0)
    settled(unit, guard, 0.5)
    unit.silent = True
    settled(unit, guard, 6.0)
    assert clearances(unit, about_the_sun()).min() > 0.0
    with pytest.raises(KeepOutError, match="no angles"):
        guard.move_at(pan_rad_s=-RATE, tilt_rad_s=0.0)


@pytest.mark.parametrize("renewed_s", [0.5, 1.0])
def test_a_host_that_dies_at_any_moment_leaves_the_lens_outside(renewed_s: float) -> None:
    """The unit holds its rate until its own lease ends, and brakes then."""
    pan, tilt = sun_at(0.0)
    lease = Lease(kind=LeaseKind.SHORT_MOVES, renewed_s=renewed_s, stop_s=renewed_s + 0.5)
    nearest = np.inf
    unit = TurningUnit(pan - 60.0, tilt, lease=lease)
    guard = kept(unit, about_the_sun())
    guard.read()
    guard.move_at(pan_rad_s=RATE, tilt_rad_s=0.0)
    for _ in range(40):
        abandoned = copy.deepcopy(unit)
        abandoned.run(renewed_s)
        abandoned.halt()
        abandoned.run(2.0)
        nearest = min(nearest, clearances(abandoned, about_the_sun()).min())
        settled(unit, guard, 0.1)
    assert 0.0 < nearest < math.radians(20.0)


def test_short_steps_lead_no_further_in_than_a_long_one() -> None:
    """Within the margin: twenty thousand steps of 0.0019°, each within a tolerance, led 15° into a sector."""
    sector = Sector(pan_rad=(0.0, math.radians(20.0)), tilt_rad=(math.radians(-90.0), math.radians(90.0)))
    closed = KeepOut(lens=LENS, sun=None, sectors=(sector,), utc_zero_s=NOON_S).zones(0.0)
    margin, step = math.radians(0.3), math.radians(0.0019)
    for at_deg in (-0.2, 0.0, 1.0):
        here = (math.radians(at_deg), 0.0)
        assert not closed.box_is_clear(here, (here[0] + step, 0.0), margin)
        assert closed.box_is_clear(here, (here[0] - step, 0.0), margin)
        assert closed.box_is_clear(here, (here[0], step), margin)
        way = np.array([here, (here[0] + step, 0.0)])
        assert not closed.way_is_clear(way, margin)
        assert closed.way_is_clear(way[::-1], margin)


def test_from_inside_only_ways_out_are_let_through() -> None:
    pan, tilt = sun_at(0.0)
    unit = TurningUnit(pan + 3.0, tilt)
    guard = kept(unit, about_the_sun())
    guard.read()
    assert guard.inside().startswith("the lens is inside the Sun (")
    assert not obeyed(guard, "pan", (pan - 90.0, 0.0))
    assert not obeyed(guard, "at", (-5.0, 0.0))
    assert obeyed(guard, "at", (5.0, 0.0))
    settled(unit, guard, 0.2)
    assert obeyed(guard, "pan", (pan + 60.0, 0.0))
    settled(unit, guard, 6.0)
    assert guard.inside() == ""
    insist_outside(unit, about_the_sun())


def test_the_sun_reaching_a_standing_head_is_detected() -> None:
    pan, tilt = sun_at(3600.0)
    unit = TurningUnit(pan, tilt)
    keep_out = about_the_sun()
    guard = kept(unit, keep_out)
    guard.read()
    assert guard.inside() == ""
    unit.now_s = 3600.0
    guard.read()
    assert "inside the Sun" in guard.inside()


def test_homing_is_refused_while_anything_is_closed() -> None:
    unit = TurningUnit(0.0, 0.0)
    with pytest.raises(KeepOutError, match="home"):
        kept(unit, about_the_sun()).home()
    night = about_the_sun().since(12 * 3600.0)
    kept(unit, night).home()


def test_a_sector_counts_modulo_a_turn() -> None:
    closed = Sector(pan_rad=(math.radians(170.0), math.radians(190.0)), tilt_rad=(0.0, 0.5))
    for pan_deg in (-180.0, 180.0, 540.0):
        assert closed.clearance(np.radians(pan_deg), np.float64(0.2)) == pytest.approx(math.radians(-10.0))
    assert closed.clearance(np.radians(-165.0), np.float64(0.2)) == pytest.approx(math.radians(5.0))
    assert closed.clearance(np.radians(180.0), np.float64(0.7)) == pytest.approx(0.2)


def test_a_halt_waits_behind_no_reading() -> None:
    """A unit whose answer does not come holds the reading thread; the halt goes out all the same."""
    unit = TurningUnit(0.0, 0.0)
    asked, answered, halted = threading.Event(), threading.Event(), threading.Event()

    def slow_read() -> NoReading:
        asked.set()
        assert answered.wait(60.0)
        return NoReading(reason=FailureReason.TIMEOUT, state=UnitState.RESYNCHRONISING, t_s=0.0)

    unit.read = slow_read  # type: ignore[method-assign]
    unit.halt = halted.set  # type: ignore[method-assign]
    guard = kept(unit, about_the_sun())
    reading = threading.Thread(target=guard.read)
    halting = threading.Thread(target=guard.halt)
    reading.start()
    assert asked.wait(60.0)
    halting.start()
    halting.join(60.0)
    assert halted.is_set()
    assert not halting.is_alive()
    answered.set()
    reading.join(60.0)
