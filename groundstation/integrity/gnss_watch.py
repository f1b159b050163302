"""Disagreement of the aircraft's own GNSS position with the track: jumps, drift (spoofing too), and freezing.

Two χ² statistics with 3 degrees of freedom are formed with each new position, of its difference r to the track:

- level: r against P + R + a + σ_τ² v vᵀ, with P of the track, R of the receiver, a of the antenna's place and σ_τ
  the unknown delay at velocity v. It sees whatever has grown large, however slowly.
- change: r less its mean over 1 to 4 s ago. What lasts for minutes in either error cancels, so that jumps are seen that
  the receiver's own sigma would hide.

A receiver's errors and the track's are correlated in time, so averaging them over more positions would pretend an
accuracy that is not there: P enters the change with both of its times as if they were independent, which is never too
little while the errors of nearby times are alike. The limit for one test is the chance of a false call in an approach
divided by the number of tests in it; by Boole's inequality that chance then holds whatever the correlation. Two
positions in a row must be beyond the limit, so one damaged message calls nothing.

The track must not have been fed with the same receiver: where a reference is fused, the two agree by construction.
"""

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.integrity.own_position import OwnPosition, ReceiverErrors
from groundstation.messages import Kinematics

# an approach of a minute at ten positions a second, with both statistics
TESTS_PER_APPROACH = 1200
# ages of the positions whose mean difference a new one is compared with, and how many it takes
_REFERENCE_S, _FEWEST = (1.0, 4.0), 3
# the track is carried on for at most so long, and kept for so long
_CARRIED_S, _KEPT_S = 0.5, 6.0
# repeated for so long while the track has moved by so much, m and sigmas: frozen
_FROZEN_S, _FROZEN_M, _FROZEN_SIGMAS = 0.7, 3.0, 6.0
# without a position for so long it is silent; positions further apart than this are judged each alone
_SILENT_S, _SPARSE_S = 2.0, 0.4
# a call ends after so long without another
_QUIET_S = 3.0
# a step is called almost certainly if it is larger than the limit by so many sigmas
_SURE_SIGMAS = 3.0


class GnssVerdict(StrEnum):
    """What the comparison says."""

    SILENT = "no position"
    NO_TRACK = "no track to compare with"
    AGREES = "agrees"
    JUMP = "jump"
    DISAGREES = "disagrees"
    FROZEN = "frozen"

    @property
    def called(self) -> bool:
        """Whether the receiver is not to be trusted."""
        return self in (GnssVerdict.JUMP, GnssVerdict.DISAGREES, GnssVerdict.FROZEN)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GnssAssessment:
    """Verdict at a session time ``t_s`` with its reason in words.

    ``difference_m`` (3,) is position less track, runway frame; ``detectable_m`` the horizontal step, in the direction
    that is seen best, which would be called almost certainly; both None without a comparison.
    """

    t_s: float
    verdict: GnssVerdict
    reason: str
    difference_m: FloatArray | None = None
    detectable_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Difference:
    """Position less track (3,) with the track's velocity (3,), and the covariance (3, 3) of the track there."""

    t_s: float
    offset_m: FloatArray
    velocity_m_s: FloatArray
    track_m2: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Test:
    """A difference (3,) with its covariance (3, 3)."""

    offset_m: FloatArray
    covariance_m2: FloatArray

    @property
    def statistic(self) -> float:
        return float(self.offset_m @ np.linalg.solve(self.covariance_m2, self.offset_m))


