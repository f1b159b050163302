"""Outlier rejection: single sightings against the rest of their standstill, landmarks against the other landmarks.

A far landmark with a wrong coordinate can pull a free position so that others appear wrong, and no convex loss helps.
Each landmark, and each station's sightings of it, is left out in turn; the one without which the rest fits is removed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibration.landmarks.problem import LandmarkProblem
from calibration.landmarks.solver import linearised, solve_kept, white_residuals
from calibration.robust_fit import OUTLIER_SIGMA, noise_factor
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError

_LEAST_GROUP = 3
_MOST_TRIED = 40
# chi-square by which another explanation must be worse to be none, and by which leaving out more must be better
_CLEARLY = 15.0


class LandmarkFitError(GroundstationError):
    """The sightings do not determine the requested parameters, or contradict each other."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rejection:
    """Observations (n,) to leave out, and landmarks with their errors in sigmas; empty where all fit."""

    omitted: MaskArray
    landmarks: dict[str, float]

    @property
    def nothing(self) -> bool:
        """Whether everything fits."""
        return not self.omitted.any()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ExclusionTrial:
    """One trial: the omission, its names, the fit of the rest, and whether no gross error remains."""

    omitted: MaskArray
    landmark: int
    whole: bool
    excess: float
    clean: bool


def single_sightings(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray) -> MaskArray:
    """Return observations (n,) off the median of the same station's other observations of the same landmark.

    This holds whatever the pose: an error of one picture, not of the landmark.
    """
    white = white_residuals(problem, unknowns)
    off = kept & ~np.isfinite(white).all(axis=1)
    for group in _groups(problem):
        own = group & kept & ~off
        if own.sum() >= _LEAST_GROUP:
            length = np.linalg.norm(white[own] - np.median(white[own], axis=0), axis=1)
            off[np.flatnonzero(own)[length > OUTLIER_SIGMA * noise_factor(length)]] = True
    return off


def find_outlier(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray) -> Rejection:
    """Return which landmark, or which station's sightings of one, the rest contradicts.

    Raises `LandmarkFitError` where leaving out another one would explain it as well.
    """
    nothing = Rejection(omitted=np.zeros(len(kept), dtype=np.bool_), landmarks={})
    if not _gross(problem, unknowns, kept):
        return nothing
    tried = [_try(problem, unknowns, kept, k, omitted, whole) for k, omitted, whole in _parts(problem, unknowns, kept)]
    if not tried:
        raise LandmarkFitError(
            "landmarks: got two that contradict each other; wanted three or more to tell which is wrong"
        )
    best = min(tried, key=lambda t: t.excess)
    # the smaller part where it does as well
    best = min(
        (t for t in tried if t.landmark == best.landmark and t.excess <= best.excess + _CLEARLY),
        key=lambda t: (int(t.omitted.sum()), t.excess),
    )
    others = {t.landmark for t in tried if t.excess <= best.excess + _CLEARLY} - {best.landmark}
    if best.clean and others:
        names = ", ".join(problem.landmarks[k].name for k in sorted({best.landmark, *others}))
        got = f"landmarks that contradict each other, one of {names}"
        raise LandmarkFitError(
            f"landmarks: got {got}; wanted right coordinates, and more landmarks to tell which is wrong"
        )
    name = problem.landmarks[best.landmark].name
    return Rejection(omitted=best.omitted, landmarks={name: _off(problem, unknowns, kept, best)} if best.whole else {})


def _groups(problem: LandmarkProblem) -> Iterator[MaskArray]:
    """Yield the observations (n,) of each station, day and landmark."""
    total, start = sum(len(observed) for observed in problem.observations), 0
    for observed in problem.observations:
        for k in np.unique(observed.landmark):
            group = np.zeros(total, dtype=np.bool_)
            group[start : start + len(observed)] = observed.landmark == k
            yield group
        start += len(observed)


def _landmark_numbers(problem: LandmarkProblem) -> FloatArray:
    return np.concatenate([observed.landmark for observed in problem.observations])


def _lengths(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray) -> tuple[FloatArray, FloatArray]:
    """Return lengths in sigmas: of each group's median residual, and of each landmark's shift."""
    white = white_residuals(problem, unknowns)
    groups = [float(np.linalg.norm(np.median(white[g & kept], axis=0))) for g in _groups(problem) if (g & kept).any()]
    change = problem.spread @ unknowns
    shifts = np.zeros(len(problem.landmarks))
    for k, landmark in enumerate(problem.landmarks):
        places = problem.places(f"landmark {landmark.name}")
        if places:
            sigma = np.where(landmark.sigma > 0.0, landmark.sigma, np.inf)
            shifts[k] = float(np.linalg.norm(change[places] / sigma))
    return np.array(groups), shifts


def _gross(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray) -> bool:
    groups, shifts = _lengths(problem, unknowns, kept)
    scale = noise_factor(np.linalg.norm(white_residuals(problem, unknowns)[kept], axis=1))
    # of a landmark's three coordinates one in 6000 exceeds it
    return bool(groups.max(initial=0.0) > OUTLIER_SIGMA * scale or shifts.max(initial=0.0) > OUTLIER_SIGMA)


def _parts(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray) -> Iterator[tuple[int, MaskArray, bool]]:
    """Yield possible omissions: landmark, observations (n,), and whether those are all of the landmark's."""
    numbers = _landmark_numbers(problem)
    present = np.unique(numbers[kept])
    if len(present) < 3:
        return
    _, shifts = _lengths(problem, unknowns, kept)
    for k in sorted(present, key=lambda k: -shifts[k])[:_MOST_TRIED]:
        own = kept & (numbers == k)
        groups = [g & own for g in _groups(problem) if (g & own).any()]
        yield int(k), own, True
        if len(groups) > 1:
            for group in groups:
                yield int(k), group, False


def _try(
    problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, landmark: int, omitted: MaskArray, whole: bool
) -> _ExclusionTrial:
    rest = kept & ~omitted
    solved = solve_kept(problem, unknowns, rest, robust=False)
    left = linearised(problem, solved, rest)
    return _ExclusionTrial(
        omitted=omitted,
        landmark=landmark,
        whole=whole,
        excess=left.chi_square - len(left.residual),
        clean=not _gross(problem, solved, rest),
    )


def _off(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, left: _ExclusionTrial) -> float:
    """Return a landmark's misfit in sigmas of one sighting and of its own coordinates, by the remaining sightings."""
    solved = solve_kept(problem, unknowns, kept & ~left.omitted, robust=False)
    seen = problem.evaluate(solved)
    by_pixel, by_angle = problem.variances
    places = problem.places(f"landmark {problem.landmarks[left.landmark].name}")
    worst = 0.0
    for k in np.flatnonzero(left.omitted & seen.usable):
        noise = by_pixel[k] * np.eye(2) + by_angle[k] * seen.by_angle[k] @ seen.by_angle[k].T
        if places:
            by_place = seen.jacobian[k] @ problem.spread[places].T / problem.landmarks[left.landmark].sigma.clip(1e-9)
            noise = noise + by_place @ by_place.T
        off = seen.pixel_px[k] - problem.pixel_px[k]
        worst = max(worst, float(np.sqrt(off @ np.linalg.solve(noise, off))))
    return worst
