"""The aircraft's own GNSS position against the track: what is called, how soon, and what is not called.

Track and receiver are drawn: the track's error is a constant and a part of some tenths of a second, the receiver's is
white noise and a Gauss-Markov process of minutes; positions are late by a constant of 0 to 0.3 s.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef
from groundstation.integrity.gnss_watch import GnssAssessment, GnssVerdict, GnssWatch
from groundstation.integrity.own_position import OwnPosition, ReceiverErrors, own_position
from groundstation.messages import Kinematics

_RATE_HZ = 10.0
_SPEED_M_S = 20.0
_START_M, _END_M = 400.0, 120.0
_AFTER_S = 6.5


@dataclass(frozen=True)
class _Receiver:
    """White noise and an error that lasts, one sigma per axis, m; for so long, s."""

    white_m: float
    lasting_m: float
    lasting_s: float

    @property
    def sigma_m(self) -> float:
        return math.hypot(self.white_m, self.lasting_m)


_PLAIN = _Receiver(white_m=0.3, lasting_m=1.5, lasting_s=150.0)
_RTK = _Receiver(white_m=0.015, lasting_m=0.02, lasting_s=60.0)


@dataclass(frozen=True)
class _Fault:
    """From a time on: a step (3,) m, a drift (3,) m/s, or a position that repeats."""

    from_s: float
    step_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frozen: bool = False


def _sigmas(range_m: float) -> FloatArray:
    """Return sigmas (6,) of a track at a range: as two stations 10.8 m apart have them."""
    share = range_m / 300.0
    return np.array([0.1 * share, 1.0 * share**2, 0.1 * share, 0.15, 0.5, 0.2])


def _gauss_markov(generator: np.random.Generator, count: int, sigma: FloatArray, lasting_s: float) -> FloatArray:
    kept = math.exp(-1.0 / (_RATE_HZ * lasting_s))
    drawn = generator.normal(size=(count, sigma.size)) * sigma
    for k in range(1, count):
        drawn[k] = kept * drawn[k - 1] + math.sqrt(1.0 - kept**2) * drawn[k]
    return drawn


def _fly(receiver: _Receiver, seed: int, fault: _Fault | None = None) -> list[GnssAssessment]:
    """Return the verdicts on the positions of one approach, which weaves a little."""
    generator = np.random.default_rng([seed, 17])
    t = np.arange(0.0, (_START_M - _END_M) / _SPEED_M_S, 1.0 / _RATE_HZ)
    delay_s = generator.uniform(0.0, 0.3)

    def true(at_s: FloatArray) -> FloatArray:
        y = _START_M - _SPEED_M_S * at_s
        return np.column_stack([np.sin(0.8 * at_s), y, 0.061 * (y - 100.0)])

    velocity = np.column_stack([0.8 * np.cos(0.8 * t), np.full_like(t, -_SPEED_M_S), np.full_like(t, -1.22)])
    # half of the track's variance is that of a constant, of the calibration
    common = generator.normal(size=3)
    sigma = np.array([_sigmas(y) for y in true(t)[:, 1]])
    unit = math.sqrt(0.5) * (common + _gauss_markov(generator, t.size, np.ones(3), 0.4))
    track = true(t) + unit * sigma[:, :3]
    rates = velocity + generator.normal(size=velocity.shape) * sigma[:, 3:]
    told = true(t - delay_s) + generator.normal(size=(t.size, 3)) * receiver.white_m
    told += _gauss_markov(generator, t.size, np.full(3, receiver.lasting_m), receiver.lasting_s)
    if fault is not None:
        after = np.maximum(t - fault.from_s, 0.0)[:, None]
        told += (t >= fault.from_s)[:, None] * np.array(fault.step_m) + after * np.array(fault.drift_m_s)
        if fault.frozen:
            told[t >= fault.from_s] = told[t < fault.from_s][-1]
    watch, found = GnssWatch(), []
    # what comes long after a fault is not asked for
    last = t.size if fault is None else min(t.size, round(_RATE_HZ * (fault.from_s + _AFTER_S)))
    for k in range(last):
        covariance = np.diag(sigma[k] ** 2)
        known = Kinematics(position_runway_m=track[k], velocity_runway_m_s=rates[k], covariance=covariance)
        watch.add_estimate(float(t[k]), known)
        sigmas = np.full(3, receiver.sigma_m)
        found.append(watch.take(OwnPosition(t_s=float(t[k]), position_runway_m=told[k], sigma_m=sigmas)))
    return found


def _called_s(found: list[GnssAssessment]) -> float:
    return next((a.t_s for a in found if a.verdict.called), math.inf)


@pytest.mark.parametrize(
    ("receiver", "step_m"),
    [(_RTK, (3.0, 0.0, 0.0)), (_RTK, (-3.0, 0.0, 0.0)), (_PLAIN, (12.0, 0.0, 0.0)), (_PLAIN, (-12.0, 0.0, 0.0))],
)
def test_a_lateral_step_at_300_m_is_called_within_a_second(
    receiver: _Receiver, step_m: tuple[float, float, float]
) -> None:
    at_s = (_START_M - 300.0) / _SPEED_M_S
    for seed in range(15):
        found = _fly(receiver, seed, _Fault(at_s, step_m=step_m))
        assert at_s <= _called_s(found) <= at_s + 1.0
        first = next(a for a in found if a.verdict.called)
        assert first.verdict in (GnssVerdict.JUMP, GnssVerdict.DISAGREES)
        assert "sigma" in first.reason


@pytest.mark.parametrize("receiver", [_RTK, _PLAIN])
def test_a_frozen_position_is_called_within_a_second(receiver: _Receiver) -> None:
    for seed in range(10):
        found = _fly(receiver, seed, _Fault(5.0, frozen=True))
        assert 5.0 <= _called_s(found) <= 6.0
        first = next(a for a in found if a.verdict.called)
        assert first.verdict is GnssVerdict.FROZEN
        assert "repeated" in first.reason


def test_a_slow_drift_is_called_once_it_is_large() -> None:
    """Expected: 0.5 m/s off an RTK receiver's place is called by 3 m, which no single step of it shows."""
    for seed in range(10):
        found = _fly(_RTK, seed, _Fault(2.0, drift_m_s=(0.5, 0.0, 0.0)))
        assert 2.0 < _called_s(found) < 8.0


