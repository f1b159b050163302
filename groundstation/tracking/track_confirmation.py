"""Track confirmation: the evidence that a target found by searching is a flying aircraft.

A found target must have a configured number of fixes within a configured time, and then move away from where it was
found; otherwise it is a false track. A confirmed track that stands still for long is dropped as well: a stopped
aircraft needs no guidance, and a detector that has lost the aircraft tends to stay on a ground feature. A track with a
given initial state needs no confirmation.
"""

from collections import deque

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.station_ekf import StationEkf

# squared distance from the place of detection, five sigmas
_MOVED_GATE = 25.0
_POSITION_EVERY_S = 0.25


class TrackConfirmation:
    """Fixes, velocity convergence and motion of one track since its start."""

    def __init__(self, config: EstimationConfig) -> None:
        self._config = config
        self._started_s = 0.0
        self._fixes = 0
        self._velocity_converged = False
        self._found_at: FloatArray | None = None
        # recent times and positions of a confirmed track
        self._recent_positions: deque[tuple[float, FloatArray]] | None = None

    @property
    def has_fix(self) -> bool:
        """Whether the track has had a fix."""
        return self._fixes > 0

    def start(self, t_s: float, found_at_m: FloatArray | None, *, known: bool = False) -> None:
        """Start a track at ``t_s``; ``found_at_m`` (3,) is the position found by searching, None for a given target.

        ``known``: of a target that was confirmed before, which may still come to stand.
        """
        self._started_s = t_s
        self._found_at = found_at_m
        # that of a given target stays None: it may stand
        self._recent_positions = deque() if known and self._recent_positions is not None else None
        self._velocity_converged = found_at_m is None
        self._fixes = 0

    def add_fix(self) -> None:
        """Record a fix."""
        self._fixes += 1

    def is_reportable(self, ekf: StationEkf) -> bool:
        """Return whether the estimate may be reported: the track has had a fix and its velocity has converged."""
        if not self._velocity_converged:
            where = ekf.layout.velocity
            sigma = float(np.sqrt(np.linalg.eigvalsh(ekf.covariance[where, where]).max()))
            self._velocity_converged = self._fixes > 0 and sigma < self._config.settled_velocity_sigma_m_s
        return self._velocity_converged

    def is_false_track(self, t_s: float, ekf: StationEkf) -> bool:
        """Return whether a found target was not confirmed in the configured time, or is stationary since."""
        c = self._config
        if self._found_at is None:
            return self._is_stationary(t_s, ekf)
        if self._fixes < c.proof_fixes and t_s - self._started_s > c.proof_s:
            return True
        where = ekf.layout.position
        moved = ekf.state[where] - self._found_at
        significant = float(moved @ np.linalg.solve(ekf.covariance[where, where], moved)) > _MOVED_GATE
        if significant and float(np.linalg.norm(moved)) > c.false_target_m and self._fixes >= c.proof_fixes:
            self._found_at = None
            self._recent_positions = deque()
            return False
        return t_s - self._started_s > c.false_target_s

    def is_overdue(self, t_s: float) -> bool:
        """Return whether the confirmation time of a found target has passed without enough fixes."""
        c = self._config
        if self._found_at is None:
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
