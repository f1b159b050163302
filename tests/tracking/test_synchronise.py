"""The rules of time: bracketing, gaps, waiting, lateness, order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.messages import Epoch, PixelMeasurement, PtuSample
from groundstation.tracking.synchronise import (
    AngleFault,
    InterpolatedAngles,
    LateReading,
    ReadyFrame,
    SynchroniseConfig,
    Synchroniser,
    interpolate,
)


def reading(t: float, pan: float = 0.0, station: str = "left") -> PtuSample:
    return PtuSample(t_s=t, station=station, pan_rad=pan, tilt_rad=-pan)


def frame(t: float, station: str = "left", epoch: int = 0) -> PixelMeasurement:
    return PixelMeasurement(t_s=t, station=station, epoch=epoch, u_px=1.0, v_px=2.0)


def drive(synchroniser: Synchroniser, events) -> list:
    out = [r for e in events for r in synchroniser.push(e)]
    return out + list(synchroniser.finish())


def test_angles_are_interpolated_between_the_readings_around_the_exposure() -> None:
    found = interpolate([reading(0.0, 0.0), reading(0.02, 0.01), reading(0.04, 0.03)], 0.03, 0.25)
    assert isinstance(found, InterpolatedAngles)
    assert found.pan_rad == pytest.approx(0.02)
    assert found.tilt_rad == pytest.approx(-0.02)
    assert found.variance_share == pytest.approx(0.5)


def test_interpolation_goes_the_short_way_round() -> None:
    found = interpolate([reading(0.0, 3.13), reading(0.1, -3.13)], 0.05, 0.25)
    assert isinstance(found, InterpolatedAngles)
    assert abs(np.cos(found.pan_rad) + 1) < 1e-6


@given(st.floats(0.0, 1.0), st.floats(-1, 1), st.floats(-1, 1))
def test_a_steady_turn_is_reproduced_exactly(t: float, start: float, rate: float) -> None:
    readings = [reading(k * 0.1, start + rate * k * 0.1) for k in range(11)]
    found = interpolate(readings, t, 0.25)
    assert isinstance(found, InterpolatedAngles)
    assert found.pan_rad == pytest.approx(start + rate * t, abs=1e-12)


def test_no_angle_before_the_first_after_the_last_or_in_a_gap() -> None:
    readings = [reading(1.0), reading(1.1), reading(2.0)]
    assert interpolate(readings, 0.9, 0.25) is AngleFault.NO_READING
    assert interpolate(readings, 2.1, 0.25) is AngleFault.ENDED
    assert interpolate(readings, 1.5, 0.25) is AngleFault.GAP


def test_a_frame_waits_for_the_reading_after_it() -> None:
    s = Synchroniser(["left"], SynchroniseConfig())
    assert list(s.push(reading(0.00))) == [reading(0.00)]
    assert list(s.push(frame(0.01))) == []
    (ready,) = s.push(reading(0.02, 0.2))
    assert isinstance(ready, ReadyFrame)
    assert ready.following == reading(0.02, 0.2)
    assert isinstance(ready.angles, InterpolatedAngles)
    assert ready.angles.pan_rad == pytest.approx(0.1)
    # the reading went with the frame and is not passed on twice; the next one comes when the camera is as far
    assert list(s.push(reading(0.04))) == []
    assert list(s.push(frame(0.05))) == [reading(0.04)]


def test_a_released_reading_is_passed_on_at_its_own_time_after_all() -> None:
    s = Synchroniser(["left"], SynchroniseConfig())
    taken, other = reading(0.02, 0.2), reading(0.04)
    for event in (reading(0.00), frame(0.01)):
        list(s.push(event))
    (ready,) = s.push(taken)
    assert ready.following is taken
    assert not s.release(other)
    assert s.release(taken)
    assert not s.release(taken)
    list(s.push(other))
    assert list(s.push(frame(0.05))) == [taken, other]


def test_a_frame_does_not_wait_longer_than_the_hold() -> None:
    s = Synchroniser(["left", "right"], SynchroniseConfig(hold_s=0.1))
    drive_before = [reading(0.0), reading(0.0, station="right"), frame(0.01)]
    assert len([r for e in drive_before for r in s.push(e) if isinstance(r, ReadyFrame)]) == 0
    out = [r for t in (0.05, 0.10, 0.12) for r in s.push(reading(t, station="right"))]
    ready = [r for r in out if isinstance(r, ReadyFrame)]
    assert len(ready) == 1
    assert ready[0].angles is AngleFault.ENDED
    assert ready[0].following is None


def test_a_fixed_station_does_not_wait() -> None:
    s = Synchroniser([], SynchroniseConfig())
    (ready,) = s.push(frame(0.0))
    assert ready.angles is None


def test_late_records_are_counted_and_reported_as_late() -> None:
    s = Synchroniser(["left"], SynchroniseConfig())
    drive_in = [reading(0.0), reading(0.1), frame(0.15), reading(0.2), reading(0.3), reading(0.5)]
    for event in drive_in:
        list(s.push(event))
    assert list(s.push(reading(0.05))) == [LateReading(sample=reading(0.05))]
    (late,) = s.push(frame(0.25))
    assert late.late
    assert late.angles == s.angles_at("left", 0.25)
    assert (s.late.ptu, s.late.frames) == (1, 1)


def test_an_epoch_follows_its_frames_and_everything_is_in_order() -> None:
    """The right camera exposes 20 ms after the left; the epoch's stamp is their mean, its place after both."""
    s = Synchroniser(["left", "right"], SynchroniseConfig())
    arrivals = []
    for k in range(40):
        t = k * 0.02
        arrivals += [(t, reading(t)), (t, reading(t, station="right"))]
        if k % 5 == 2:
            last = t + 0.025
            arrivals += [(t + 0.005, frame(t + 0.005, epoch=k)), (last, frame(last, "right", k))]
            arrivals.append((last, Epoch(t_s=t + 0.015, epoch=k, stations=())))
    out = drive(s, [event for _, event in sorted(arrivals, key=lambda a: a[0])])
    seen: dict[int, int] = {}
    times = []
    for r in out:
        if isinstance(r, ReadyFrame):
            seen[r.record.epoch] = seen.get(r.record.epoch, 0) + 1
            times.append(r.record.t_s)
            assert isinstance(r.angles, InterpolatedAngles)
        elif isinstance(r, Epoch):
            assert seen[r.epoch] == 2
        else:
            times.append(r.t_s)
    assert times == sorted(times)
    consumed = sum(1 for r in out if isinstance(r, PtuSample))
    consumed += sum(1 for r in out if isinstance(r, ReadyFrame) and r.following is not None)
    assert consumed == 80, "each reading is passed on exactly once"