class GnssWatch:
    """Compares positions with estimates; both in order of their times, in any order among each other.

    Parameters
    ----------
    errors : what is stated about the receiver.
    false_call_chance : that an approach without a fault has a call, at most.
    """

    def __init__(self, errors: ReceiverErrors | None = None, false_call_chance: float = 5e-4) -> None:
        if not 0.0 < false_call_chance < 1.0:
            raise InputError("GnssWatch: false_call_chance", got=f"{false_call_chance:g}", wanted="between 0 and 1")
        self._errors = ReceiverErrors() if errors is None else errors
        self._limit = float(chi_square_limit(false_call_chance / TESTS_PER_APPROACH, 3))
        self._track: deque[tuple[float, Kinematics]] = deque()
        self._differences: deque[_Difference] = deque()
        self._newest: OwnPosition | None = None
        self._fresh: OwnPosition | None = None
        # since when it repeats, with the track at its likely time
        self._repeats_from: tuple[float, Kinematics] | None = None
        self._beyond = 0
        self._called: GnssAssessment | None = None
        self._called_until_s = -math.inf
        self._last = GnssAssessment(t_s=-math.inf, verdict=GnssVerdict.SILENT, reason="no position has come")

    def add_estimate(self, t_s: float, kinematics: Kinematics) -> None:
        """Take an estimate of the track at session time ``t_s``; one that is not newer is left out."""
        if self._track and t_s <= self._track[-1][0]:
            return
        self._track.append((t_s, kinematics))
        while self._track[0][0] < t_s - _KEPT_S:
            self._track.popleft()

    def forget(self) -> None:
        """Forget the track and its differences: the next estimates are of another track. A call stands."""
        self._track.clear()
        self._differences.clear()
        self._repeats_from = None
        self._beyond = 0

    def take(self, position: OwnPosition) -> GnssAssessment:
        """Take a position and return the verdict; one that is not newer than the last changes nothing."""
        if self._newest is not None and position.t_s <= self._newest.t_s:
            return self._last
        before, self._newest = self._newest, position
        if self._fresh is not None and np.array_equal(position.position_runway_m, self._fresh.position_runway_m):
            self._last = self._repeated(position, self._fresh)
            return self._last
        self._fresh, self._repeats_from = position, None
        sparse = before is None or position.t_s - before.t_s > _SPARSE_S
        self._last = self._compare(position, alone=sparse)
        return self._last

    def assessment(self, now_s: float) -> GnssAssessment:
        """Return the verdict at a session time: the last one, or that no position comes."""
        if self._newest is None or now_s - self._newest.t_s <= _SILENT_S:
            return self._last
        words = f"no position for {now_s - self._newest.t_s:.0f} s"
        return GnssAssessment(t_s=now_s, verdict=GnssVerdict.SILENT, reason=words)

    def _compare(self, position: OwnPosition, *, alone: bool) -> GnssAssessment:
        found = self._difference(position)
        if found is None:
            self._beyond = 0
            return self._no_track(position.t_s, "no estimate of the track at the position's time")
        level, change = self._level(position, found), self._change(position, found)
        jumped = change is not None and change.statistic > self._limit
        beyond = jumped or level.statistic > self._limit
        self._beyond = self._beyond + 1 if beyond else 0
        if self._beyond != 1:
            # a single one may be damaged, and later ones are not compared with it
            self._differences.append(found)
        if self._beyond >= (1 if alone else 2):
            if jumped and change is not None:
                return self._call(position.t_s, GnssVerdict.JUMP, _words("jumped by", change), found)
            return self._call(position.t_s, GnssVerdict.DISAGREES, _words("is off the track by", level), found)
        return self._standing(position.t_s, found, self._detectable(level, change))

    def _difference(self, position: OwnPosition) -> _Difference | None:
        """Return the difference to the track at the position's likely time; None without an estimate near it."""
        t_s = position.t_s - self._errors.mean_delay_s
        estimate = self._estimate_at(t_s)
        if estimate is None:
            return None
        while self._differences and self._differences[0].t_s < position.t_s - _REFERENCE_S[1]:
            self._differences.popleft()
        return _Difference(
            t_s=position.t_s,
            offset_m=position.position_runway_m - estimate.position_runway_m,
            velocity_m_s=estimate.velocity_runway_m_s,
            track_m2=estimate.covariance[:3, :3],
        )

    def _estimate_at(self, t_s: float) -> Kinematics | None:
        """Return the nearest estimate, carried to a time with constant velocity."""
        if not self._track:
            return None
        at_s, nearest = min(self._track, key=lambda entry: abs(entry[0] - t_s))
        dt = t_s - at_s
        if abs(dt) > _CARRIED_S:
            return None
        F = np.eye(6)
        F[:3, 3:] = dt * np.eye(3)
        return Kinematics(
            position_runway_m=nearest.position_runway_m + dt * nearest.velocity_runway_m_s,
            velocity_runway_m_s=nearest.velocity_runway_m_s,
            covariance=F @ nearest.covariance @ F.T,
        )

    def _level(self, position: OwnPosition, found: _Difference) -> _Test:
        own = self._errors
        covariance = found.track_m2 + np.diag(position.sigma_m**2 + own.antenna_sigma_m**2)
        late = own.delay_sigma_s * found.velocity_m_s
        return _Test(offset_m=found.offset_m, covariance_m2=covariance + np.outer(late, late))

    def _change(self, position: OwnPosition, found: _Difference) -> _Test | None:
        """Return the difference less that of 1 to 4 s ago; None while there are too few."""
        then = [d for d in self._differences if d.t_s <= position.t_s - _REFERENCE_S[0]]
        if len(then) < _FEWEST:
            return None
        own, count = self._errors, len(then)
        white = (own.white_share * position.sigma_m) ** 2
        age_s = position.t_s - float(np.mean([d.t_s for d in then]))
        lasting = (position.sigma_m**2 - white) * 2.0 * (1.0 - math.exp(-age_s / own.lasting_s))
        receiver = white * (1.0 + 1.0 / count) + lasting + own.antenna_sigma_m**2
        late = own.delay_sigma_s * (found.velocity_m_s - np.mean([d.velocity_m_s for d in then], axis=0))
        track = found.track_m2 + np.mean([d.track_m2 for d in then], axis=0)
        return _Test(
            offset_m=found.offset_m - np.mean([d.offset_m for d in then], axis=0),
            covariance_m2=track + np.diag(receiver) + np.outer(late, late),
        )

    def _detectable(self, level: _Test, change: _Test | None) -> float:
        tests = (level,) if change is None else (level, change)
        least = min(float(np.linalg.eigvalsh(test.covariance_m2[:2, :2])[0]) for test in tests)
        return (math.sqrt(self._limit) + _SURE_SIGMAS) * math.sqrt(max(least, 0.0))

    def _repeated(self, position: OwnPosition, fresh: OwnPosition) -> GnssAssessment:
        """Judge a position that is the same as the last: a receiver may be slower than its telemetry, not for long."""
        delay_s = self._errors.mean_delay_s
        now = self._estimate_at(position.t_s - delay_s)
        if self._repeats_from is None:
            # kept, for the track is not for as long as a receiver may be frozen
            then = self._estimate_at(fresh.t_s - delay_s)
            if then is not None:
                self._repeats_from = fresh.t_s, then
            elif now is not None:
                self._repeats_from = position.t_s, now
        if now is None or self._repeats_from is None:
            return self._no_track(position.t_s, "no estimate of the track while the position repeats")
        from_s, then = self._repeats_from
        age_s = position.t_s - from_s
        # what is uncertain of a way of less than seconds is the velocity
        sigma = age_s * math.sqrt(max(float(np.trace(now.covariance[3:, 3:])), 0.0))
        distance = float(np.linalg.norm(now.position_runway_m - then.position_runway_m))
        if age_s < _FROZEN_S or distance < _FROZEN_M + _FROZEN_SIGMAS * sigma:
            return self._standing(position.t_s, None, None)
        words = f"GNSS position repeated for {position.t_s - fresh.t_s:.1f} s while the track moved {distance:.0f} m"
        return self._call(position.t_s, GnssVerdict.FROZEN, words, None)

    def _no_track(self, t_s: float, reason: str) -> GnssAssessment:
        """Return the call that still stands, or that there is nothing to compare with."""
        if self._called is not None and t_s < self._called_until_s:
            return self._called
        return GnssAssessment(t_s=t_s, verdict=GnssVerdict.NO_TRACK, reason=reason)

    def _call(self, t_s: float, verdict: GnssVerdict, reason: str, found: _Difference | None) -> GnssAssessment:
        offset = None if found is None else found.offset_m
        self._called = GnssAssessment(t_s=t_s, verdict=verdict, reason=reason, difference_m=offset)
        self._called_until_s = t_s + _QUIET_S
        return self._called

    def _standing(self, t_s: float, found: _Difference | None, detectable_m: float | None) -> GnssAssessment:
        """Return the call that still stands, or that the positions agree."""
        if self._called is not None and t_s < self._called_until_s:
            return self._called
        self._called = None
        words = "" if detectable_m is None else f"; a step of {detectable_m:.1f} m would be called"
        return GnssAssessment(
            t_s=t_s,
            verdict=GnssVerdict.AGREES,
            reason=f"GNSS agrees with the track{words}",
            difference_m=None if found is None else found.offset_m,
            detectable_m=detectable_m,
        )


def _words(what: str, test: _Test) -> str:
    x, y, z = test.offset_m.tolist()
    size = float(np.linalg.norm(test.offset_m))
    return f"GNSS position {what} {size:.1f} m ({x:+.1f}, {y:+.1f}, {z:+.1f} m), {math.sqrt(test.statistic):.1f} sigma"
