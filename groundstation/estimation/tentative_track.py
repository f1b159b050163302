"""A tentative track of the track initiation: a constant-velocity filter and what is known of its fixes; its target."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import InitiationConfig
from groundstation.messages import InitialPixel, Kinematics

# log odds beyond which a single fix has no more weight
_MOST_ODDS = 12.0
# median of chi-square with 6 degrees of freedom: two tracks that are no further apart are one
_SAME_STATE = 5.35
# of a step's normalised square, and log odds beyond which a track is no surer to be an aircraft
_EXPECTED_SQUARE, _SURE_ODDS = 3.0, 3.0
# pixels that are kept: five seconds of three cameras at 30 Hz
_MOST_PIXELS = 450


def motion_over(dt_s: float, acceleration_psd_m2_s3: float) -> tuple[FloatArray, FloatArray]:
    """Return F and Q, (6, 6) each, of a constant velocity with white acceleration over ``dt_s`` seconds."""
    F = np.eye(6)
    F[:3, 3:] = dt_s * np.eye(3)
    step = np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
    return F, np.kron(step, np.eye(3)) * acceleration_psd_m2_s3


@dataclass(slots=True, kw_only=True, eq=False)
class TentativeTrack:
    """A tentative track.

    Attributes
    ----------
    t_s, born_s : time of its state, and of its first fix.
    x, P : position and velocity (6,) in the runway frame, m and m/s, with covariance (6, 6).
    newest_covariance_m2 : (3, 3) of the newest fix.
    hits, misses : fixes, and epochs without one since the newest.
    score, squares : sums of the fixes' scores and of their normalised squares.
    labelled : whether all of its fixes are labels.
    recent_odds : log odds of aircraft of the last fixes, as the learned channel weighs them.
    pixels : those of the fixes, the newest ones.
    """

    t_s: float
    born_s: float
    x: FloatArray
    P: FloatArray
    newest_covariance_m2: FloatArray
    hits: int = 1
    misses: int = 0
    score: float = 0.0
    squares: float = 0.0
    labelled: bool = False
    recent_odds: list[float] = field(default_factory=list)
    pixels: deque[InitialPixel] = field(default_factory=lambda: deque(maxlen=_MOST_PIXELS))

    def add_odds(self, odds: float | None, most: int) -> None:
        """Append the log odds of a fix, limited, to the last ``most`` ones."""
        if odds is not None:
            self.recent_odds = [*self.recent_odds, min(max(odds, -_MOST_ODDS), _MOST_ODDS)][-most:]

    @property
    def mean_odds(self) -> float | None:
        """Mean log odds of aircraft of the last fixes, None where the learned channel has not weighed them."""
        return sum(self.recent_odds) / len(self.recent_odds) if self.recent_odds else None

    def distance(self, position_m: FloatArray, covariance_m2: FloatArray) -> float:
        """Return the normalised square of the distance to a position (3,) with covariance (3, 3)."""
        residual = position_m - self.x[:3]
        return float(residual @ np.linalg.solve(self.P[:3, :3] + covariance_m2, residual))

    def update(self, position_m: FloatArray, covariance_m2: FloatArray, score: float, *, labelled: bool) -> None:
        """Update the state with a fix (3,) and its covariance (3, 3)."""
        S = self.P[:3, :3] + covariance_m2
        K = np.linalg.solve(S, self.P[:3, :]).T
        self.x = self.x + K @ (position_m - self.x[:3])
        self.P = self.P - K @ S @ K.T
        self.P = 0.5 * (self.P + self.P.T)
        self.newest_covariance_m2 = covariance_m2
        self.hits += 1
        self.misses = 0
        self.score += score
        self.labelled = self.labelled and labelled


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InitiatedTarget:
    """A confirmed tentative track: its state, whether it moves, and whether the learned channel recognises it.

    ``odds`` are its mean log odds of aircraft, None where the learned channel has not weighed its candidates; ``age_s``
    is the time since its first fix; ``pixels`` are those of its fixes.
    """

    kinematics: Kinematics
    moving: bool
    recognised: bool
    odds: float | None
    age_s: float
    pixels: tuple[InitialPixel, ...] = ()


def initiated(track: TentativeTrack, config: InitiationConfig, *, moving: bool, recognised: bool) -> InitiatedTarget:
    """Return the target of a confirmed track, at the track's time.

    Errors of candidates are correlated from frame to frame: their mean is no better than one of them, and the
    correlation of position and velocity in the tentative filter is not used.
    """
    P = np.zeros((6, 6))
    P[:3, :3] = track.P[:3, :3] + config.start_share * track.newest_covariance_m2
    P[:3, :3] += np.eye(3) * config.start_position_sigma_m**2
    P[3:, 3:] = config.start_share * track.P[3:, 3:]
    return InitiatedTarget(
        kinematics=Kinematics(
            position_runway_m=track.x[:3].copy(), velocity_runway_m_s=track.x[3:].copy(), covariance=P
        ),
        moving=moving,
        recognised=recognised,
        odds=track.mean_odds,
        age_s=track.t_s - track.born_s,
        pixels=tuple(track.pixels),
    )


def without_copies(tracks: list[TentativeTrack]) -> list[TentativeTrack]:
    """Return tracks without those that a better one has come to the same state as.

    A better one has steps as its filter expects them, or is likelier an aircraft; then it has more fixes.
    """

    def rank(track: TentativeTrack) -> tuple[float, int, float]:
        if track.squares <= _EXPECTED_SQUARE * max(track.hits - 1, 1):
            return -math.inf, -track.hits, track.squares
        return -min(track.mean_odds or 0.0, _SURE_ODDS), -track.hits, track.squares

    kept: list[TentativeTrack] = []
    for track in sorted(tracks, key=rank):
        if track.misses > 0 or not any(_are_one(track, other) for other in kept):
            kept.append(track)
    return kept


def _are_one(a: TentativeTrack, b: TentativeTrack) -> bool:
    if b.misses > 0 or a.t_s != b.t_s:
        return False
    apart = a.x - b.x
    return float(apart @ np.linalg.solve(a.P + b.P, apart)) < _SAME_STATE
