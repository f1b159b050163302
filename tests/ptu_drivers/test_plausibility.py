"""The plausibility test and the instants: accepted, queried again, impossible."""

import math
import random

import pytest

from ptu_drivers import FailureReason, NoReading, Reading, UnitSettings
from ptu_drivers.angle_timestamps import DeviceClock, Latency, query_instant
from ptu_drivers.flir.setup import connect
from ptu_drivers.messages import AngleSource
from ptu_drivers.plausibility import AngleVerdict, Plausibility, Point
from ptu_drivers.simulated.axis import SimulatedAxis
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine


def at(t_s: float, angle: float) -> Point:
    return Point(t_s=t_s, sigma_t_s=0.0003, angle=angle)


def gate() -> Plausibility:
    return Plausibility(quantum=1.0, max_rate=8000, max_acceleration=8000)


def test_no_true_motion_is_ever_called_impossible() -> None:
    rnd = random.Random(2)
    axis = SimulatedAxis(low=-30000, high=30000, rate=8000, max_rate=8000, acceleration=8000)
    g, t, confirmed = gate(), 0.0, 0
    g.accept(at(0.0, 0.0))
    for _ in range(4000):
        if rnd.random() < 0.02:
            axis.move_to(t, rnd.uniform(-30000, 30000))
        t += rnd.uniform(0.01, 0.06)
        point = at(t, round(axis.motor(t + rnd.gauss(0.0, 0.0003))))
        verdict = g.judge(point)
        assert verdict is not AngleVerdict.IMPOSSIBLE
        if verdict is AngleVerdict.CONFIRM:
            confirmed += 1
            t += 0.02
            again = at(t, round(axis.motor(t + rnd.gauss(0.0, 0.0003))))
            assert g.confirms(point, again)
            point = again
        g.accept(point)
    assert 50 < confirmed < 2000


def test_a_lost_digit_is_impossible_or_unconfirmed() -> None:
    """All counts at rest that lose a digit: nothing gets through but a sign at one count."""
    for true in range(-3000, 3001, 7):
        text = str(true)
        for k in range(len(text)):
            rest = text[:k] + text[k + 1 :]
            if rest in ("", "-") or int(rest) == true:
                continue
            g = gate()
            for n in range(3):
                g.accept(at(0.03 * n, true))
            wrong, again = at(0.09, int(rest)), at(0.105, true)
            verdict = g.judge(wrong)
            passed = verdict is AngleVerdict.PLAUSIBLE or (verdict is AngleVerdict.CONFIRM and g.confirms(wrong, again))
            assert not passed or abs(int(rest) - true) <= 9, (true, rest)


@pytest.mark.parametrize("way", [1, -1])
def test_an_impossible_rate_stays_impossible_when_repeated(way: int) -> None:
    """At most 1.1 times the fastest, two steps and what the instants leave open: 456 counts in 0.05 s."""
    for moved, verdict in ((440, AngleVerdict.CONFIRM), (452, AngleVerdict.CONFIRM), (460, AngleVerdict.IMPOSSIBLE)):
        g = gate()
        g.accept(at(0.0, 100))
        g.accept(at(0.05, 100))
        assert g.judge(at(0.1, 100 + way * moved)) is verdict, moved
    # without time between them only the steps and the instants count
    g = gate()
    g.accept(at(0.1, 100))
    assert g.judge(at(0.1, 100 + way * 12)) is not AngleVerdict.IMPOSSIBLE
    assert g.judge(at(0.1, 100 + way * 14)) is AngleVerdict.IMPOSSIBLE


@pytest.mark.parametrize("way", [1, -1])
def test_without_a_past_two_angles_must_be_within_reach_of_each_other(way: int) -> None:
    g = gate()
    assert g.judge(at(0.0, 0)) is AngleVerdict.CONFIRM
    assert g.confirms(at(0.0, 0), at(0.05, way * 450))
    assert not g.confirms(at(0.0, 0), at(0.05, way * 460))
    g.accept(at(0.0, 0))
    g.forget()
    assert g.judge(at(0.01, 0)) is AngleVerdict.CONFIRM
    assert not g.has_past


def test_a_change_of_speed_has_its_bound() -> None:
    """Confirmed is what the acceleration allows between the middles of both intervals: 8 counts here, and the steps."""
    for second, fits in ((100 + 20 + 8, True), (100 + 20 + 16, False), (100 + 20 - 16, False)):
        g = gate()
        g.accept(at(0.0, 50))
        g.accept(at(0.05, 50))
        assert g.confirms(at(0.10, 100), at(0.12, second)) is fits, second


@pytest.mark.parametrize("faster", [3.0, 30.0])
def test_a_unit_reporting_an_impossible_rate_is_not_accepted(faster: float) -> None:
    """Consistently wrong replies: each fits the one before, at a speed above the unit's stated maximum."""
    sim = SimulatedUnit(FlirModel(combined=False, device_clock=False), LineModel(), seed=3)
    line = VirtualLine(sim)
    with connect(line, UnitSettings()) as unit:
        for _ in range(5):
            assert isinstance(unit.read(), Reading)
        pan = sim.flir.axes["P"]
        pan.max_rate, pan.acceleration = faster * 8000.0, 1e9
        pan.move_to(line.now(), pan.high, pan.max_rate)
        arrives = pan.end_s()
        refused = []
        while line.now() < arrives - 0.1:
            refused.append(unit.read())
        assert refused
        assert all(isinstance(got, NoReading) for got in refused)
        assert unit.health().failures.keys() <= {FailureReason.TOO_FAST, FailureReason.UNCONFIRMED}
        line.wait(1.0)
        while not isinstance(unit.read(), Reading):
            assert line.now() < arrives + 5.0


def test_instants_stay_within_their_bounds() -> None:
    rnd = random.Random(3)
    for _ in range(2000):
        earliest = rnd.uniform(0.0, 1.0)
        latest = earliest + rnd.uniform(0.0, 0.03)
        sent = earliest + rnd.uniform(0.0, 0.002)
        first = latest + rnd.uniform(0.0, 0.01)
        for spread in (0.0005, math.inf):
            latency = Latency(unit_s=0.005, unit_sigma_s=0.0017, send_sigma_s=spread)
            found = query_instant(earliest_s=earliest, sent_s=sent, latest_s=latest, first_bit_s=first, latency=latency)
            assert earliest <= found.t_s <= latest
            assert 1e-4 <= found.sigma_s <= max(1e-4, (latest - earliest) / math.sqrt(12))


def test_the_device_clock_estimates_its_offset_and_survives_a_wrap_and_a_restart() -> None:
    rnd = random.Random(4)
    hz, drift, start = 90_000.0, 1 + 50e-6, 2**32 - 90_000 * 5
    clock, errors = DeviceClock(hz), []
    for k in range(400):
        true = 100.0 + 0.04 * k
        count = int((true - 100.0) * hz * drift + start) % 2**32
        before, after = rnd.uniform(0.0, 0.005), rnd.uniform(0.0, 0.01)
        found = clock.instant(count, true - before, true + after)
        assert found.source is AngleSource.DEVICE_CLOCK
        errors.append((found.t_s - true, found.sigma_s))
    assert max(abs(e) for e, _ in errors[50:]) < 0.0015
    assert all(abs(e) < 4 * s + 2 / hz for e, s in errors)
    assert clock.ran_backwards(5)
    again = clock.instant(5, 200.0, 200.004)
    assert 200.0 <= again.t_s <= 200.004
