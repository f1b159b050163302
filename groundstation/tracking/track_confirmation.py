"""Track confirmation: the evidence that a target found by searching is a flying aircraft.

A found target must have a configured number of fixes within a configured time, and then move away from where it was
found; otherwise it is a false track. A confirmed track that stands still for long is dropped as well: a stopped
aircraft needs no guidance, and a detector that has lost the aircraft tends to stay on a ground feature. A track with a
given initial state needs no confirmation.

A target that the learned channel recognises as an aircraft is kept while it stands: it is going to take off, or has
landed. It is not reported before it moves, and what moves takes its place (`TrackStateMachine.yields_to`).

What is on the ground and moves across the runway's direction is a vehicle or an animal, unless it is recognised: an
aircraft that lands or takes off flies, or rolls along the runway. It is held, so that it is not found again as a part
of another pair, and not reported; what moves and is recognised takes its place.
"""

from collections import deque

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.variance_check import sigma_of

# squared distance from the place of detection, five sigmas
_MOVED_GATE = 25.0
_POSITION_EVERY_S = 0.25
# a target that stood moves at this speed, which differs from zero by six sigmas, as in track initiation
_MOVING_GATE, _LEAST_SPEED_M_S = 36.0, 2.0
# and a target that was found in motion is reported once its velocity differs from zero by five: a thing on the ground,
# whose range is uncertain, seems to move along the line of sight. With gates of 0, 16, 25 and 36 two validate worlds
# have 79, 18, 13 and 1 misleading epochs, and 58 train worlds 2168, 2129, 2108 and 2061 epochs *tracking*
_FLYING_GATE = 25.0
# what is not higher than a lorry, above the threshold, for sure may be on the ground: the highest that European roads
# allow, not a figure of recordings; two sigmas are a choice
_ON_GROUND_M, _HEIGHT_SIGMAS = 4.0, 2.0