@pytest.mark.parametrize("receiver", [_RTK, _PLAIN])
def test_approaches_without_a_fault_are_not_called(receiver: _Receiver) -> None:
    """Expected: at most as many calls as 40 approaches with one in a thousand each have (1 in 1000)."""
    calls = sum(math.isfinite(_called_s(_fly(receiver, 1000 + seed))) for seed in range(40))
    assert calls <= binom.ppf(0.999, 40, 0.001)


def test_the_stated_step_is_called() -> None:
    """Expected: what the verdict says would be called is called: three sigmas beyond the limit."""
    stated = _fly(_PLAIN, 3)[60].detectable_m
    assert stated is not None
    assert 1.0 < stated < 12.0
    called = [_called_s(_fly(_PLAIN, seed, _Fault(6.0, step_m=(stated, 0.0, 0.0)))) <= 7.0 for seed in range(20)]
    assert sum(called) >= 18


def _still(t_s: float, x_m: float = 0.0, velocity_m_s: float = 20.0) -> Kinematics:
    return Kinematics(
        position_runway_m=np.array([x_m, 300.0 - velocity_m_s * t_s, 10.0]),
        velocity_runway_m_s=np.array([0.0, -velocity_m_s, 0.0]),
        covariance=np.diag([0.1, 0.5, 0.1, 0.1, 0.3, 0.1]) ** 2,
    )


def _position(t_s: float, off_m: float = 0.0, velocity_m_s: float = 20.0) -> OwnPosition:
    place = np.array([off_m, 300.0 - velocity_m_s * (t_s - 0.1), 10.0])
    return OwnPosition(t_s=t_s, position_runway_m=place, sigma_m=np.full(3, 0.05))


