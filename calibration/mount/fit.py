"""Solving a mount: a robust fit, then one without outliers; unobservable parameters are held and reported."""

from dataclasses import dataclass

import numpy as np

from calibration.information import inverse, well_conditioned
from calibration.mount.covariance import (
    BASE,
    BORESIGHT,
    considered,
    information,
    undetermined,
    whitened,
)
from calibration.mount.problem import MountProblem
from calibration.robust_fit import (
    OUTLIER_SIGMA,
    FitProblem,
    Loss,
    fit_reweighted,
    minimise,
    noise_factor,
    pixel_linearisation,
    whitened_length,
    whitening_of,
)
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError

_ROBUST_ROUNDS = 4
_FINAL_ROUNDS = 3
_LEAST_KEPT_SHARE = 0.6
# every fifth standstill is held out for evaluation
_HELD_OUT_EACH = 5
_LEAST_STANDSTILLS = 4


class MountFitError(GroundstationError):
    """The sightings do not determine how the camera sits on its head, or do not fit at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectedSighting:
    """A sighting that was left out: its origin, and the reason."""

    label: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutStandstills:
    """Standstills that the fit does not use.

    ``rms_px`` of their n sightings, per axis; ``noise_px`` by pixel and encoder noise alone; ``expected_px``
    with the uncertainty of the fit; ``residual_px`` (n, 2).
    """

    rms_px: float
    noise_px: float
    expected_px: float
    residual_px: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountFit:
    """The solution.

    Attributes
    ----------
    problem, change : as solved, the free parameters only; ``covariance`` (p, p) raised by the noise factor, rotations
        as small angles about the solution.
    held : parameters that the sightings do not determine, with the sigma they were taken to have.
    joint_names, joint_covariance : of the free ones and behind them the held.
    kept : (n,) which sightings of ``problem`` were used; ``rejected`` the others.
    residual_px : (n, 2).
    noise_factor : rms of the whitened residuals, where above 1.
    """

    problem: MountProblem
    change: FloatArray
    covariance: FloatArray
    held: dict[str, float]
    joint_names: tuple[str, ...]
    joint_covariance: FloatArray
    kept: MaskArray
    rejected: tuple[RejectedSighting, ...]
    residual_px: FloatArray
    noise_factor: float
    held_out: HeldOutStandstills | None

    def sigma(self, name: str) -> float:
        """Return one sigma of a parameter; of a fixed one its assumed sigma."""
        if name in self.problem.names:
            place = self.problem.names.index(name)
            return float(np.sqrt(self.covariance[place, place]))
        return self.held.get(name, 0.0)

    @property
    def rms_px(self) -> float:
        """Root mean square residual per axis of the used sightings, px."""
        return float(np.sqrt(np.mean(self.residual_px[self.kept] ** 2)))


def solve_mount(problem: MountProblem, start: FloatArray, *, hold: bool = True) -> MountFit:
    """Find the parameters from a start (p,); raises `MountFitError` where the sightings cannot.

    ``hold`` fixes what the sightings hardly determine at its prior value; without it, all are found with their priors.
    """
    change, kept = _robust(problem, start)
    held = undetermined(problem, change, kept) if hold else {}
    if missing := [name for name in (*BORESIGHT, *BASE) if held.get(name) == np.inf]:
        wanted = "known marks or directions far apart in pan, and some 20 deg or more apart in tilt"
        raise MountFitError(f"station {problem.station.name}: no sighting determines {missing[0]}; wanted {wanted}")
    freed = problem.without(tuple(held))
    at = np.array([change[problem.names.index(name)] for name in freed.names])
    # fixed means at the rig's value, not at that of the fit
    reasons: dict[int, str] = {}
    for _ in range(2):
        at = minimise(kept_problem(freed, kept), at).parameters
        kept, reasons = find_outliers(freed, at)
    at = minimise(kept_problem(freed, kept), at).parameters
    sought = freed.predict(at)
    left = whitened(freed, sought, kept)
    free = max(len(left.residual) - len(at), 1)
    factor = max(1.0, float(np.sqrt(left.chi_square / free)))
    joint = considered(problem, freed, at, kept, held, factor)
    return MountFit(
        problem=freed,
        change=at,
        covariance=joint[: len(at), : len(at)],
        held=held,
        joint_names=(*freed.names, *held),
        joint_covariance=joint,
        kept=kept,
        rejected=tuple(
            RejectedSighting(label=problem.sightings.label[k], reason=text) for k, text in sorted(reasons.items())
        ),
        residual_px=problem.sightings.pixel_px - sought.pixel_px,
        noise_factor=factor,
        held_out=_held_out(freed, at, kept, factor),
    )


def _robust(problem: MountProblem, start: FloatArray) -> tuple[FloatArray, MaskArray]:
    """Return a solution that is not drawn by outliers, and which sightings (n,) fit it."""
    change = fit_reweighted(_RobustMountRounds(problem).weighted_at, start, _ROBUST_ROUNDS)
    kept, _ = find_outliers(problem, change)
    for _ in range(_FINAL_ROUNDS):
        change = minimise(kept_problem(problem, kept), change).parameters
        before, (kept, _) = kept, find_outliers(problem, change)
        if np.array_equal(before, kept):
            break
    if float(kept.mean()) < _LEAST_KEPT_SHARE:
        got = f"{int((~kept).sum())} of {len(kept)} sightings that do not fit the others"
        wanted = (
            "marks that stand still, each with one name, and angles in degrees with the signs of docs/conventions.md"
        )
        raise MountFitError(f"station {problem.station.name}: got {got}; wanted {wanted}")
    return change, kept


@dataclass(slots=True, eq=False)
class _RobustMountRounds:
    """Rounds of the robust fit: no sighting is left out, each is as uncertain as pixel and readings are together."""

    problem: MountProblem
    _round: int = 0
    _noise_factor: float = np.inf

    def weighted_at(self, change: FloatArray) -> FitProblem | None:
        """Return the problem with the noise as it is at a change (p,); None once it is as assumed."""
        if self._round > 1 and self._noise_factor == 1.0:
            return None
        problem, seen_px = self.problem, self.problem.sightings.pixel_px
        predicted = problem.predict(change)
        covariance = problem.covariance_px2(predicted.by_angle)
        length = whitened_length(predicted.pixel_px - seen_px, covariance)
        self._noise_factor = noise_factor(length[predicted.usable])
        self._round += 1
        whitening = whitening_of(covariance) / self._noise_factor
        everything = np.ones(len(seen_px), dtype=np.bool_)
        return FitProblem(
            evaluate=lambda at: pixel_linearisation(problem.predict(at), seen_px, whitening, everything),
            prior_sigma=problem.prior_sigma,
            step_scale=problem.step_scale,
            loss=Loss.SOFT_L1,
        )


def kept_problem(problem: MountProblem, kept: MaskArray) -> FitProblem:
    """Return the fit of the kept sightings (n,), with each standstill's common errors."""
    return FitProblem(
        evaluate=lambda at: whitened(problem, problem.predict(at), kept),
        prior_sigma=problem.prior_sigma,
        step_scale=problem.step_scale,
    )


