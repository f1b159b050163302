"""An inertial navigator that runway poses correct: error-state EKF over position, velocity, attitude and biases.

The frame is the runway's, taken as inertial and level: for a few minutes of a low-cost unit the earth's rate is part
of the gyroscopes' bias.
"""

import enum
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.geometry.rotation import matrix_from_wxyz, wxyz_from_matrix
from groundstation.onboard.pose.inertial_kernel import STATE_SIZE, SquaredNoises, predict, turned

POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
ATTITUDE = slice(6, 9)
FORCE_BIAS = slice(9, 12)
RATE_BIAS = slice(12, 15)
# unit and frame of each part of the error state
STATE = {
    "position": (POSITION, "m, runway"),
    "velocity": (VELOCITY, "m/s, runway"),
    "attitude": (ATTITUDE, "rad, rotation vector δθ in the runway frame, R_true = exp([δθ]×) R"),
    "force_bias": (FORCE_BIAS, "m/s², body"),
    "rate_bias": (RATE_BIAS, "rad/s, body"),
}
GATE_CHANCE = 1e-3
_GATE = float(chi_square_limit(GATE_CHANCE, 6))


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialConfig:
    """Tuning; noise densities of the unit's data sheet.

    Attributes
    ----------
    force_noise, rate_noise : white, m/s²/√Hz and rad/s/√Hz.
    force_bias_walk, rate_bias_walk : of the biases, m/s²/√s and rad/s/√s.
    force_bias_sigma, rate_bias_sigma : of the biases at the start, m/s² and rad/s.
    speed_sigma_m_s : of the velocity at the start, about zero.
    coasting_after_s : without a pose for so long the state coasts.
    restart_after : so many poses refused in a row, and the filter starts again from the next.
    """

    force_noise: float = 2e-3
    rate_noise: float = 1.5e-4
    force_bias_walk: float = 3e-4
    rate_bias_walk: float = 1e-5
    force_bias_sigma: float = 0.05
    rate_bias_sigma: float = 1e-3
    speed_sigma_m_s: float = 50.0
    coasting_after_s: float = 0.5
    restart_after: int = 20

    @property
    def squared_noises(self) -> SquaredNoises:
        """Return the squares of the unit's noise densities, as the kernel takes them."""
        return SquaredNoises(
            force=self.force_noise * self.force_noise,
            rate=self.rate_noise * self.rate_noise,
            force_bias=self.force_bias_walk * self.force_bias_walk,
            rate_bias=self.rate_bias_walk * self.rate_bias_walk,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuSample:
    """One sample: specific force (3,) in m/s² and rate (3,) in rad/s, body frame, held until the next one's ``t_s``."""

    t_s: float
    force_m_s2: FloatArray
    rate_rad_s: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseObservation:
    """A camera's pose in the runway frame: position (3,), quaternion (4,), covariance (6, 6) as in `RunwayPose`.

    ``lasting`` (6, 6): its constant errors. The gate includes them, the weight does not: the caller
    accounts for their effect on the state.
    """

    t_s: float
    position_m: FloatArray
    runway_from_camera_wxyz: FloatArray
    covariance: FloatArray
    lasting: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraMount:
    """Where the camera sits: ``camera_in_body_m`` (3,) and ``body_from_camera`` (3, 3)."""

    camera_in_body_m: FloatArray
    body_from_camera: FloatArray


class UpdateOutcome(enum.StrEnum):
    """What became of an observation."""

    STARTED = "started"
    USED = "used"
    GATED = "gated"
    RESTARTED = "restarted"
    LATE = "late"


class NavigationStatus(enum.StrEnum):
    """Where the filter stands."""

    WAITING = "waiting"
    AIDED = "aided"
    COASTING = "coasting"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseInnovation:
    """Innovation of an observation: ``value`` (6,) position (m) and rotation (rad), its covariance (6, 6), NIS."""

    outcome: UpdateOutcome
    value: FloatArray
    covariance: FloatArray

    @property
    def nis(self) -> float:
        """Return the normalised square; χ² with six degrees of freedom in a consistent filter."""
        return float(self.value @ np.linalg.solve(self.covariance, self.value))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Navigation:
    """The state at one time: vectors (3,), quaternion (4,), P (15, 15) ordered as `STATE`."""

    t_s: float
    position_m: FloatArray
    velocity_m_s: FloatArray
    runway_from_body_wxyz: FloatArray
    force_bias_m_s2: FloatArray
    rate_bias_rad_s: FloatArray
    P: FloatArray
    status: NavigationStatus


class InertialFilter:
    """The filter: samples move it, poses start and correct it.

    Parameters
    ----------
    config : tuning.
    mount : of the camera on the body.
    """

    def __init__(self, config: InertialConfig, mount: CameraMount) -> None:
        self._config, self._mount, self._noises = config, mount, config.squared_noises
        self._t_s = -np.inf
        self._seen_s = -np.inf
        self._refused = 0
        self._last: ImuSample | None = None
        self._p, self._v, self._q = np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self._force_bias, self._rate_bias = np.zeros(3), np.zeros(3)
        self._P = np.zeros((STATE_SIZE, STATE_SIZE))

    @property
    def navigation(self) -> Navigation:
        """Return the state."""
        if not np.isfinite(self._seen_s):
            status = NavigationStatus.WAITING
        elif self._t_s - self._seen_s > self._config.coasting_after_s:
            status = NavigationStatus.COASTING
        else:
            status = NavigationStatus.AIDED
        return Navigation(
            t_s=self._t_s,
            position_m=self._p.copy(),
            velocity_m_s=self._v.copy(),
            runway_from_body_wxyz=self._q.copy(),
            force_bias_m_s2=self._force_bias.copy(),
            rate_bias_rad_s=self._rate_bias.copy(),
            P=self._P.copy(),
            status=status,
        )

    @property
    def started(self) -> bool:
        """Return whether a pose has started it."""
        return bool(np.isfinite(self._seen_s))

    def process_imu(self, sample: ImuSample) -> None:
        """Take an inertial sample: the state moves to its time under the sample before it.

        A sample that is not later than the last is left out.
        """
        if self._last is not None and sample.t_s <= self._last.t_s:
            return
        self._move_to(sample.t_s)
        self._last = sample
        self._t_s = sample.t_s

    def update(self, observation: PoseObservation) -> PoseInnovation:
        """Take a pose: start from it, correct the state, or refuse it; a pose older than the state is late and left."""
        if not self.started:
            return self._start(observation, UpdateOutcome.STARTED)
        if observation.t_s < self._t_s - 1e-9:
            return PoseInnovation(outcome=UpdateOutcome.LATE, value=np.zeros(6), covariance=observation.covariance)
        self._move_to(observation.t_s)
        value, H = self._innovation(observation)
        S = H @ self._P @ H.T + observation.covariance
        innovation = PoseInnovation(outcome=UpdateOutcome.USED, value=value, covariance=S)
        allowed = innovation
        if observation.lasting is not None:
            allowed = PoseInnovation(outcome=UpdateOutcome.USED, value=value, covariance=S + observation.lasting)
        if allowed.nis > _GATE:
            self._refused += 1
            if self._refused >= self._config.restart_after:
                return self._start(observation, UpdateOutcome.RESTARTED)
            return PoseInnovation(outcome=UpdateOutcome.GATED, value=value, covariance=allowed.covariance)
        self._refused = 0
        self._correct(H, value, S, observation.covariance)
        self._seen_s = observation.t_s
        return allowed

    def camera_pose(self) -> tuple[FloatArray, FloatArray]:
        """Return where the state puts the camera: position (3,) and runway_from_camera_wxyz (4,)."""
        R = matrix_from_wxyz(self._q)
        return self._p + R @ self._mount.camera_in_body_m, wxyz_from_matrix(R @ self._mount.body_from_camera)

    def _move_to(self, t_s: float) -> None:
        """Move the state under the last sample; before the start, or without a sample, time alone moves."""
        dt = t_s - self._t_s
        if self.started and self._last is not None and dt > 0:
            force = self._last.force_m_s2 - self._force_bias
            rate = self._last.rate_rad_s - self._rate_bias
            predict(self._p, self._v, self._q, self._P, force, rate, dt, self._noises)
        self._t_s = max(t_s, self._t_s)

    def _innovation(self, observation: PoseObservation) -> tuple[FloatArray, FloatArray]:
        """Return the innovation (6,) and its Jacobian (6, 15)."""
        R = matrix_from_wxyz(self._q)
        arm = R @ self._mount.camera_in_body_m
        seen = matrix_from_wxyz(observation.runway_from_camera_wxyz)
        turn = rotation_vector(seen @ (R @ self._mount.body_from_camera).T)
        H = np.zeros((6, STATE_SIZE))
        H[:3, POSITION] = np.eye(3)
        # exp([δθ]×) arm = arm − [arm]× δθ
        H[:3, ATTITUDE] = [[0.0, arm[2], -arm[1]], [-arm[2], 0.0, arm[0]], [arm[1], -arm[0], 0.0]]
        H[3:, ATTITUDE] = np.eye(3)
        return np.concatenate([observation.position_m - self._p - arm, turn]), H

    def _correct(self, H: FloatArray, value: FloatArray, S: FloatArray, noise: FloatArray) -> None:
        """Correct by the innovation, Joseph form."""
        K = np.linalg.solve(S, H @ self._P).T
        change = K @ value
        I_KH = np.eye(STATE_SIZE) - K @ H
        self._P = I_KH @ self._P @ I_KH.T + K @ noise @ K.T
        self._p = self._p + change[POSITION]
        self._v = self._v + change[VELOCITY]
        x, y, z = change[ATTITUDE]
        self._q = turned(self._q, x, y, z, False)
        self._force_bias = self._force_bias + change[FORCE_BIAS]
        self._rate_bias = self._rate_bias + change[RATE_BIAS]

    def _start(self, observation: PoseObservation, outcome: UpdateOutcome) -> PoseInnovation:
        """Start from a pose; velocity and biases start with the configuration's sigmas."""
        config = self._config
        R = matrix_from_wxyz(observation.runway_from_camera_wxyz) @ self._mount.body_from_camera.T
        arm = R @ self._mount.camera_in_body_m
        self._q, self._p = wxyz_from_matrix(R), observation.position_m - arm
        self._v, self._force_bias, self._rate_bias = np.zeros(3), np.zeros(3), np.zeros(3)
        # the body's position is the camera's less exp([δθ]×) arm
        G = np.eye(6)
        G[:3, 3:] = [[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]]
        P = np.zeros((STATE_SIZE, STATE_SIZE))
        both = np.r_[POSITION, ATTITUDE]
        P[np.ix_(both, both)] = G @ observation.covariance @ G.T
        for part, sigma in (
            (VELOCITY, config.speed_sigma_m_s),
            (FORCE_BIAS, config.force_bias_sigma),
            (RATE_BIAS, config.rate_bias_sigma),
        ):
            P[part, part] = sigma**2 * np.eye(3)
        self._P = P
        self._t_s = max(observation.t_s, self._t_s)
        self._seen_s = observation.t_s
        self._refused = 0
        return PoseInnovation(outcome=outcome, value=np.zeros(6), covariance=observation.covariance)


def rotation_vector(matrix: FloatArray) -> FloatArray:
    """Return θ (3,) in rad, |θ| ≤ π, with exp([θ]×) the rotation matrix (3, 3)."""
    w, *v = wxyz_from_matrix(matrix)
    sine = float(np.linalg.norm(v))
    scale = 2.0 if sine < 1e-12 else 2.0 * np.arctan2(sine, w) / sine
    return np.asarray(scale * np.array(v))