class TrackConfirmation:
    """Fixes, velocity convergence and motion of one track since its start.

    Attributes
    ----------
    has_crossed : whether it was not reported because it crossed the runway's direction on the ground.
    """

    def __init__(self, config: EstimationConfig) -> None:
        self._config = config
        self._started_s = 0.0
        self._fixes = 0
        self._velocity_converged = False
        self._found_at: FloatArray | None = None
        self._is_standing = False
        self.has_crossed = False
        # recent times and positions of a confirmed track
        self._recent_positions: deque[tuple[float, FloatArray]] | None = None

    @property
    def has_fix(self) -> bool:
        """Whether the track has had a fix."""
        return self._fixes > 0

    @property
    def is_standing(self) -> bool:
        """Whether the target was found without motion, or has come to stand, and has not moved since."""
        return self._is_standing

    @property
    def has_settled(self) -> bool:
        """Whether the velocity has converged, so that a target that moves is reported."""
        return self._velocity_converged

    def start(self, t_s: float, found_at_m: FloatArray | None, *, known: bool = False, standing: bool = False) -> None:
        """Start a track at ``t_s``; ``found_at_m`` (3,) is the position found by searching, None for a given target.

        ``known``: of a target that was confirmed before, which may still come to stand; ``standing``: of one that was
        found by what it looks like, without motion.
        """
        self._started_s = t_s
        self._found_at = found_at_m
        self._is_standing = standing
        # that of a given target stays None: it may stand
        self._recent_positions = deque() if known and self._recent_positions is not None else None
        self._velocity_converged = found_at_m is None
        self._fixes = 0
        self.has_crossed = False

    def add_fix(self) -> None:
        """Record a fix."""
        self._fixes += 1

    def is_reportable(self, ekf: StationEkf, *, recognised: bool = False) -> bool:
        """Return whether the estimate may be reported: it had a fix, and its velocity has converged and is not zero.

        That a found target has moved away is not sufficient: so does the estimate of what stands at an uncertain range.
        Nor is the motion of what crosses on the ground, unless it is ``recognised`` as an aircraft.
        """
        if self._is_standing:
            if not _is_moving(ekf, _MOVING_GATE, _LEAST_SPEED_M_S):
                return False
            self._is_standing = False
        if not self._velocity_converged:
            where = ekf.layout.velocity
            sigma = float(np.sqrt(np.linalg.eigvalsh(ekf.covariance[where, where]).max()))
            settled = self._fixes > 0 and sigma < self._config.settled_velocity_sigma_m_s
            moving = settled and _is_moving(ekf, _FLYING_GATE, 0.0)
            crosses = moving and not recognised and _crosses_on_ground(ekf)
            self.has_crossed |= crosses
            self._velocity_converged = moving and not crosses
        return self._velocity_converged

    def is_false_track(self, t_s: float, ekf: StationEkf, *, recognised: bool = False) -> bool:
        """Return whether a found target was not confirmed in the configured time, or is stationary since.

        One that is ``recognised`` as an aircraft may stand.
        """
        c = self._config
        if self._found_at is None:
            if not self._is_stationary(t_s, ekf):
                return False
            if recognised:
                self._found_at, self._recent_positions = ekf.state[ekf.layout.position].copy(), None
                self._is_standing = True
            return not recognised
        if self._fixes < c.proof_fixes and t_s - self._started_s > c.proof_s:
            return True
        where = ekf.layout.position
        moved = ekf.state[where] - self._found_at
        significant = float(moved @ np.linalg.solve(ekf.covariance[where, where], moved)) > _MOVED_GATE
        if significant and float(np.linalg.norm(moved)) > c.false_target_m and self._fixes >= c.proof_fixes:
            self._found_at, self._is_standing = None, False
            self._recent_positions = deque()
            return False
        return t_s - self._started_s > c.false_target_s and not recognised

    def is_overdue(self, t_s: float, *, recognised: bool = False) -> bool:
        """Return whether the confirmation time of a found target has passed without enough fixes."""
        c = self._config
        if self._found_at is None or (recognised and self._fixes >= c.proof_fixes):
            return False
        return t_s - self._started_s > (c.proof_s if self._fixes < c.proof_fixes else c.false_target_s)

    def _is_stationary(self, t_s: float, ekf: StationEkf) -> bool:
        """Return whether a confirmed track is stationary; never true for a given target.

        A false track may wander between ground features, so that the test uses the distance over the whole time.
        """
        if self._recent_positions is None:
            return False
        c, passed, here_m = self._config, self._recent_positions, ekf.state[ekf.layout.position]
        while passed and passed[0][0] < t_s - c.standing_s - _POSITION_EVERY_S:
            passed.popleft()
        if not passed or t_s >= passed[-1][0] + _POSITION_EVERY_S:
            passed.append((t_s, here_m.copy()))
        then_s, there_m = passed[0]
        return t_s - then_s >= c.standing_s and float(np.linalg.norm(here_m - there_m)) < c.standing_m


def _is_moving(ekf: StationEkf, gate: float, least_m_s: float) -> bool:
    """Return whether the velocity differs from zero by more than a squared number of sigmas, and is not less."""
    where = ekf.layout.velocity
    v_m_s = ekf.state[where]
    significant = float(v_m_s @ np.linalg.solve(ekf.covariance[where, where], v_m_s)) > gate
    return significant and float(np.linalg.norm(v_m_s)) >= least_m_s


def _crosses_on_ground(ekf: StationEkf) -> bool:
    """Return whether a target may be on the ground, and moves more across the runway (x) than along it (y)."""
    position, velocity = ekf.layout.position, ekf.layout.velocity
    height_m = ekf.state[position][2]
    sigma_m = sigma_of(ekf.covariance[position, position][2, 2], "height of the target")
    across_m_s, along_m_s, _ = np.abs(ekf.state[velocity])
    return bool(height_m - _HEIGHT_SIGMAS * sigma_m <= _ON_GROUND_M and across_m_s > along_m_s)