def test_one_damaged_message_calls_nothing_and_a_call_ends_after_the_fault() -> None:
    watch, verdicts = GnssWatch(), []
    for k in range(200):
        t_s = 0.1 * k
        watch.add_estimate(t_s, _still(t_s))
        off = 50.0 if k == 30 or 60 <= k < 80 else 0.0
        verdicts.append(watch.take(_position(t_s, off)).verdict)
    assert verdicts[29:35] == [GnssVerdict.AGREES] * 6
    assert verdicts[61].called
    assert verdicts[-1] is GnssVerdict.AGREES


@pytest.mark.parametrize("rate_hz", [4.0, 10.0])
def test_later_positions_are_not_compared_with_a_damaged_one(rate_hz: float) -> None:
    watch, called = GnssWatch(), 0
    for k in range(100):
        t_s = k / rate_hz
        watch.add_estimate(t_s, _still(t_s))
        called += watch.take(_position(t_s, 500.0 if k % 25 == 20 else 0.0)).verdict.called
    assert called == 0


def test_an_aircraft_that_stands_still_is_not_frozen() -> None:
    watch = GnssWatch()
    for k in range(60):
        watch.add_estimate(0.1 * k, _still(0.1 * k, velocity_m_s=0.0))
        verdict = watch.take(_position(0.1 * k, velocity_m_s=0.0)).verdict
    assert verdict is GnssVerdict.AGREES


def test_a_receiver_slower_than_its_telemetry_is_not_frozen() -> None:
    """Expected: each position sent three times, at 10 a second."""
    watch, called = GnssWatch(), False
    for k in range(150):
        t_s = 0.1 * k
        watch.add_estimate(t_s, _still(t_s))
        told = replace(_position(0.1 * (k - k % 3)), t_s=t_s)
        called |= watch.take(told).verdict.called
    assert not called


def _level_flight(t_s: float) -> Kinematics:
    return Kinematics(
        position_runway_m=np.array([0.0, 900.0 - 20.0 * t_s, 30.0]),
        velocity_runway_m_s=np.array([0.0, -20.0, 0.0]),
        covariance=np.diag([0.1, 0.5, 0.1, 0.1, 0.3, 0.1]) ** 2,
    )


@pytest.mark.parametrize("lost_s", [(), (8.0, 16.0)], ids=["tracked", "track lost for a while"])
def test_a_position_that_stays_frozen_stays_called(lost_s: tuple[float, ...]) -> None:
    """Frozen from 5 s on. Expected: called 0.7 s later and to the end at 25 s, but for where there is no track."""
    watch, verdicts = GnssWatch(), {}
    for k in range(250):
        t_s = 0.1 * k
        tracked = not lost_s or not lost_s[0] < t_s < lost_s[1]
        if tracked:
            watch.add_estimate(t_s, _level_flight(t_s))
        place = _level_flight(min(t_s, 5.0) - 0.15).position_runway_m
        found = watch.take(OwnPosition(t_s=t_s, position_runway_m=place, sigma_m=np.full(3, 1.0)))
        verdicts[t_s] = found.verdict
    without = (lost_s[0] + 0.6, lost_s[1] + 1.0) if lost_s else (0.0, 0.0)
    called = {t: v for t, v in verdicts.items() if t > 5.75 and not without[0] < t < without[1]}
    assert set(called.values()) == {GnssVerdict.FROZEN}


