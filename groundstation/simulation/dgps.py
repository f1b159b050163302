"""DGPS fixes of the aircraft's antenna: noisy, in a clock of their own, sometimes absent, sometimes frozen."""

import math
from dataclasses import dataclass, field

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import DgpsFix
from groundstation.simulation.flight_window import FlightWindow
from groundstation.simulation.parameter_checks import (
    require,
    require_finite,
    require_not_negative,
    require_positive,
    require_shape,
)
from groundstation.simulation.trajectory import OrientedTrajectory, Trajectory

MAX_FIXES = 1_000_000
_DRIFT_LIMIT_PPM = 1e5
_MIN_SPEED_M_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DgpsModel:
    """A receiver on the aircraft.

    Attributes
    ----------
    rate_hz, phase_s : fixes are taken at phase + k / rate of true session time.
    sigma_m : (3,) one sigma per axis of the runway frame, of each fix for itself.
    wander_sigma_m, wander_s : (3,) one sigma of a slow error in addition, as of orbits and air, and its correlation
        time; a fix states both together.
    clock_offset_s, clock_drift_ppm : t_dgps = t_session + offset + drift · t_session.
    antenna_in_body_m : (3,) from the nose: x forward, y right, z down. Without an attitude of the trajectory's own,
        forward is the track's direction.
    available : where there are fixes.
    frozen : when the receiver repeats its last position; None for never.
    """

    rate_hz: float = 10.0
    phase_s: float = 0.0
    sigma_m: FloatArray = field(default_factory=lambda: np.full(3, 0.02))
    wander_sigma_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    wander_s: float = 60.0
    clock_offset_s: float = 0.0
    clock_drift_ppm: float = 0.0
    antenna_in_body_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    available: FlightWindow = field(default_factory=FlightWindow)
    frozen: FlightWindow | None = None

    def __post_init__(self) -> None:
        require_positive("DgpsModel: rate_hz", self.rate_hz)
        require_finite("DgpsModel: phase_s", self.phase_s)
        require_shape("DgpsModel: sigma_m", self.sigma_m, (3,))
        require_shape("DgpsModel: wander_sigma_m", self.wander_sigma_m, (3,))
        for sigma in (*self.sigma_m, *self.wander_sigma_m):
            require_not_negative("DgpsModel: sigma_m and wander_sigma_m", float(sigma))
        require_positive("DgpsModel: wander_s", self.wander_s)
        require_shape("DgpsModel: antenna_in_body_m", self.antenna_in_body_m, (3,))
        usual = abs(self.clock_drift_ppm) < _DRIFT_LIMIT_PPM and math.isfinite(self.clock_offset_s)
        got = f"{self.clock_offset_s:g} s and {self.clock_drift_ppm:g} ppm"
        require(usual, "DgpsModel: clock", got=got, wanted=f"a finite offset, drift below {_DRIFT_LIMIT_PPM:g} ppm")


def take_fixes(
    model: DgpsModel, trajectory: Trajectory, span_s: tuple[float, float], generator: np.random.Generator
) -> tuple[DgpsFix, ...]:
    """Take the fixes over a span of true session time, s; their stamps are in the DGPS clock."""
    first = math.ceil((span_s[0] - model.phase_s) * model.rate_hz - 1e-9)
    last = math.floor((span_s[1] - model.phase_s) * model.rate_hz + 1e-9)
    got = f"{last - first + 1} fixes"
    require(last - first < MAX_FIXES, "DgpsModel: rate_hz", got=got, wanted=f"at most {MAX_FIXES}")
    t = np.arange(first, last + 1) / model.rate_hz + model.phase_s
    nose, velocity = trajectory.position(t), trajectory.velocity(t)
    if isinstance(trajectory, OrientedTrajectory):
        measured = nose + np.array([trajectory.attitude(float(at)) @ model.antenna_in_body_m for at in t])
    else:
        measured = antenna_positions(nose, velocity, model.antenna_in_body_m)
    measured = measured + generator.normal(size=(t.size, 3)) * model.sigma_m
    if np.any(model.wander_sigma_m):
        measured = measured + _wander(model, t.size, generator)
    if model.frozen is not None:
        measured = _held(measured, model.frozen.holds(t, nose))
    stamps = t + model.clock_offset_s + model.clock_drift_ppm * 1e-6 * t
    # a noiseless receiver still has to report a sigma > 0, or none
    stated = np.hypot(model.sigma_m, model.wander_sigma_m)
    sigma = stated if np.all(stated > 0) else None
    there = model.available.holds(t, nose)
    return tuple(
        DgpsFix(t_s=float(stamp), position_runway_m=place, sigma_m=sigma)
        for stamp, place in zip(stamps[there], measured[there], strict=True)
    )


def antenna_positions(nose_m: FloatArray, velocity_m_s: FloatArray, antenna_in_body_m: FloatArray) -> FloatArray:
    """Return where the antenna is, (n, 3) m, for noses (n, 3) and velocities (n, 3): along the track, zero roll.

    At rest or in vertical flight the track has no direction: the aircraft then points along −y.
    """
    speed = np.linalg.norm(velocity_m_s, axis=1, keepdims=True)
    resting = np.array([0.0, -1.0, 0.0])
    level = np.hypot(velocity_m_s[:, :1], velocity_m_s[:, 1:2])
    moving = (speed > _MIN_SPEED_M_S) & (level > 1e-3 * speed)
    forward = np.where(moving, velocity_m_s / np.where(moving, speed, 1.0), resting)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    down = np.cross(forward, right)
    x, y, z = antenna_in_body_m
    return np.asarray(nose_m + x * forward + y * right + z * down)


def _wander(model: DgpsModel, count: int, generator: np.random.Generator) -> FloatArray:
    """Return the slow error (n, 3) of fixes in a row, m: a Gauss-Markov process in its stationary state."""
    kept = math.exp(-1.0 / (model.rate_hz * model.wander_s))
    drawn = generator.normal(size=(count, 3)) * model.wander_sigma_m
    for k in range(1, count):
        drawn[k] = kept * drawn[k - 1] + math.sqrt(1.0 - kept * kept) * drawn[k]
    return drawn


def _held(positions_m: FloatArray, frozen: np.ndarray) -> FloatArray:
    """Return positions (n, 3) with each frozen one replaced by the last that was not (or by the first)."""
    fresh = np.where(frozen, 0, np.arange(len(positions_m)))
    return np.asarray(positions_m[np.maximum.accumulate(fresh)])
