"""Carried errors of rig and clocks: Jacobians against numeric twins, and against what the simulator makes of them."""

import numpy as np
import pytest
from filter_flights.bounds import _true_states
from filter_flights.calibration import (
    CLOCK_DRIFTS,
    CLOCK_OFFSETS,
    PAN_AND_TILT,
    ROLL_AND_BORESIGHT,
    clock_take_off,
    with_errors,
)
from filter_flights.run_filter import in_order

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.state_model import StateLayout, state_layout
from groundstation.estimation.updates.encoder_update import EncoderUpdate
from groundstation.estimation.updates.pixel_model import PixelModel
from groundstation.estimation.updates.reference_update import ReferencePositionUpdate
from groundstation.evaluation.bounds import StationView
from groundstation.evaluation.calibration_bounds import MotionProfile, nuisance_sensitivities, reference_information
from groundstation.messages import DgpsFix, PixelMeasurement, PtuSample
from groundstation.simulation import simulate
from tests.stereo_rig import aim, make_rig

PTU_DRIFT = "left.ptu_clock.drift"
SHUTTERS = ("left.readout", "right.readout")
NAMES = (*PAN_AND_TILT, *ROLL_AND_BORESIGHT, *CLOCK_OFFSETS, *CLOCK_DRIFTS, PTU_DRIFT, *SHUTTERS)
SIZES = np.array([1e-5] * 10 + [0.02] * 4 + [1e-3] * 5)


def reference_update(layout: StateLayout) -> ReferencePositionUpdate:
    return ReferencePositionUpdate(layout, EstimationConfig(), MotionModel(layout, (1.0, 1.0, 1.0), 1e-3))


def random_state(rng: np.random.Generator) -> tuple[np.ndarray, object]:
    rig = make_rig()
    layout = state_layout(rig.names, NAMES)
    x = np.zeros(layout.size)
    x[layout.position] = (1.0, 150.0, 8.0)
    x[layout.velocity] = rng.normal(0, 15, 3)
    for s in rig.stations:
        x[layout.angles[s.name]] = np.array(aim(s.geometry(), x[layout.position])) + rng.normal(0, 0.01, 2)
        x[layout.rates[s.name]] = rng.normal(0, 0.2, 2)
    x[layout.constant] = rng.normal(0, 1, len(NAMES)) * SIZES
    return x, layout


@pytest.mark.parametrize("station", ["left", "right"])
def test_pixel_jacobian_over_carried_errors(rng: np.random.Generator, station: str) -> None:
    x, layout = random_state(rng)
    model = PixelModel(layout, make_rig()[station].geometry())
    found = model.predict(x, 0.004, age_s=7.0)
    assert found is not None
    for k in range(layout.size):
        step = np.zeros(layout.size)
        step[k] = 1e-7 if k >= layout.constant.start else 1e-6
        ahead, back = model.predict(x + step, 0.004, 7.0), model.predict(x - step, 0.004, 7.0)
        assert ahead is not None
        assert back is not None
        twin = (ahead.pixel - back.pixel) / (2 * step[k])
        # rotations are linearised at the assumed mount, so that its own error of 1e-5 turns them
        np.testing.assert_allclose(found.jacobian[:, k], twin, rtol=1e-4, atol=0.3)


def test_true_states_reproduce_the_measurements() -> None:
    """Mounts, clocks and drifts of a take-off, without noise: nothing is left but what is quadratic in them."""
    names = (*PAN_AND_TILT, *CLOCK_OFFSETS, *CLOCK_DRIFTS)
    truth = np.array([1e-3, -8e-4, 5e-4, 7e-4, 0.03, -0.02, 0.04, 0.05, 2e-3, 1e-3])
    flight = simulate(with_errors(clock_take_off().scenario(0), names, truth).without_noise())
    layout = state_layout(("left", "right"), names)
    events = in_order(flight, lambda _: True)
    states = _true_states(flight, layout, np.array([e.t_s for e in events]), truth)
    pixels = {s.name: PixelModel(layout, s.geometry()) for s in flight.rig.stations}
    encoders = {name: EncoderUpdate(layout, name, EstimationConfig()) for name in layout.angles}
    off_px, off_rad, off_m = [], [], []
    for event, state in zip(events, states, strict=True):
        age = event.t_s - events[0].t_s
        match event:
            case PixelMeasurement():
                seen = pixels[event.station].predict(state, 0.0, age)
                assert seen is not None
                off_px.append(np.abs(seen.pixel - [event.u_px, event.v_px]))
            case PtuSample():
                expected = encoders[event.station].predict(state, 0.0).value
                off_rad.append(np.abs(expected - [event.pan_rad, event.tilt_rad]))
            case DgpsFix():
                off_m.append(np.abs(reference_update(layout).predict(state, 0.0, age).value - event.position_runway_m))
    assert np.median(off_px) < 0.02
    assert np.max(off_px) < 1.5
    assert np.max(off_rad) < 1e-12
    assert np.max(off_m) < 0.02


def test_the_bounds_sensitivities_are_the_filters(rng: np.random.Generator) -> None:
    x, layout = random_state(rng)
    x[layout.constant] = 0.0
    rig, age = make_rig(), 3.0
    views = [
        StationView(
            geometry=s.geometry(),
            pan_rad=float(x[layout.angles[s.name]][0]),
            tilt_rad=float(x[layout.angles[s.name]][1]),
            pixel_covariance_px2=np.eye(2),
            angle_sigma_rad=1e-5,
        )
        for s in rig.stations
    ]
    movement = MotionProfile(
        velocity_runway_m_s=x[layout.velocity], rates_rad_s=[x[layout.rates[n]] for n in rig.names], age_s=age
    )
    found = nuisance_sensitivities(x[layout.position], views, movement, NAMES)
    for station, sensitivity in zip(rig.stations, found, strict=True):
        seen = PixelModel(layout, station.geometry()).predict(x, 0.0, age)
        assert seen is not None
        np.testing.assert_allclose(sensitivity, seen.jacobian[:, layout.constant], rtol=1e-9, atol=1e-9)
    H = reference_update(layout).predict(x, 0.0, age).jacobian[:, [0, 1, 2, *range(layout.constant.start, layout.size)]]
    np.testing.assert_allclose(reference_information(np.eye(3) * 4e-4, movement, NAMES), H.T @ H / 4e-4, rtol=1e-9)