def test_a_call_stands_for_three_seconds_where_the_track_ends() -> None:
    """A step of 30 m just before the track is lost. Expected: no track to compare with, 3 s after the last call."""
    watch, verdicts = GnssWatch(), []
    for k in range(120):
        t_s = 0.1 * k
        if t_s < 5.35:
            watch.add_estimate(t_s, _level_flight(t_s))
        place = _level_flight(t_s - 0.15).position_runway_m + (30.0 if t_s > 5.05 else 0.0) * np.array([1.0, 0.0, 0.0])
        verdicts.append(watch.take(OwnPosition(t_s=t_s, position_runway_m=place, sigma_m=np.full(3, 1.0))).verdict)
    last = max(k for k, verdict in enumerate(verdicts) if verdict is GnssVerdict.JUMP)
    assert set(verdicts[52 : last + 1]) == {GnssVerdict.JUMP}
    # the track is carried on for half a second, and the last call stands from there
    assert last in range(85, 91)
    assert set(verdicts[last + 1 :]) == {GnssVerdict.NO_TRACK}


def test_without_a_track_or_positions_the_verdict_says_so() -> None:
    watch = GnssWatch()
    assert watch.assessment(0.0).verdict is GnssVerdict.SILENT
    assert watch.take(_position(0.0)).verdict is GnssVerdict.NO_TRACK
    watch.add_estimate(1.0, _still(1.0))
    assert watch.take(_position(1.0)).verdict is GnssVerdict.AGREES
    # one that is not newer changes nothing
    assert watch.take(_position(0.9, 50.0)).verdict is GnssVerdict.AGREES
    assert watch.assessment(2.0).verdict is GnssVerdict.AGREES
    assert watch.assessment(4.0).verdict is GnssVerdict.SILENT
    watch.forget()
    assert watch.take(_position(4.1)).verdict is GnssVerdict.NO_TRACK


@given(
    st.floats(-1.5, 1.5), st.floats(-180.0, 180.0), st.floats(-3e4, 3e4), st.floats(-3e4, 3e4), st.floats(-100.0, 3e3)
)
def test_a_geodetic_position_comes_to_its_place(
    lat_rad: float, azimuth_deg: float, x_m: float, y_m: float, z_m: float
) -> None:
    """Expected: through earth-fixed coordinates and back to millimetres, whatever the site and its direction."""
    origin = (math.degrees(lat_rad), 12.0, 150.0)
    azimuth = math.radians(azimuth_deg)
    east = x_m * math.cos(azimuth) + y_m * math.sin(azimuth)
    north = -x_m * math.sin(azimuth) + y_m * math.cos(azimuth)
    lat, lon, height = geodetic_from_ecef(ecef_from_enu(np.array([east, north, z_m]), origin))
    found = own_position(
        1.0,
        (float(lat), float(lon), float(height)),
        (2.0, 2.0, 3.0),
        origin_deg_m=origin,
        y_axis_azimuth_deg=azimuth_deg,
    )
    np.testing.assert_allclose(found.position_runway_m, [x_m, y_m, z_m], atol=1e-3)
    np.testing.assert_allclose(found.sigma_m, [2.0, 2.0, 3.0], rtol=1e-9)


@pytest.mark.parametrize(
    ("place", "sigma", "t_s"),
    [
        ([math.nan, 0.0, 0.0], [1.0, 1.0, 1.0], 0.0),
        ([1e7, 0.0, 0.0], [1.0, 1.0, 1.0], 0.0),
        ([0.0, 0.0, 0.0], [1.0, 0.0, 1.0], 0.0),
        ([0.0, 0.0, 0.0], [1.0, math.nan, 1.0], 0.0),
        ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], math.inf),
        ([0.0, 0.0], [1.0, 1.0, 1.0], 0.0),
    ],
)
def test_a_position_that_is_none_is_refused(place: list[float], sigma: list[float], t_s: float) -> None:
    with pytest.raises(InputError, match="own position"):
        OwnPosition(t_s=t_s, position_runway_m=np.array(place), sigma_m=np.array(sigma))


def test_errors_that_are_none_are_refused() -> None:
    for name, value in (("white_share", 1.5), ("lasting_s", 0.0), ("delay_s", (0.3, 0.0)), ("antenna_sigma_m", -1.0)):
        with pytest.raises(InputError, match=name):
            ReceiverErrors(**{name: value})  # type: ignore[arg-type]
    with pytest.raises(InputError, match="false_call_chance"):
        GnssWatch(false_call_chance=0.0)
