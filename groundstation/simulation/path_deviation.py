"""Deviations from a nominal flight: drawn from the filter's own motion model, or made by gusts."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require, require_not_negative, require_positive
from groundstation.simulation.trajectory import SampledTrajectory

MAX_STEPS = 1_000_000


def drawn_deviation(
    generator: np.random.Generator,
    *,
    span_s: tuple[float, float],
    acceleration_psd_m2_s3: tuple[float, float, float],
    position_sigma_m: float = 0.0,
    velocity_sigma_m_s: float = 0.0,
    step_s: float = 0.01,
) -> SampledTrajectory:
    """Draw a deviation from the filter's motion model: constant velocity, driven by white acceleration.

    Position and velocity at the samples have exactly the model's joint statistics, whatever the step; in between,
    the cubic is their conditional mean, off by no more than √(PSD · step³ / 192) at one sigma.

    Parameters
    ----------
    span_s : first and last sample, s.
    acceleration_psd_m2_s3 : (x, y, z) power spectral densities.
    position_sigma_m, velocity_sigma_m_s : spread of the deviation at the first sample, per axis.
    """
    require_not_negative("drawn_deviation: position_sigma_m", position_sigma_m)
    require_not_negative("drawn_deviation: velocity_sigma_m_s", velocity_sigma_m_s)
    psd = _psd("drawn_deviation: acceleration_psd_m2_s3", acceleration_psd_m2_s3)
    t = _steps("drawn_deviation", span_s, step_s)
    dt = float(t[1] - t[0])
    start = generator.normal(size=(2, 3)) * [[position_sigma_m], [velocity_sigma_m_s]]
    kick = generator.normal(size=(t.size - 1, 3)) * np.sqrt(psd * dt)
    # of the position's share dt³/3, dt³/4 is correlated with the velocity's increment and dt³/12 is independent
    slip = 0.5 * dt * kick + generator.normal(size=kick.shape) * np.sqrt(psd * dt**3 / 12.0)
    velocity = start[1] + np.vstack([np.zeros(3), np.cumsum(kick, axis=0)])
    position = start[0] + np.vstack([np.zeros(3), np.cumsum(dt * velocity[:-1] + slip, axis=0)])
    return SampledTrajectory(t_s=t, position_m=position, velocity_m_s=velocity)


@dataclass(frozen=True, slots=True, kw_only=True)
class GustModel:
    """GustModel against an autopilot that holds the path: d̈ = −ω² d − 2ζω ḋ + a, per axis.

    a is the gusts' acceleration, a Gauss-Markov process: the longitudinal form of Dryden's turbulence with
    correlation time L/V, applied as an acceleration.

    Attributes
    ----------
    sigma_m_s2 : (x, y, z) one sigma of a.
    correlation_s : its correlation time.
    hold_rad_s, damping : ω and ζ of the path hold.
    """

    sigma_m_s2: tuple[float, float, float] = (0.6, 0.4, 0.5)
    correlation_s: float = 1.0
    hold_rad_s: float = 0.6
    damping: float = 0.7

    def __post_init__(self) -> None:
        require(len(self.sigma_m_s2) == 3, "Gusts: sigma_m_s2", got=self.sigma_m_s2, wanted="three numbers")
        for sigma in self.sigma_m_s2:
            require_not_negative("Gusts: sigma_m_s2", sigma)
        require_positive("Gusts: correlation_s", self.correlation_s)
        require_positive("Gusts: hold_rad_s", self.hold_rad_s)
        require_positive("Gusts: damping", self.damping)

    @property
    def stationary_covariance(self) -> FloatArray:
        """Covariance (3, 3) of d (m), ḋ (m/s), a (m/s²) per unit variance of a, once the start is forgotten."""
        return np.asarray(solve_continuous_lyapunov(self._dynamics(), -self._drive()), dtype=np.float64)

    def draw(
        self, generator: np.random.Generator, span_s: tuple[float, float], step_s: float = 0.02
    ) -> SampledTrajectory:
        """Draw a deviation over a span, in its stationary state from the start."""
        t = _steps("GustModel", span_s, step_s)
        transition = np.asarray(expm(self._dynamics() * (t[1] - t[0])), dtype=np.float64)
        stationary = self.stationary_covariance
        # in the stationary state P = F P Fᵀ + Q
        driven = _root(stationary - transition @ stationary @ transition.T)
        normal = generator.normal(size=(t.size, 3, 3)) * np.array(self.sigma_m_s2)
        state = np.empty_like(normal)
        state[0] = _root(stationary) @ normal[0]
        gusts = driven @ normal
        # into the array itself: what numpy does around three by three numbers is most of the time
        for before, after, gust in zip(state[:-1], state[1:], gusts[1:], strict=True):
            np.dot(transition, before, out=after)
            np.add(after, gust, out=after)
        return SampledTrajectory(t_s=t, position_m=state[:, 0], velocity_m_s=state[:, 1])

    def _dynamics(self) -> FloatArray:
        w = self.hold_rad_s
        return np.array(
            [[0.0, 1.0, 0.0], [-w * w, -2.0 * self.damping * w, 1.0], [0.0, 0.0, -1.0 / self.correlation_s]]
        )

    def _drive(self) -> FloatArray:
        return np.diag([0.0, 0.0, 2.0 / self.correlation_s])


def _root(covariance: FloatArray) -> FloatArray:
    """Return a square root of the covariance, which may be nearly singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def _steps(where: str, span_s: tuple[float, float], step_s: float) -> FloatArray:
    """Return evenly spaced times that cover the span, at most ``step_s`` apart."""
    require_positive(f"{where}: step_s", step_s)
    length = span_s[1] - span_s[0]
    require(math.isfinite(length) and length > 0, f"{where}: span_s", got=span_s, wanted="an end after the start")
    count = math.ceil(length / step_s)
    require(count <= MAX_STEPS, f"{where}: step_s", got=f"{count} steps", wanted=f"at most {MAX_STEPS}")
    return np.linspace(span_s[0], span_s[1], count + 1)


def _psd(where: str, values: tuple[float, float, float]) -> FloatArray:
    require(len(values) == 3, where, got=values, wanted="three numbers")
    for value in values:
        require_not_negative(where, value)
    return np.array(values)
