"""Confirmation of a target by one camera: one target among the candidates of successive whole frames.

`candidate_finder` detects candidates in each frame. A tentative target is confirmed when it appears in most of several
successive frames, moves smoothly, keeps its size and has more contrast than all others; never from a single frame.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from groundstation.arrays import ImageArray
from groundstation.box import Box, overlap
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder

_GATE_PX, _GATE_SIZES = 14.0, 0.7  # how far a candidate may be from where its forerunner leads
_SIZE_RATIO = 2.5
_VELOCITY_GAIN = 0.4
_FORGET_AFTER = 3  # frames without a candidate
_MAX_TENTATIVE = 12
_MOVING_WEIGHT = 1.3
_KNOWN_WEIGHT, _KNOWN_RATIO = 2.0, 2.0
_LEAST_SIZE_PX = 4.0
_ENOUGH = 60.0  # sigmas: beyond it more contrast has no effect


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfirmationConfig:
    """Tuning of the confirmation.

    Attributes
    ----------
    frames : minimum number of frames with the target ...
    span_s : ... over at least this time.
    seen_share : minimum share of these in the frames since the first one.
    least_score : minimum score of a candidate, in sigmas of its surroundings.
    clear_lead : minimum ratio of the target's weight to that of any other ...
    undecided_s : ... until this time has passed; then the best one is confirmed.
    """

    frames: int = 4
    span_s: float = 0.1
    seen_share: float = 0.7
    least_score: float = 5.0
    clear_lead: float = 1.4
    undecided_s: float = 1.0

    def __post_init__(self) -> None:
        if self.frames < 2 or self.span_s < 0 or not 0 < self.seen_share <= 1 or self.clear_lead < 1:
            raise ValueError("frames ≥ 2, span_s ≥ 0, seen_share in (0, 1] and clear_lead ≥ 1 are needed")


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfirmedTarget:
    """A confirmed target: its candidate in the newest frame, and its velocity (u, v) in px/s."""

    candidate: Candidate
    velocity_px_s: tuple[float, float]


@dataclass(slots=True, kw_only=True)
class _TentativeTarget:
    """A tentative target: linked candidates of several frames."""

    newest: Candidate
    first_s: float
    newest_s: float
    velocity_px_s: tuple[float, float] = (0.0, 0.0)
    seen: int = 1
    frames: int = 1
    missed: int = 0
    scores: list[float] = field(default_factory=list)

    def place(self, t_s: float) -> tuple[float, float]:
        dt = t_s - self.newest_s
        return self.newest.u_px + self.velocity_px_s[0] * dt, self.newest.v_px + self.velocity_px_s[1] * dt

    def weight(self) -> float:
        """Return the mean score, less for the frames that did not show it."""
        return sum(self.scores) / self.frames


class TargetConfirmation:
    """Confirms one target in the successive frames of one camera."""

    def __init__(
        self, config: ConfirmationConfig, acquisition: AcquisitionConfig, image_size_px: tuple[int, int]
    ) -> None:
        self._config = config
        self._finder = CandidateFinder(acquisition, image_size_px)
        self._tentative_targets: list[_TentativeTarget] = []
        self._newest_s: float | None = None

    @property
    def promising(self) -> bool:
        """Whether a tentative target has been detected more than once."""
        return any(h.seen >= 2 for h in self._tentative_targets)

    def reset(self) -> None:
        """Discard all tentative targets."""
        self._finder.reset()
        self._tentative_targets.clear()
        self._newest_s = None

    def update(self, image: ImageArray, t_s: float, known_size_px: float | None = None) -> ConfirmedTarget | None:
        """Process one frame, (h, w, 3) BGR; return the target once it is confirmed.

        ``known_size_px`` is the longer side of a lost target: candidates of that size get a higher weight.
        """
        if self._newest_s is not None and t_s <= self._newest_s:
            self.reset()
        return self.confirm(self._finder.find(image, t_s), t_s, known_size_px)

    def confirm(
        self, found: Sequence[Candidate], t_s: float, known_size_px: float | None = None
    ) -> ConfirmedTarget | None:
        """Process the candidates of one frame as `update` does those that it finds."""
        self._newest_s = t_s
        self._follow([c for c in found if c.score >= self._config.least_score], t_s, known_size_px)
        return self._decide(t_s)

    def drop(self, box: Box[float]) -> None:
        """Discard the tentative targets at ``box``, after a false confirmation."""
        self._tentative_targets = [h for h in self._tentative_targets if not overlap(h.newest.box, box)]

    def _follow(self, candidates: list[Candidate], t_s: float, known_size_px: float | None) -> None:
        """Associate candidates with the tentative targets; the others start new ones."""
        rest = list(candidates)
        for tentative in sorted(self._tentative_targets, key=lambda h: (-h.seen, -h.weight())):
            tentative.frames += 1
            best = _nearest(tentative, rest, t_s)
            if best is None:
                tentative.missed += 1
                continue
            rest.remove(best)
            _advance(tentative, best, t_s, _worth(best, known_size_px))
        self._tentative_targets = [h for h in self._tentative_targets if h.missed <= _FORGET_AFTER]
        for c in rest[: max(0, _MAX_TENTATIVE - len(self._tentative_targets))]:
            self._tentative_targets.append(
                _TentativeTarget(newest=c, first_s=t_s, newest_s=t_s, scores=[_worth(c, known_size_px)])
            )

    def _decide(self, t_s: float) -> ConfirmedTarget | None:
        """Return the best tentative target if it is confirmed and has no rival."""
        c = self._config
        ranked = sorted(self._tentative_targets, key=lambda h: -h.weight() * min(h.seen, c.frames))
        if not ranked:
            return None
        best = ranked[0]
        if best.newest_s < t_s or best.seen < c.frames or t_s - best.first_s < c.span_s:
            return None
        if best.seen < c.seen_share * best.frames:
            return None
        # several readings of one object do not compete
        rivals = [h for h in ranked[1:] if not overlap(h.newest.box, best.newest.box) and h.newest_s == t_s]
        lead = best.weight() / max((h.weight() for h in rivals), default=1e-9)
        if lead < c.clear_lead and t_s - best.first_s < c.undecided_s:
            return None
        return ConfirmedTarget(candidate=best.newest, velocity_px_s=best.velocity_px_s)


def _worth(c: Candidate, known_size_px: float | None) -> float:
    weight = _MOVING_WEIGHT if c.moving else 1.0
    if known_size_px is not None:
        small, large = sorted((max(c.box.length, _LEAST_SIZE_PX), max(known_size_px, _LEAST_SIZE_PX)))
        weight *= _KNOWN_WEIGHT if large < _KNOWN_RATIO * small else 1.0
    return weight * min(c.score, _ENOUGH)


def _nearest(tentative: _TentativeTarget, candidates: list[Candidate], t_s: float) -> Candidate | None:
    """Return the candidate that continues ``tentative`` best."""
    u, v = tentative.place(t_s)
    old = max(tentative.newest.box.length, 3.0)
    reach = (_GATE_PX + _GATE_SIZES * old) * (1 + tentative.missed)
    best, least = None, math.inf
    for c in candidates:
        ratio = max(c.box.length, 3.0) / old
        if not 1.0 / _SIZE_RATIO <= ratio <= _SIZE_RATIO:
            continue
        distance = math.hypot(c.u_px - u, c.v_px - v) + 5.0 * abs(math.log(ratio))
        if distance <= reach and distance < least:
            best, least = c, distance
    return best


def _advance(tentative: _TentativeTarget, c: Candidate, t_s: float, worth: float) -> None:
    """Take a candidate as the newest sight of ``tentative``."""
    dt = t_s - tentative.newest_s
    u, v = tentative.place(t_s)
    gain = 1.0 if tentative.seen == 1 else _VELOCITY_GAIN
    du, dv = tentative.velocity_px_s
    tentative.velocity_px_s = (du + gain * (c.u_px - u) / dt, dv + gain * (c.v_px - v) / dt)
    tentative.newest, tentative.newest_s = c, t_s
    tentative.seen += 1
    tentative.missed = 0
    tentative.scores.append(worth)