def find_outliers(problem: MountProblem, change: FloatArray) -> tuple[MaskArray, dict[int, str]]:
    """Return which sightings fit a solution, and why the others do not."""
    sought, seen = problem.predict(change), problem.sightings
    off = sought.pixel_px - seen.pixel_px
    length = whitened_length(off, problem.covariance_px2(sought.by_angle))
    gross = (length > OUTLIER_SIGMA * noise_factor(length)) | ~sought.usable
    reasons = {int(k): f"{np.hypot(*off[k]):.1f} px off, {length[k]:.0f} sigma" for k in np.flatnonzero(gross)}
    alone = np.zeros(len(seen))
    for number in np.unique(seen.pointing):
        own = np.flatnonzero((seen.pointing == number) & ~gross)
        if len(own) >= 3:
            # degrees of freedom after two common angles of one standstill
            common = sought.by_angle[own].reshape(-1, 2)
            middle = np.median(off[own], axis=0)
            shift = np.linalg.lstsq(common, np.tile(middle, len(own)), rcond=None)[0]
            alone[own] = np.linalg.norm(off[own] - (common @ shift).reshape(-1, 2), axis=1) / seen.sigma_px[own]
    several = alone > 0
    if several.any():
        limit = OUTLIER_SIGMA * noise_factor(alone[several])
        for k in np.flatnonzero(alone > limit):
            reasons[int(k)] = f"{alone[k]:.0f} sigma off the other marks of its picture"
    kept = np.ones(len(seen), dtype=np.bool_)
    kept[list(reasons)] = False
    return kept, reasons


