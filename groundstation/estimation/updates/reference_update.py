"""Update with a reference position (DGPS): along the flight by the lag of its clock, off the nose by its antenna."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.dgps_clock_lag import DgpsClockLag, has_clock_stepped
from groundstation.estimation.kalman_kernels import LinearMeasurement, innovation_covariance
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import DGPS_ANTENNA
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.updates.measurements import ReferencePosition
from groundstation.estimation.updates.update import (
    LinearCorrection,
    LinearPrediction,
    PredictedState,
    TargetReset,
    Update,
    VarianceInflation,
)
from groundstation.geometry.chi_square import chi_square_quantile
from groundstation.messages import Innovation

# error of a velocity estimated without a reference, due to calibration errors: share of the speed, and a constant
_ADOPTED_SPEED_SHARE, _ADOPTED_SPEED_M_S = 0.4, 2.0
_REJECTED_IN_A_ROW = 5
# a clock is known where its sigma is below this share of the prior's
_KNOWN_SHARE = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NosePosition:
    """The nose (3,) m by a reference, its covariance (3, 3) with that of lag and antenna, and the velocity (3,)."""

    position_m: FloatArray
    covariance_m2: FloatArray
    velocity_m_s: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceHistory:
    """Outcome of the previous reference positions of a target.

    ``newest_s`` is the time of the newest accepted one; ``rejected`` counts those in succession that might have
    replaced the position; ``contradicted`` means that other measurements confirmed a position that one disagreed with.
    """

    newest_s: float = -math.inf
    rejected: int = 0
    contradicted: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether no reference of this target was accepted yet."""
        return self.newest_s == -math.inf

    def after(self, innovation: Innovation, now_s: float, *, may_replace: bool) -> "ReferenceHistory":
        """Return the history with one more reference, which replaced the position if its ``dof`` is 0."""
        if innovation.dof == 0:
            return ReferenceHistory(newest_s=now_s)
        accepted = innovation.accepted
        return ReferenceHistory(
            newest_s=now_s if accepted else self.newest_s,
            rejected=self.rejected + 1 if may_replace and not accepted else 0,
            # a receiver that contradicted other measurements has to be accepted once before it may replace the position
            contradicted=not accepted and (self.contradicted or not may_replace),
        )


