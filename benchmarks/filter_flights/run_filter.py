"""The filter alone on a simulated flight: every reading, pixel and reference position at its own stamp."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.measurements import ReferencePosition
from groundstation.messages import DgpsFix, Epoch, PixelMeasurement, PtuSample
from groundstation.simulation import SimulatedFlight

Recorded = PtuSample | PixelMeasurement | DgpsFix | Epoch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """The filter's initial state at time ``t_s``: position and velocity (6,) with covariance (6, 6)."""

    t_s: float
    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """The filter's results on one flight, one row for each of n epochs and m pixels.

    Attributes
    ----------
    t_s : (n,) epochs' stamps.
    truth : (n, 6) true position and velocity then.
    error : (n, 6) estimate − truth.
    covariance : (n, 6, 6) the filter's own.
    nis : (m,) normalised innovation squares of the pixels, 2 degrees of freedom; ``nis_s`` (m,) their times.
    refused : number of pixels that the gate refused.
    parameters : (k,) estimated errors of rig and clocks at the end, with ``parameter_covariance`` (k, k).
    manoeuvring : (n,) probability of the second mode.
    """

    t_s: FloatArray
    truth: FloatArray
    error: FloatArray
    covariance: FloatArray
    nis: FloatArray
    nis_s: FloatArray
    refused: int
    parameters: FloatArray
    parameter_covariance: FloatArray
    manoeuvring: FloatArray

    def nees(self, count: int = 3) -> FloatArray:
        """Return the normalised error squares (n,) of position (3) or of position and velocity (6)."""
        e, P = self.error[:, :count], self.covariance[:, :count, :count]
        return np.asarray(np.einsum("ni,ni->n", e, np.linalg.solve(P, e[..., None])[..., 0]))


def in_order(flight: SimulatedFlight, reference: Callable[[DgpsFix], bool] = lambda _: False) -> list[Recorded]:
    """Return the filter's input, by stamp: readings first, an epoch last; the references that are used."""
    ranks = {PtuSample: 0, PixelMeasurement: 1, DgpsFix: 2, Epoch: 3}
    # an epoch's stamp is the mean of its frames': it is evaluated at the filter's present time
    records = [e for e in flight.events if isinstance(e, (PtuSample, PixelMeasurement, Epoch))]
    chosen = [*records, *(fix for fix in flight.dgps if reference(fix))]
    return sorted(chosen, key=lambda e: (round(e.t_s, 9), ranks[type(e)]))


def true_states(flight: SimulatedFlight, t_s: FloatArray) -> FloatArray:
    """Return true position and velocity (n, 6) at session times (n,)."""
    trajectory = flight.scenario.trajectory
    return np.hstack([trajectory.position(t_s), trajectory.velocity(t_s)])


def drawn_start(
    flight: SimulatedFlight, seed: int, position_m: float, velocity_m_s: float, lead_s: float = 0.0
) -> Start:
    """Return the truth ``lead_s`` before the first pair, off by a draw from a prior of these sigmas."""
    t = float(flight.scenario.trajectory.span_s[0]) - lead_s
    sigma = np.repeat([position_m, velocity_m_s], 3)
    off = np.random.default_rng([seed, 9]).normal(size=6) * sigma
    return Start(t_s=t, mean=true_states(flight, np.array([t]))[0] + off, covariance=np.diag(sigma**2))


def new_filter(flight: SimulatedFlight, config: EstimationConfig, prior: ParameterPrior) -> StationEkf:
    """Return a filter for the assumed rig of the flight."""
    stations = flight.rig.stations
    turning = tuple(s.name for s in stations if not s.fixed)
    return StationEkf({s.name: s.geometry() for s in stations}, turning, config, prior)


def drive(
    flight: SimulatedFlight,
    config: EstimationConfig,
    start: Start,
    *,
    prior: ParameterPrior | None = None,
    reference: Callable[[DgpsFix], bool] = lambda _: False,
) -> Run:
    """Run the filter over a flight; references that ``reference`` lets in are fused."""
    prior = ParameterPrior.nothing() if prior is None else prior
    ekf = new_filter(flight, config, prior)
    angle_sigma = {s.name: s.angle_sigma_rad for s in flight.rig.stations}
    noise = {name: c.pixel_covariance_px2 for name, c in flight.scenario.cameras.items()}
    times, states, covariances, modes = [], [], [], []
    nis, nis_s, refused = [], [], 0
    for event in in_order(flight, reference):
        ekf.predict_to(event.t_s)
        if not ekf.has_target and event.t_s >= start.t_s - 1e-9:
            ekf.start_target(start.mean[:3], start.mean[3:], start.covariance)
        if isinstance(event, PtuSample):
            angles = (event.pan_rad, event.tilt_rad)
            ekf.update_encoder(event.station, angles, angle_sigma[event.station], 0.0, 0.0)
        elif isinstance(event, PixelMeasurement) and ekf.has_target:
            innovation = ekf.update_pixel(event.station, np.array([event.u_px, event.v_px]), noise[event.station])
            if innovation is not None:
                nis.append(innovation.nis)
                nis_s.append(event.t_s)
                refused += not innovation.accepted
        elif isinstance(event, DgpsFix) and ekf.has_target and event.sigma_m is not None:
            ekf.update_reference(ReferencePosition(event.position_runway_m, np.diag(event.sigma_m**2)))
        elif isinstance(event, Epoch) and ekf.has_target:
            assert ekf.time_s is not None
            times.append(ekf.time_s)
            states.append(ekf.state[:6].copy())
            covariances.append(ekf.covariance[:6, :6].copy())
            modes.append(ekf.manoeuvring)
    t = np.array(times)
    truth = true_states(flight, t)
    constant = ekf.layout.constant
    return Run(
        t_s=t,
        truth=truth,
        error=np.array(states) - truth,
        covariance=np.array(covariances),
        nis=np.array(nis),
        nis_s=np.array(nis_s),
        refused=refused,
        parameters=ekf.state[constant].copy(),
        parameter_covariance=ekf.covariance[constant, constant].copy(),
        manoeuvring=np.array(modes),
    )