def _held_out(problem: MountProblem, change: FloatArray, kept: MaskArray, factor: float) -> HeldOutStandstills | None:
    """Fit without every fifth standstill and evaluate on these; None where too few are left for a fit."""
    seen = problem.sightings
    stands = np.unique(problem.stand[kept])
    apart = np.isin(problem.stand, stands[_HELD_OUT_EACH // 2 :: _HELD_OUT_EACH]) & kept
    rest = kept & ~apart
    if not apart.any() or len(stands) < 2 * _HELD_OUT_EACH or not set(seen.mark[apart]) <= set(seen.mark[rest]):
        return None
    at = minimise(kept_problem(problem, rest), change).parameters
    sought = problem.predict(at)
    known = information(problem, at, rest)
    with np.errstate(divide="ignore"):
        known = known + np.diag(1.0 / problem.prior_sigma**2)
    if not well_conditioned(known):
        return None
    noise = problem.covariance_px2(sought.by_angle)[apart]
    jacobian = sought.jacobian[apart]
    expected = noise + jacobian @ inverse(known) @ np.swapaxes(jacobian, 1, 2)
    residual = (seen.pixel_px - sought.pixel_px)[apart]
    return HeldOutStandstills(
        rms_px=float(np.sqrt(np.mean(residual**2))),
        noise_px=float(np.sqrt(np.mean(np.einsum("nii->n", noise)) / 2.0)),
        expected_px=factor * float(np.sqrt(np.mean(np.einsum("nii->n", expected)) / 2.0)),
        residual_px=residual,
    )


def require_enough(problem: MountProblem) -> None:
    """Raise `MountFitError` where the sightings are clearly insufficient, with what is missing."""
    seen, where = problem.sightings, f"station {problem.station.name}"
    stands = len(np.unique(problem.stand))
    if stands < _LEAST_STANDSTILLS:
        got = f"{len(seen)} sighting{'s' * (len(seen) != 1)} at {stands} pair{'s' * (stands != 1)} of angles"
        wanted = f"at least {_LEAST_STANDSTILLS}, better 25 or more, from all over the PTU's range"
        raise MountFitError(f"{where}: got {got}; wanted {wanted}")
    spread = np.degrees(np.ptp(seen.reading_rad, axis=0))
    for axis, name in enumerate(("pan", "tilt")):
        if spread[axis] < 0.1:
            got = f"every sighting at the same {name}, within {spread[axis]:.3f} deg"
            raise MountFitError(f"{where}: got {got}; wanted a grid: {name} stepped through the picture too")
    counts = np.bincount(seen.mark, minlength=len(problem.marks))
    kinds = [mark.kind for mark in problem.marks]
    if not any(k.known or k.value.startswith("board") for k in kinds) and counts.max() < 2:
        wanted = "a mark seen at several pairs of angles, or the marks' places (--landmarks)"
        raise MountFitError(f"{where}: got no mark of unknown place that is seen twice; wanted {wanted}")