class ReferencePositionUpdate:
    """Update with reference positions of the target.

    Parameters
    ----------
    layout, config : of the filter.
    motion : motion model of steady flight, between the filter time and the time of validity.
    """

    def __init__(self, layout: StateLayout, config: EstimationConfig, motion: MotionModel) -> None:
        self._layout, self._motion = layout, motion
        self._clock = DgpsClockLag(layout)
        self._clock_variance_s2 = config.reference_clock_sigma_s**2
        self._known_clock_variance_s2 = (_KNOWN_SHARE * config.reference_clock_sigma_s) ** 2
        self._gate = float(chi_square_quantile(config.gate_probability, 3))
        known = [layout.parameters[name] for name in DGPS_ANTENNA if name in layout.parameters]
        self._antenna = known if len(known) == len(DGPS_ANTENNA) else None

    def __call__(
        self, state: PredictedState, reference: ReferencePosition, history: ReferenceHistory, *, rig_is_open: bool
    ) -> Update:
        """Return the update; for a rig that is not yet estimated (``rig_is_open``) it may replace the position."""
        expected, R = self._expect(state, reference)
        residual = reference.position_m - expected.value
        S = innovation_covariance(state.P, expected.jacobian, R)
        nis = float(residual @ np.linalg.solve(S, residual))
        if rig_is_open and not reference.contradicted and self._replaces(nis, reference, history):
            return self._replacement(state, reference)
        accepted = nis <= self._gate and not reference.contradicted
        innovation = Innovation(residual=residual, covariance=S, nis=nis, dof=3, accepted=accepted)
        if not accepted:
            return Update(innovation)
        return Update(innovation, LinearCorrection(measurement=LinearMeasurement(residual, expected.jacobian, R)))

    def predict(self, x: FloatArray, ahead_s: float, age_s: float = 0.0) -> LinearPrediction:
        """Return the position (3,) of a reference stamped ``ahead_s`` after the time of the state (n,)."""
        dt = self._clock.lag_s(x, ahead_s, age_s)
        velocity = x[self._layout.velocity]
        H = np.zeros((3, self._layout.size))
        H[:, self._layout.position] = np.eye(3)
        H[:, self._layout.velocity] = dt * np.eye(3)
        if self._clock.offset is not None:
            H[:, self._clock.offset] = velocity
        if self._clock.drift is not None:
            H[:, self._clock.drift] = age_s * velocity
        value = x[self._layout.position] + dt * velocity
        if self._antenna is not None:
            # the dependence of the body axes on the velocity is negligible over a metre
            H[:, self._antenna] = runway_from_body(velocity)
            value = value + H[:, self._antenna] @ x[self._antenna]
        return LinearPrediction(value=value, jacobian=H)

    def nose_of(self, state: PredictedState, reference: ReferencePosition) -> NosePosition:
        """Return where a reference has the nose at the filter's time, without its lag and antenna."""
        expected, R = self._expect(state, reference)
        own = expected.jacobian.copy()
        own[:, self._layout.position] = 0.0
        return NosePosition(
            position_m=reference.position_m - expected.value + state.x[self._layout.position],
            covariance_m2=own @ state.P @ own.T + R,
            velocity_m_s=state.x[self._layout.velocity].copy(),
        )

    def clock_step(
        self, state: PredictedState, reference: ReferencePosition, history: ReferenceHistory
    ) -> VarianceInflation | None:
        """Return the inflation of the clock's variance to that of an unknown clock, if its known lag has stepped.

        Never for the first reference of a target.
        """
        offset = self._clock.offset
        if (
            reference.contradicted
            or offset is None
            or history.is_empty
            or state.P[offset, offset] > self._known_clock_variance_s2
        ):
            return None
        expected, R = self._expect(state, reference)
        S = innovation_covariance(state.P, expected.jacobian, R)
        if not has_clock_stepped(reference.position_m - expected.value, S, state.x[self._layout.velocity]):
            return None
        return VarianceInflation(part=slice(offset, offset + 1), variances=np.array([self._clock_variance_s2]))

    def _expect(self, state: PredictedState, reference: ReferencePosition) -> tuple[LinearPrediction, FloatArray]:
        """Return the predicted position and its noise (3, 3)."""
        expected = self.predict(state.x, reference.ahead_s, state.age_s)
        # process noise and velocity error between the filter time and the time of validity
        lag, sigma = self._clock.lag_and_sigma_s(state.x, state.P, reference.ahead_s, state.age_s)
        position, velocity = self._layout.position, self._layout.velocity
        R = reference.covariance_m2 + self._motion.process_noise(math.hypot(lag, sigma))[position, position]
        return expected, R + sigma**2 * state.P[velocity, velocity]

    def _replaces(self, nis: float, reference: ReferencePosition, history: ReferenceHistory) -> bool:
        """Return whether a reference with this NIS replaces the position, for a rig that is not yet estimated."""
        may_replace = reference.may_replace and not history.contradicted
        if history.is_empty:
            return may_replace or nis <= self._gate
        return may_replace and history.rejected >= _REJECTED_IN_A_ROW

    def _replacement(self, state: PredictedState, reference: ReferencePosition) -> Update:
        """Return the target at the reference position, with uncertainty and correlations of its clock and antenna."""
        expected = self.predict(state.x, reference.ahead_s, state.age_s)
        residual = reference.position_m - expected.value
        velocity = state.x[self._layout.velocity].copy()
        spread = state.P[self._layout.velocity, self._layout.velocity].copy()
        spread += np.eye(3) * (_ADOPTED_SPEED_SHARE * float(np.linalg.norm(velocity)) + _ADOPTED_SPEED_M_S) ** 2
        lag, sigma = self._clock.lag_and_sigma_s(state.x, state.P, reference.ahead_s, state.age_s)
        position = self._layout.position
        around = reference.covariance_m2 + (lag**2 + sigma**2) * spread
        around += self._motion.process_noise(math.hypot(lag, sigma))[position, position]
        reset = TargetReset(
            target=np.concatenate([state.x[position] + residual, velocity]),
            # the position is propagated with the velocity, so that their errors are correlated
            covariance=np.block([[around, -lag * spread], [-lag * spread, spread]]),
            correlated=position,
            sensitivity=-expected.jacobian[:, self._layout.constant],
        )
        return Update(Innovation(residual=residual, covariance=around, nis=0.0, dof=0, accepted=True), reset)


def runway_from_body(velocity_m_s: FloatArray) -> FloatArray:
    """Return the body's axes (3, 3) as columns forward, right, down: along the velocity (3,), wings level."""
    level = float(np.hypot(velocity_m_s[0], velocity_m_s[1]))
    speed = float(np.hypot(level, velocity_m_s[2]))
    if level < 1e-6:
        return np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    forward = velocity_m_s / speed
    right = np.array([forward[1], -forward[0], 0.0]) * (speed / level)
    return np.column_stack([forward, right, np.cross(forward, right)])
