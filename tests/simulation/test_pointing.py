"""Pointing: exact, parked, or lagging within its limits; and readings of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from groundstation.errors import ScenarioError
from groundstation.rig.rig import ClockModel
from groundstation.simulation.approach import GlideApproach, weaving_approach
from groundstation.simulation.path_deviation import drawn_deviation
from groundstation.simulation.pointing import (
    FirstOrderLoop,
    FixedPointing,
    IdealPointing,
    LoopLimits,
    SecondOrderLoop,
    UncontrolledPointing,
    pointing_history,
)
from groundstation.simulation.ptu import PtuModel, SimulatedReadings, StampedAt, quantise, read_ptu
from groundstation.simulation.rig_errors import StationErrors, perturbed
from groundstation.simulation.standard_cases import STEP_RAD, standard_rig, standard_station

SPAN = (0.0, 15.0)
PASSING = GlideApproach(start_y_m=200.0, end_y_m=10.0, slope_rad=0.0, aim_y_m=0.0)
skewed = perturbed(
    standard_rig(),
    {
        "left": StationErrors(
            mount_rad=np.array([0.02, -0.01, 0.03]),
            boresight_rad=np.array([-0.03, 0.01, 0.02]),
            camera_in_head_m=np.array([0.01, 0.06, 0.05]),
        )
    },
)


@given(t=st.floats(0.0, 16.0))
def test_ideal_pointing_puts_the_target_on_the_optical_axis(t: float) -> None:
    """Whatever the mounting, the boresight and the lever arm."""
    station, track = skewed["left"], weaving_approach()
    pan, tilt = pointing_history(IdealPointing(), station.geometry(), track, SPAN).at(np.array([t])).head_rad[0]
    projection = station.geometry().project(track.position(np.array([t]))[0], pan, tilt)
    assert projection is not None
    assert projection.pixel == pytest.approx(station.lens.principal_point_px, abs=1e-6)


def test_ideal_rates_are_the_derivative_of_the_angles() -> None:
    history = pointing_history(IdealPointing(), skewed["left"].geometry(), weaving_approach(), SPAN)
    t, h = np.linspace(0.0, 13.0, 40), 1e-3
    slope = (history.at(t + h).head_rad - history.at(t - h).head_rad) / (2 * h)
    assert history.at(t).head_rate_rad_s == pytest.approx(slope, abs=1e-6)


def test_a_head_adrift_is_aimed_once_and_goes_its_own_way() -> None:
    """The direction at the start of the flight, then the drawn deviation alone, independent of the target."""
    geometry, track = standard_rig()["left"].geometry(), weaving_approach()
    start, end = track.span_s
    drawn = drawn_deviation(np.random.default_rng(3), span_s=(start, end), acceleration_psd_m2_s3=(1e-5, 1e-5, 0.0))
    history = pointing_history(UncontrolledPointing(deviation=drawn), geometry, track, (start, end))
    t = np.linspace(start, end, 40)
    found, aimed = history.at(t), pointing_history(IdealPointing(), geometry, track, (start, end)).at(t)
    np.testing.assert_allclose(found.head_rad - aimed.head_rad[0], drawn.position(t)[:, :2], atol=1e-12)
    np.testing.assert_allclose(found.head_rate_rad_s, drawn.velocity(t)[:, :2], atol=1e-12)
    np.testing.assert_array_equal(found.encoder_rad, found.head_rad)


def test_a_parked_head_stands_still() -> None:
    history = pointing_history(FixedPointing(pan_rad=0.1, tilt_rad=0.2), skewed["left"].geometry(), PASSING, SPAN)
    seen = history.at(np.linspace(0.0, 10.0, 5))
    assert np.all(seen.head_rad == [0.1, 0.2])
    assert np.all(seen.encoder_rad == [0.1, 0.2])
    assert np.all(seen.head_rate_rad_s == 0.0)


@settings(max_examples=12)
@given(
    first=st.booleans(),
    speed=st.floats(0.02, 0.5),
    push=st.floats(0.1, 5.0),
    sharpness=st.floats(2.0, 30.0),
)
def test_a_loop_keeps_its_limits(first: bool, speed: float, push: float, sharpness: float) -> None:
    """At the samples and between them, while the target rushes past."""
    limits = LoopLimits(max_rate_rad_s=speed, max_acceleration_rad_s2=push)
    loop = (
        FirstOrderLoop(time_constant_s=1.0 / sharpness, limits=limits)
        if first
        else SecondOrderLoop(natural_rad_s=sharpness, limits=limits)
    )
    history = pointing_history(loop, standard_station("left", -5.0).geometry(), PASSING, (0.0, 8.0))
    t = np.arange(0.0, 8.0, 0.00037)
    seen = history.at(t)
    assert np.abs(seen.head_rate_rad_s).max() <= speed * (1 + 1e-9)
    assert np.abs(np.diff(seen.head_rate_rad_s, axis=0) / np.diff(t)[:, None]).max() <= push * (1 + 1e-6)
    turned = np.diff(seen.head_rad, axis=0) / np.diff(t)[:, None]
    assert np.abs(turned - 0.5 * (seen.head_rate_rad_s[1:] + seen.head_rate_rad_s[:-1])).max() <= push * 0.001


@pytest.mark.parametrize(
    ("loop", "lag_s"),
    [
        (FirstOrderLoop(time_constant_s=0.2), 0.2),
        (SecondOrderLoop(natural_rad_s=10.0, damping=0.8), 0.16),
        (FirstOrderLoop(time_constant_s=0.1, limits=LoopLimits(command_delay_s=0.11)), 0.21),
    ],
)
def test_a_steady_turn_is_followed_with_the_loops_lag(loop: FirstOrderLoop | SecondOrderLoop, lag_s: float) -> None:
    geometry = standard_station("left", -5.0).geometry()
    t = np.array([1.0, 2.0, 3.0])
    ideal = pointing_history(IdealPointing(), geometry, PASSING, SPAN)
    now, then = ideal.at(t).head_rad[:, 0], ideal.at(t - lag_s).head_rad[:, 0]
    lagging = pointing_history(loop, geometry, PASSING, SPAN).at(t).head_rad[:, 0]
    assert now - lagging == pytest.approx(now - then, rel=0.04)


def test_backlash_hides_half_the_gap_from_the_encoder() -> None:
    gap = 2e-4
    loop = SecondOrderLoop(limits=LoopLimits(backlash_rad=gap))
    history = pointing_history(loop, standard_station("left", -5.0).geometry(), weaving_approach(), SPAN)
    seen = history.at(np.linspace(0.0, 14.0, 4000))
    apart = seen.head_rad - seen.encoder_rad
    assert np.abs(apart).max() <= 0.5 * gap + 1e-12
    assert apart[:, 0].min() == pytest.approx(-0.5 * gap)
    assert apart[:, 0].max() == pytest.approx(0.5 * gap)
    # while the gears change sides, the motor turns and the head does not
    assert np.any((seen.head_rate_rad_s[:, 0] == 0.0) & (np.abs(apart[:, 0]) < 0.49 * gap))


def read(model: PtuModel, *, resolution_rad: float, sigma_rad: float, **clock: float) -> SimulatedReadings:
    stated = standard_station("left", -5.0, resolution_rad=resolution_rad, sigma_rad=sigma_rad)
    true = replace(stated, ptu_clock=ClockModel(**clock))
    history = pointing_history(model.pointing, true.geometry(), weaving_approach(), SPAN)
    return read_ptu(model, true, stated, history, (0.0, 14.0), np.random.default_rng(5))


def bearings(readings: SimulatedReadings) -> np.ndarray:
    history = pointing_history(IdealPointing(), standard_station("left", -5.0).geometry(), weaving_approach(), SPAN)
    return np.array([[s.pan_rad, s.tilt_rad] for s in readings.samples]) - history.at(readings.arrival_s).head_rad


def test_readings_are_whole_steps_and_off_by_half_a_step_at_most() -> None:
    readings = read(PtuModel(rate_hz=100.0), resolution_rad=STEP_RAD, sigma_rad=0.0)
    angles = np.array([[s.pan_rad, s.tilt_rad] for s in readings.samples])
    assert angles / STEP_RAD == pytest.approx(np.round(angles / STEP_RAD), abs=1e-9)
    assert np.abs(bearings(readings)).max() <= 0.5 * STEP_RAD * (1 + 1e-9)


@given(angle=st.floats(-3.0, 3.0), step=st.floats(1e-6, 1e-2))
def test_steps(angle: float, step: float) -> None:
    assert abs(quantise(np.array([angle]), step)[0] - angle) <= 0.5 * step * (1 + 1e-6)
    assert quantise(np.array([angle]), 0.0)[0] == angle


def test_encoder_noise_has_its_sigma() -> None:
    errors = bearings(read(PtuModel(rate_hz=200.0), resolution_rad=0.0, sigma_rad=1e-4))
    low, high = chi2.ppf([0.001, 0.999], errors.size) / errors.size
    assert low < np.mean(errors**2) / 1e-8 < high


def test_readings_come_at_their_own_rate_and_phase() -> None:
    readings = read(PtuModel(rate_hz=50.0, phase_s=0.013), resolution_rad=STEP_RAD, sigma_rad=0.0)
    stamps = np.array([s.t_s for s in readings.samples])
    assert stamps == pytest.approx(0.013 + 0.02 * np.arange(len(stamps)))
    assert len(stamps) == 700


def test_an_unknown_clock_shifts_and_stretches_the_stamps() -> None:
    """t_session = t_device + offset + drift · t_device: the device's clock shows less if the offset is positive."""
    readings = read(PtuModel(rate_hz=50.0), resolution_rad=0.0, sigma_rad=0.0, offset_s=0.02, drift_ppm=500.0)
    stamps = np.array([s.t_s for s in readings.samples])
    assert stamps * (1 + 500e-6) + 0.02 == pytest.approx(readings.arrival_s, abs=1e-12)


@pytest.mark.parametrize("stamped", list(StampedAt))
def test_readings_arrive_in_order_after_their_delay(stamped: StampedAt) -> None:
    model = PtuModel(rate_hz=50.0, delay_s=0.008, delay_jitter_s=0.05, stamped=stamped)
    readings = read(model, resolution_rad=0.0, sigma_rad=0.0)
    sampled = 0.02 * np.arange(len(readings.samples))
    late = readings.arrival_s - sampled
    assert late.min() >= 0.008
    assert 0.03 < late.max() < 0.06
    assert np.diff(readings.arrival_s).min() > 0
    stamps = np.array([s.t_s for s in readings.samples])
    assert stamps == pytest.approx(readings.arrival_s if stamped is StampedAt.ARRIVAL else sampled, abs=1e-12)


def test_a_loop_too_fast_for_its_steps_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"time_constant_s: got 0.001; wanted at least 0.01 s"):
        FirstOrderLoop(time_constant_s=0.001)
    with pytest.raises(ScenarioError, match="natural_rad_s: got 1000"):
        SecondOrderLoop(natural_rad_s=1000.0)
    with pytest.raises(ScenarioError, match="rate_hz: got 5000"):
        PtuModel(rate_hz=5000.0)