def test_within_the_hold_the_order_of_arrival_does_not_matter(rng: np.random.Generator) -> None:
    """Two cameras whose frames arrive 30–80 ms after their exposure, PTUs whose readings take up to 20 ms: the same
    records come out, in the same order, as if all had come at once."""
    events = []
    for k in range(200):
        t = k * 0.02
        events += [reading(t, 0.01 * t), reading(t + 0.003, 0.02 * t, station="right")]
        if k % 5 == 0:
            events += [frame(t + 0.001, epoch=k), frame(t + 0.002, "right", k)]
    delay = {PtuSample: (0.0, 0.02), PixelMeasurement: (0.03, 0.08)}
    arrival = [e.t_s + rng.uniform(*delay[type(e)]) for e in events]
    shuffled = [events[i] for i in np.argsort(arrival)]
    late, prompt = (
        Synchroniser(["left", "right"], SynchroniseConfig(hold_s=0.15), cameras=["left", "right"]) for _ in range(2)
    )
    out = [_essence(r) for r in drive(late, shuffled)]
    assert (late.late.ptu, late.late.frames) == (0, 0)
    assert out == [_essence(r) for r in drive(prompt, sorted(events, key=lambda e: e.t_s))]


def _essence(ready) -> tuple:
    if isinstance(ready, ReadyFrame):
        return ("frame", ready.record.station, ready.record.t_s, ready.angles, ready.following)
    return ("ptu", ready.station, ready.t_s)


def test_many_readings_during_a_hold_are_not_forgotten() -> None:
    """1 kHz PTU on the right, a dead one on the left: the right frame still gets its angle after the hold."""
    s = Synchroniser(["left", "right"], SynchroniseConfig(hold_s=0.15), cameras=["right"])
    readings = [reading(k * 0.001, 1e-4 * k, station="right") for k in range(600)]
    events = sorted([*readings, frame(0.3, "right")], key=lambda e: e.t_s)
    (found,) = [r for r in drive(s, events) if isinstance(r, ReadyFrame)]
    assert isinstance(found.angles, InterpolatedAngles)
    assert found.angles.pan_rad == pytest.approx(0.03, abs=1e-9)
