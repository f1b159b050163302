"""Bounds of a simulated flight, along its true track: the limit of any filter with the true models.

`track_bound` is the posterior bound with one reading of the angles at each exposure, by the information of pairs
(`groundstation.evaluation`). `full_bound` processes the events that the filter gets, angles and rates of
the PTUs being states, too: for readings that are not at the exposures.
"""

from collections.abc import Callable, Sequence

import numpy as np

from filter_flights.run_filter import Start, in_order
from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.state_model import StateLayout, state_layout
from groundstation.estimation.updates.encoder_update import EncoderUpdate
from groundstation.estimation.updates.pixel_model import PixelModel
from groundstation.estimation.updates.reference_update import ReferencePositionUpdate
from groundstation.evaluation.bounds import StationView
from groundstation.evaluation.calibration_bounds import (
    MotionProfile,
    joint_information,
    nuisance_sensitivities,
    reference_information,
    track_learning,
)
from groundstation.messages import DgpsFix, Epoch, PixelMeasurement, PtuSample
from groundstation.simulation import SimulatedFlight
from groundstation.simulation.pointing import pointing_history

# sigma of an unknown rate
_RATE_SIGMA_RAD_S = np.radians(20.0)


def joint_series(
    flight: SimulatedFlight, names: Sequence[str] = (), reference_sigma_m: Callable[[float], float | None] | None = None
) -> FloatArray:
    """Return the joint information (n, 3 + m, 3 + m) of each pair, at the truth, with that of a reference if any.

    ``reference_sigma_m`` gives the sigma of a reference position at a true y, or None where there is none.
    """
    truth, series = flight.truth, []
    stations = {s.name: s for s in flight.scenario.true_rig.stations}
    geometries = {name: s.geometry() for name, s in stations.items()}
    for k, point in enumerate(truth.position_runway_m):
        seen = [name for name in stations if truth.stations[name].reported[k]]
        views = [
            StationView(
                geometry=geometries[name],
                pan_rad=float(truth.stations[name].angles_rad[k, 0]),
                tilt_rad=float(truth.stations[name].angles_rad[k, 1]),
                pixel_covariance_px2=flight.scenario.cameras[name].pixel_covariance_px2,
                angle_sigma_rad=stations[name].angle_sigma_rad,
            )
            for name in seen
        ]
        movement = MotionProfile(
            velocity_runway_m_s=truth.velocity_runway_m_s[k],
            rates_rad_s=[truth.stations[name].rates_rad_s[k] for name in seen],
            age_s=float(truth.t_s[k] - truth.t_s[0]),
        )
        joint = np.zeros((3 + len(names),) * 2)
        if views:
            joint += joint_information(point, views, nuisance_sensitivities(point, views, movement, names))
        sigma = None if reference_sigma_m is None else reference_sigma_m(float(point[1]))
        if sigma is not None:
            joint += reference_information(np.eye(3) * sigma**2, movement, names)
        series.append(joint)
    return np.array(series)


def track_bound(
    flight: SimulatedFlight,
    psd_m2_s3: Sequence[float],
    start_sigmas: tuple[float, float],
    prior: ParameterPrior | None = None,
    reference_sigma_m: Callable[[float], float | None] | None = None,
) -> FloatArray:
    """Return the posterior bound (n, 6 + m, 6 + m) of each pair, for initial sigmas of position and velocity."""
    prior = ParameterPrior.nothing() if prior is None else prior
    joint = joint_series(flight, prior.names, reference_sigma_m)
    return track_learning(flight.truth.t_s, joint, prior.covariance, np.asarray(psd_m2_s3), *start_sigmas)


