"""The contract of a pan-tilt unit: each protocol's tests subclass `PanTiltContract` and give it a rig.

    class TestFlirOnSimulatedUnit(PanTiltContract):
        @pytest.fixture
        def rig(self) -> Iterator[ContractRig]: ...

A rig's unit may be simulated in virtual time, on a pty, or real: the tests take time from `rig.now` and `rig.wait`.
"""

import math
import threading
import time
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import pytest

from ptu_drivers import (
    AngleSample,
    Axis,
    Capability,
    FailureReason,
    LeaseKind,
    LimitError,
    LineError,
    NoReading,
    PanTiltUnit,
    PtuError,
    Reading,
    UnitSettings,
    UnitState,
    UnsupportedError,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractRig:
    """A unit to be tested, with the truth next to it.

    Attributes
    ----------
    open : open the unit with these settings; to be called once per test.
    now, wait : the clock that the unit's instants are on, s.
    truth : axis, instant -> true angle of the unit before sign and zero, rad.
    cut, mend : the line goes dead (bytes are lost both ways), and comes back.
    unplug, plug : every use of the line is an error, and no more.
    trickle : the unit's bytes come so far apart from now on, s; 0 is as usual.
    at : do something at an instant, s, while others wait.
    lease : what stops motion by rate when the host falls silent.
    rest_s : how long that takes at 0.3 of the fastest rate, s.
    time_sigma_s : what the stamps are worth here, s (a pty on a busy machine is worth less than virtual time).
    """

    open: Callable[[UnitSettings], PanTiltUnit]
    now: Callable[[], float]
    wait: Callable[[float], None]
    truth: Callable[[Axis, float], float]
    cut: Callable[[], None]
    mend: Callable[[], None]
    unplug: Callable[[], None]
    plug: Callable[[], None]
    trickle: Callable[[float], None]
    at: Callable[[float, Callable[[], None]], None]
    settings: UnitSettings
    lease: LeaseKind
    rest_s: float = 1.0
    time_sigma_s: float = 0.003


def reading_of(unit: PanTiltUnit) -> Reading:
    """Return a reading; the test fails without one."""
    got = unit.read()
    assert isinstance(got, Reading), got
    return got


def until_still(rig: ContractRig, unit: PanTiltUnit, timeout_s: float = 30.0) -> Reading:
    """Read until both axes repeat themselves for 0.3 s."""
    end, since, last = rig.now() + timeout_s, rig.now(), reading_of(unit)
    while rig.now() < end:
        rig.wait(0.02)
        new = reading_of(unit)
        if (new.pan.angle_rad, new.tilt.angle_rad) != (last.pan.angle_rad, last.tilt.angle_rad):
            since, last = rig.now(), new
        elif rig.now() - since > 0.3:
            return new
    raise AssertionError(f"still moving after {timeout_s} s")


def set_moving(
    rig: ContractRig, unit: PanTiltUnit, *, fraction: float = 0.3, for_s: float = 0.5, by: str = "rate"
) -> None:
    """Turn at a share of the fastest rate, tilt slower, commanded and polled as in the live system; or to an end."""
    reported = unit.describe()
    if by == "position" or Capability.VELOCITY not in reported.capabilities:
        unit.move_to(pan_rad=reported.pan.high_rad, tilt_rad=reported.tilt.high_rad)
        rig.wait(for_s / 2)
        reading_of(unit)
        return
    pan = max(fraction * reported.pan.max_rate_rad_s, reported.pan.min_rate_rad_s)
    tilt = max(0.3 * fraction * reported.tilt.max_rate_rad_s, reported.tilt.min_rate_rad_s)
    end = rig.now() + for_s
    while rig.now() < end:
        unit.move_at(pan_rad_s=pan, tilt_rad_s=tilt)
        reading_of(unit)
        rig.wait(0.03)


def rest_since_s(rig: ContractRig) -> float:
    """Return since when both axes stand, s; the present where one turns."""
    now = rig.now()
    t = now
    here = {axis: rig.truth(axis, now) for axis in Axis}
    while t > now - 30.0 and all(abs(rig.truth(axis, t - 0.005) - here[axis]) < 1e-9 for axis in Axis):
        t -= 0.005
    return t


def is_preempted(unit: PanTiltUnit) -> bool:
    """Return whether a halt waits for the line that another call uses."""
    lock = unit._lock  # type: ignore[attr-defined]
    return bool(lock.is_preempted)


class PanTiltContract:
    """What `PanTiltUnit` promises."""

    @pytest.fixture
    @abstractmethod
    def rig(self) -> ContractRig:
        """Give the rig."""

    def test_the_description_is_complete(self, rig: ContractRig) -> None:
        with rig.open(rig.settings) as unit:
            reported = unit.describe()
            for axis in Axis:
                a = reported.axis(axis)
                assert 0 < a.quantum_rad < 0.01
                assert a.low_rad < a.high_rad
                assert 0 <= a.min_rate_rad_s < a.max_rate_rad_s
            assert Capability.POSITION in reported.capabilities
            assert unit.health().state is UnitState.READY

    def test_angles_are_true_at_their_instants(self, rig: ContractRig) -> None:
        """At rest and in motion: error within 5 sigma of quantum and stamp, at every sample."""
        with rig.open(rig.settings) as unit:
            reported = unit.describe()
            pan = reported.pan.low_rad + 0.6 * (reported.pan.high_rad - reported.pan.low_rad)
            tilt = reported.tilt.low_rad + 0.6 * (reported.tilt.high_rad - reported.tilt.low_rad)
            unit.move_to(pan_rad=pan, tilt_rad=tilt)
            samples: list[AngleSample] = []
            end = rig.now() + 2.0
            while rig.now() < end:
                if isinstance(got := unit.read(), Reading):
                    assert got.sent_s <= min(got.pan.t_s, got.tilt.t_s) + 1e-9
                    assert max(got.pan.t_s, got.tilt.t_s) <= got.answered_s + 1e-9
                    samples += [got.pan, got.tilt]
            assert len(samples) >= 10
            for s in samples:
                rate = reported.axis(s.axis).max_rate_rad_s
                room = 5 * math.hypot(s.sigma_rad, rate * max(s.sigma_t_s, rig.time_sigma_s))
                truth = getattr(rig.settings, s.axis.value).angle(rig.truth(s.axis, s.t_s))
                assert abs(s.angle_rad - truth) < room, (s, truth)

    def test_it_moves_to_commanded_positions(self, rig: ContractRig) -> None:
        with rig.open(rig.settings) as unit:
            unit.move_to(pan_rad=0.1, tilt_rad=-0.05)
            there = until_still(rig, unit)
            assert there.pan.angle_rad == pytest.approx(0.1, abs=2 * unit.describe().pan.quantum_rad)
            assert there.tilt.angle_rad == pytest.approx(-0.05, abs=2 * unit.describe().tilt.quantum_rad)
            unit.move_to(tilt_rad=0.05)
            there = until_still(rig, unit)
            assert there.pan.angle_rad == pytest.approx(0.1, abs=2 * unit.describe().pan.quantum_rad)
            assert there.tilt.angle_rad == pytest.approx(0.05, abs=2 * unit.describe().tilt.quantum_rad)

    def test_sign_and_zero_are_settings(self, rig: ContractRig) -> None:
        turned = replace(rig.settings, pan=replace(rig.settings.pan, sign=-rig.settings.pan.sign, zero_rad=0.02))
        with rig.open(turned) as unit:
            unit.move_to(pan_rad=0.1)
            there = until_still(rig, unit)
            assert there.pan.angle_rad == pytest.approx(0.1, abs=2 * unit.describe().pan.quantum_rad)
            truth = turned.pan.angle(rig.truth(Axis.PAN, there.pan.t_s))
            assert truth == pytest.approx(0.1, abs=0.005)

    def test_beyond_a_limit_is_refused_with_its_name(self, rig: ContractRig) -> None:
        with rig.open(rig.settings) as unit:
            reported = unit.describe()
            before = until_still(rig, unit)
            for axis in Axis:
                a = reported.axis(axis)
                for beyond, name in ((a.high_rad + 0.001, "upper limit"), (a.low_rad - 0.001, "lower limit")):
                    with pytest.raises(LimitError, match=f"{axis.value}.*{name}"):
                        unit.move_to(**{f"{axis.value}_rad": beyond})
            with pytest.raises(LimitError):
                unit.move_to(pan_rad=math.nan)
            after = until_still(rig, unit)
            assert after.pan.angle_rad == before.pan.angle_rad
            assert after.tilt.angle_rad == before.tilt.angle_rad

    def test_soft_limits_narrow_the_units(self, rig: ContractRig) -> None:
        soft = replace(rig.settings, pan=replace(rig.settings.pan, low_rad=-0.1, high_rad=0.1))
        with rig.open(soft) as unit:
            assert unit.describe().pan.high_rad == 0.1
            with pytest.raises(LimitError, match=r"pan.*upper limit.*settings"):
                unit.move_to(pan_rad=0.11)

    def test_halt_stops_it(self, rig: ContractRig) -> None:
        with rig.open(rig.settings) as unit:
            unit.move_to(pan_rad=unit.describe().pan.high_rad)
            rig.wait(0.2)
            unit.halt()
            stopped = until_still(rig, unit)
            assert stopped.pan.angle_rad < unit.describe().pan.high_rad - 0.01

    def test_rates(self, rig: ContractRig) -> None:
        with rig.open(rig.settings) as unit:
            reported = unit.describe()
            if Capability.VELOCITY not in reported.capabilities:
                with pytest.raises(UnsupportedError):
                    unit.move_at(pan_rad_s=0.1, tilt_rad_s=0.0)
                return
            with pytest.raises(LimitError, match=r"pan.*maximum speed"):
                unit.move_at(pan_rad_s=reported.pan.max_rate_rad_s * 1.01, tilt_rad_s=0.0)
            rate = 0.3 * reported.pan.max_rate_rad_s
            for _ in range(10):
                unit.move_at(pan_rad_s=rate, tilt_rad_s=0.0)
                rig.wait(0.05)
            a = reading_of(unit)
            for _ in range(6):
                unit.move_at(pan_rad_s=rate, tilt_rad_s=0.0)
                rig.wait(0.05)
            b = reading_of(unit)
            assert (b.pan.angle_rad - a.pan.angle_rad) / (b.pan.t_s - a.pan.t_s) == pytest.approx(rate, rel=0.1)
            unit.move_at(pan_rad_s=0.0, tilt_rad_s=0.0)
            until_still(rig, unit)

    def test_closing_halts_and_ends_it(self, rig: ContractRig) -> None:
        unit = rig.open(rig.settings)
        unit.move_to(pan_rad=unit.describe().pan.high_rad)
        rig.wait(0.1)
        unit.close()
        rig.wait(1.0)
        stopped = rig.truth(Axis.PAN, rig.now())
        rig.wait(0.5)
        assert rig.truth(Axis.PAN, rig.now()) == stopped
        unit.close()
        for closed in (unit.read, unit.halt, lambda: unit.move_to(pan_rad=0.0)):
            with pytest.raises(LineError):
                closed()

    def test_an_error_inside_halts_it_and_is_raised(self, rig: ContractRig) -> None:
        def work() -> None:
            with rig.open(rig.settings) as unit:
                unit.move_to(pan_rad=unit.describe().pan.high_rad)
                rig.wait(0.1)
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            work()
        rig.wait(1.0)
        stopped = rig.truth(Axis.PAN, rig.now())
        rig.wait(0.5)
        assert rig.truth(Axis.PAN, rig.now()) == stopped

    def test_a_dead_line_gives_no_angle_and_recovers(self, rig: ContractRig) -> None:
        with rig.open(rig.settings) as unit:
            reading_of(unit)
            rig.cut()
            end = rig.now() + 1.5
            while rig.now() < end:
                asked = rig.now()
                got = unit.read()
                assert isinstance(got, NoReading)
                assert rig.now() - asked <= unit.describe().reply_timeout_s + 0.05
                if rig.now() == asked:
                    rig.wait(0.01)
            with pytest.raises(PtuError):
                unit.move_to(pan_rad=0.0)
            rig.mend()
            back = rig.now()
            while not isinstance(unit.read(), Reading):
                assert rig.now() - back < 2.0
                rig.wait(0.01)
            counts = unit.health()
            assert sum(counts.failures.values()) > 0
            assert set(counts.failures) <= set(FailureReason)
            assert counts.readings >= 2

    def test_it_stops_when_its_host_dies(self, rig: ContractRig) -> None:
        """No further call, no driver's watchdog: only the unit's time passes. A unit that cannot stop states so."""
        with rig.open(rig.settings) as unit:
            reported = unit.describe()
            assert reported.lease.kind is rig.lease
            assert (Capability.VELOCITY in reported.capabilities) is (rig.lease is not LeaseKind.NO_RATES)
            if rig.lease is LeaseKind.NO_RATES:
                assert reported.lease.stop_s == math.inf
                return
            for fraction in (0.3, 0.02):
                set_moving(rig, unit, fraction=fraction)
                died = rig.now()
                rig.wait(3.0)
                rest = rest_since_s(rig) - died
                if rig.lease is LeaseKind.NONE:
                    assert reported.lease.stop_s == math.inf
                    assert rest == 3.0
                else:
                    assert 0.1 < rest <= min(rig.rest_s, reported.lease.stop_s)
                    # and it executes commands again
                    unit.halt()
                    until_still(rig, unit)

    def test_a_renewed_rate_continues(self, rig: ContractRig) -> None:
        """What ends by itself must not end, nor falter, while it is renewed as seldom as is allowed."""
        with rig.open(rig.settings) as unit:
            reported = unit.describe()
            if Capability.VELOCITY not in reported.capabilities:
                return
            rate = 0.1 * reported.pan.max_rate_rad_s
            begun = reached = rig.now()
            while rig.now() < begun + 3.0:
                if rig.now() >= reached:
                    unit.move_at(pan_rad_s=rate, tilt_rad_s=0.0)
                    reached = rig.now() + 0.15
                unit.read()
                rig.wait(0.01)
            # a unit that takes ten commands a second sets off a second later
            steps = [begun + 1.5 + 0.1 * k for k in range(15)]
            rates = [(rig.truth(Axis.PAN, t + 0.1) - rig.truth(Axis.PAN, t)) / 0.1 for t in steps]
            assert min(map(abs, rates)) > 0.9 * max(map(abs, rates))

    @pytest.mark.parametrize("by", ["rate", "position"])
    def test_a_trickling_reply_delays_nothing(self, rig: ContractRig, by: str) -> None:
        """A byte every 0.15 s: never silent, never complete. Each call ends in its time, and a halt is received."""
        with rig.open(rig.settings) as unit:
            bound = unit.describe().reply_timeout_s
            set_moving(rig, unit, by=by)
            rig.trickle(0.15)
            asked = rig.now()
            assert isinstance(unit.read(), NoReading)
            assert rig.now() - asked <= bound + 0.05
            asked = rig.now()
            with suppress(PtuError):
                unit.halt()
            assert rig.now() - asked <= 3 * bound + 0.1
            rig.wait(2.0)
            # out at once: what remains is braking
            assert rest_since_s(rig) < asked + 1.0
            for _ in range(5):
                asked = rig.now()
                assert isinstance(unit.read(), NoReading)
                assert rig.now() - asked <= bound + 0.05
            rig.trickle(0.0)
            back = rig.now()
            while not isinstance(unit.read(), Reading):
                assert rig.now() - back < 3.0
                rig.wait(0.01)

    @pytest.mark.parametrize("by", ["rate", "position"])
    def test_a_halt_overtakes_a_read(self, rig: ContractRig, by: str) -> None:
        """Another thread's halt while an answer is awaited that would take seconds."""
        commanded_s: list[float] = []
        with rig.open(replace(rig.settings, reply_timeout_s=3.0)) as unit:

            def halt() -> None:
                with suppress(PtuError):
                    unit.halt()

            halting = threading.Thread(target=halt)

            def tell() -> None:
                commanded_s.append(rig.now())
                halting.start()
                limit = time.monotonic() + 60.0
                while not is_preempted(unit) and time.monotonic() < limit:
                    time.sleep(0.001)

            set_moving(rig, unit, by=by)
            rig.trickle(0.15)
            rig.at(rig.now() + 0.05, tell)
            got = unit.read()
            let_go = rig.now()
            halting.join(60.0)
            assert isinstance(got, NoReading)
            assert got.reason is FailureReason.PREEMPTED
            assert let_go - commanded_s[0] <= 0.15
            assert rest_since_s(rig) < commanded_s[0] + 1.0
            rig.trickle(0.0)

    @pytest.mark.parametrize("how", ["unplugged", "silent"])
    def test_no_motion_by_rate_outlives_a_lost_line(self, rig: ContractRig, how: str) -> None:
        """The line is lost in motion and comes back: what was commanded before is halted, not gone on with."""
        with rig.open(replace(rig.settings, watchdog_s=60.0)) as unit:
            if Capability.VELOCITY not in unit.describe().capabilities:
                return
            set_moving(rig, unit, fraction=0.1)
            (rig.unplug if how == "unplugged" else rig.cut)()
            lost = rig.now()
            while unit.health().state is not UnitState.LINE_LOST:
                assert isinstance(unit.read(), NoReading)
                assert rig.now() - lost < 5.0
            (rig.plug if how == "unplugged" else rig.mend)()
            while not isinstance(unit.read(), Reading):
                assert rig.now() - lost < 8.0
            back = rig.now()
            # polled all the time, which renews a unit's own watchdog
            while rig.now() < back + 2.0:
                unit.read()
                rig.wait(0.02)
            assert rest_since_s(rig) < back + 1.0