def full_bound(
    flight: SimulatedFlight,
    config: EstimationConfig,
    start: Start,
    *,
    prior: ParameterPrior,
    truth: FloatArray,
    reference: Callable[[DgpsFix], bool] = lambda _: False,
) -> FloatArray:
    """Return the bound (n, s, s) of the whole state after each epoch, ``truth`` (m,) being the carried errors' own.

    The recursion of the information along the true track: prediction by the motion model, each measurement by its
    Jacobian at the true state.
    """
    stations = flight.rig.stations
    turning = tuple(s.name for s in stations if not s.fixed)
    layout = state_layout(turning, prior.names)
    motion = MotionModel(layout, config.acceleration_psd_m2_s3, config.ptu_acceleration_psd_rad2_s3, prior.walk_psd)
    pixels = {s.name: PixelModel(layout, s.geometry()) for s in stations}
    encoders = {name: EncoderUpdate(layout, name, config) for name in turning}
    angle_variance = {s.name: s.angle_sigma_rad**2 for s in stations}
    reference_model = ReferencePositionUpdate(layout, config, motion)
    events = in_order(flight, reference)
    states = _true_states(flight, layout, np.array([e.t_s for e in events]), truth)
    P = np.zeros((layout.size, layout.size))
    P[layout.target, layout.target] = start.covariance
    for name in turning:
        P[layout.angles[name], layout.angles[name]] = np.eye(2)
        P[layout.rates[name], layout.rates[name]] = np.eye(2) * _RATE_SIGMA_RAD_S**2
    P[layout.constant, layout.constant] = prior.covariance
    started, bounds, first_s, now_s = False, [], events[0].t_s, events[0].t_s
    for event, state in zip(events, states, strict=True):
        dt, now_s, age = event.t_s - now_s, event.t_s, event.t_s - first_s
        if dt > 0.0:
            F, Q = motion.transition(dt), motion.process_noise(dt)
            P = F @ P @ F.T + Q
        if not started:
            # until then the target is whatever it will be
            P[layout.target, :] = P[:, layout.target] = 0.0
            P[layout.target, layout.target] = start.covariance
            started = event.t_s >= start.t_s - 1e-9
        match event:
            case PtuSample():
                H = encoders[event.station].predict(state, 0.0).jacobian
                P = _informed(P, H, np.eye(2) * angle_variance[event.station])
            case PixelMeasurement() if started:
                seen = pixels[event.station].predict(state, 0.0, age)
                if seen is not None:
                    R = flight.scenario.cameras[event.station].pixel_covariance_px2
                    P = _informed(P, seen.jacobian, R)
            case DgpsFix() if started and event.sigma_m is not None:
                P = _informed(P, reference_model.predict(state, 0.0, age).jacobian, np.diag(event.sigma_m**2))
            case Epoch() if started:
                bounds.append(P)
    return np.array(bounds)


def _informed(P: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    """Return (P⁻¹ + Hᵀ R⁻¹ H)⁻¹ without an inverse of P, which may be singular (Woodbury's identity)."""
    across = H @ P
    after = P - across.T @ np.linalg.solve(across @ H.T + R, across)
    return np.asarray(0.5 * (after + after.T))


def _true_states(flight: SimulatedFlight, layout: StateLayout, t_s: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return the true state (k, s) at session times (k,)."""
    scenario = flight.scenario
    states = np.zeros((t_s.size, layout.size))
    states[:, layout.position] = scenario.trajectory.position(t_s)
    states[:, layout.velocity] = scenario.trajectory.velocity(t_s)
    reach = (float(t_s[0]) - 1.0, float(t_s[-1]) + 1.0)
    for name in layout.angles:
        geometry = scenario.true_rig[name].geometry()
        # the states are those at this time of the PTU's clock
        late = _ptu_lateness(layout, name, t_s, parameters)
        history = pointing_history(scenario.ptus[name].pointing, geometry, scenario.trajectory, reach)
        pointing = history.at(t_s + late)
        states[:, layout.angles[name]] = pointing.head_rad
        states[:, layout.rates[name]] = pointing.head_rate_rad_s
    states[:, layout.constant] = parameters
    return states


def _ptu_lateness(layout: StateLayout, station: str, t_s: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return by how much readings are later than their stamps (k,)."""
    late = np.zeros_like(t_s)
    for part, factor in (("offset", np.ones_like(t_s)), ("drift", t_s - t_s[0])):
        place = layout.parameters.get(f"{station}.ptu_clock.{part}")
        if place is not None:
            late = late + parameters[place - layout.constant.start] * factor
    return late
