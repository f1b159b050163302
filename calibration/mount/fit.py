"""Solving a mount: a robust fit, then one without outliers; unobservable parameters are held and reported."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from calibration.mount.covariance import (
    BASE,
    BORESIGHT,
    considered,
    information,
    scaled_inverse,
    undetermined,
    well_conditioned,
    whitened,
)
from calibration.mount.problem import MountProblem, PredictedSightings
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError

_ROBUST_ROUNDS = 4
_FINAL_ROUNDS = 3
# soft-L1 bends here, in sigmas; an outlier is what one normal pair in 25 000 exceeds
_BEND_SIGMA = 1.5
_GROSS_SIGMA = 4.5
_MEDIAN_LENGTH = 1.1774
# within one standstill the readings' errors are common: a mark that alone is off stands out from the others'
_LEAST_KEPT_SHARE = 0.6
_SCALES = {"mark": 0.01, "camera_in_head": 0.01, "ptu_position": 0.01, "scale": 1e-4}
_OTHER_SCALE = 1e-3
# every fifth standstill is kept apart to judge by
_HELD_OUT_EACH = 5
_LEAST_STANDSTILLS = 4


class MountFitError(GroundstationError):
    """The sightings do not determine how the camera sits on its head, or do not fit at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rejected:
    """A sighting that was left out: where it comes from, and why."""

    label: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutStandstills:
    """Standstills that the fit did not see.

    ``rms_px`` of their n sightings, per axis; ``noise_px`` what pixel and encoder noise alone make; ``expected_px``
    what they make with the uncertainty of the fit; ``residual_px`` (n, 2).
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
    rejected: tuple[Rejected, ...]
    residual_px: FloatArray
    noise_factor: float
    held_out: HeldOutStandstills | None

    def sigma(self, name: str) -> float:
        """Return one sigma of a parameter; of a held one what it was taken to have."""
        if name in self.problem.names:
            place = self.problem.names.index(name)
            return float(np.sqrt(self.covariance[place, place]))
        return self.held.get(name, 0.0)

    @property
    def rms_px(self) -> float:
        """Root mean square residual per axis of what was used, px."""
        return float(np.sqrt(np.mean(self.residual_px[self.kept] ** 2)))


def solve_mount(problem: MountProblem, start: FloatArray) -> MountFit:
    """Find the parameters from a start (p,); raises `MountFitError` where the sightings cannot."""
    change, kept, reasons = _robust(problem, start)
    held = undetermined(problem, change, kept)
    if missing := [name for name in (*BORESIGHT, *BASE) if held.get(name) == np.inf]:
        wanted = "known marks or directions far apart in pan, and some 20 deg or more apart in tilt"
        raise MountFitError(f"station {problem.station.name}: got nothing that tells {missing[0]}; wanted {wanted}")
    freed = problem.without(tuple(held))
    at = np.array([change[problem.names.index(name)] for name in freed.names])
    # held means: as the rig says, not where the fit had drawn it
    for _ in range(2):
        at = _linear(freed, at, kept)
        kept, reasons = _judge(freed, at)
    at = _linear(freed, at, kept)
    sought = freed.predict(at)
    residual, _ = whitened(freed, sought, kept)
    free = max(len(residual) - len(at), 1)
    factor = max(1.0, float(np.sqrt(residual @ residual / free)))
    joint = considered(problem, freed, at, kept, held, factor)
    return MountFit(
        problem=freed,
        change=at,
        covariance=joint[: len(at), : len(at)],
        held=held,
        joint_names=(*freed.names, *held),
        joint_covariance=joint,
        kept=kept,
        rejected=tuple(Rejected(label=problem.sightings.label[k], reason=text) for k, text in sorted(reasons.items())),
        residual_px=problem.sightings.pixel_px - sought.pixel_px,
        noise_factor=factor,
        held_out=_held_out(freed, at, kept, factor),
    )


def _robust(problem: MountProblem, start: FloatArray) -> tuple[FloatArray, MaskArray, dict[int, str]]:
    """Return a solution that outliers have not drawn, and what fits it."""
    change = start
    n = len(problem.sightings)
    for round_ in range(_ROBUST_ROUNDS):
        sought = problem.predict(change)
        white = _inverse_root(problem.covariance_px2(sought.by_angle))
        length = _lengths(problem, sought, white)
        factor = max(1.0, float(np.median(length[sought.usable])) / _MEDIAN_LENGTH) if sought.usable.any() else 1.0
        change = _least_squares(problem, change, white / factor, np.ones(n, dtype=np.bool_), "soft_l1")
        if round_ and factor == 1.0:
            break
    kept, reasons = _judge(problem, change)
    for _ in range(_FINAL_ROUNDS):
        change = _linear(problem, change, kept)
        before = kept
        kept, reasons = _judge(problem, change)
        if np.array_equal(before, kept):
            break
    share = float(kept.mean())
    if share < _LEAST_KEPT_SHARE:
        got = f"{n - int(kept.sum())} of {n} sightings that do not fit the others"
        wanted = (
            "marks that stand still, each with one name, and angles in degrees with the signs of docs/conventions.md"
        )
        raise MountFitError(f"station {problem.station.name}: got {got}; wanted {wanted}")
    return change, kept, reasons


def _lengths(problem: MountProblem, sought: PredictedSightings, white: FloatArray) -> FloatArray:
    off = sought.pixel_px - problem.sightings.pixel_px
    return np.asarray(np.linalg.norm(np.einsum("nij,nj->ni", white, off), axis=1))


def _inverse_root(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _judge(problem: MountProblem, change: FloatArray) -> tuple[MaskArray, dict[int, str]]:
    """Return which sightings fit a solution, and why the others do not."""
    sought, seen = problem.predict(change), problem.sightings
    off = sought.pixel_px - seen.pixel_px
    length = _lengths(problem, sought, _inverse_root(problem.covariance_px2(sought.by_angle)))
    usual = max(1.0, float(np.median(length)) / _MEDIAN_LENGTH)
    gross = (length > _GROSS_SIGMA * usual) | ~sought.usable
    reasons = {int(k): f"{np.hypot(*off[k]):.1f} px off, {length[k]:.0f} sigma" for k in np.flatnonzero(gross)}
    alone = np.zeros(len(seen))
    for number in np.unique(seen.pointing):
        own = np.flatnonzero((seen.pointing == number) & ~gross)
        if len(own) >= 3:
            # what is left once two common angles have been taken out of one standstill
            common = sought.by_angle[own].reshape(-1, 2)
            middle = np.median(off[own], axis=0)
            shift = np.linalg.lstsq(common, np.tile(middle, len(own)), rcond=None)[0]
            alone[own] = np.linalg.norm(off[own] - (common @ shift).reshape(-1, 2), axis=1) / seen.sigma_px[own]
    several = alone > 0
    if several.any():
        limit = _GROSS_SIGMA * max(1.0, float(np.median(alone[several])) / _MEDIAN_LENGTH)
        for k in np.flatnonzero(alone > limit):
            reasons[int(k)] = f"{alone[k]:.0f} sigma off the other marks of its picture"
    kept = np.ones(len(seen), dtype=np.bool_)
    kept[list(reasons)] = False
    return kept, reasons


def _prior(problem: MountProblem, change: FloatArray) -> tuple[FloatArray, FloatArray]:
    known = np.isfinite(problem.prior_sigma)
    return (change / problem.prior_sigma)[known], np.diag(1.0 / problem.prior_sigma)[known]


def _linear(problem: MountProblem, change: FloatArray, kept: MaskArray) -> FloatArray:
    """Return the solution of what is kept, each standstill's common errors allowed for."""

    def both(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual, jacobian = whitened(problem, problem.predict(x), kept)
        behind, below = _prior(problem, x)
        return np.concatenate([residual, behind]), np.concatenate([jacobian, below])

    return _minimised(problem, change, both, "linear")


def _least_squares(
    problem: MountProblem, change: FloatArray, white: FloatArray, kept: MaskArray, loss: str
) -> FloatArray:
    def both(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        sought = problem.predict(x)
        # a mark behind the camera pulls nowhere
        usable = (kept & sought.usable)[:, None, None]
        off = np.einsum("nij,nj->ni", white * usable, sought.pixel_px - problem.sightings.pixel_px)
        behind, below = _prior(problem, x)
        jacobian = (white @ sought.jacobian).reshape(-1, len(x))
        return np.concatenate([off.ravel(), behind]), np.concatenate([jacobian, below])

    return _minimised(problem, change, both, loss)


def _minimised(problem: MountProblem, change: FloatArray, both: object, loss: str) -> FloatArray:
    if not len(change):
        return change
    memory: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def computed(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = x.tobytes()
        if key not in memory:
            memory.clear()
            memory[key] = both(x)  # type: ignore[operator]
        return memory[key]

    found = least_squares(
        lambda x: computed(x)[0],
        change,
        jac=lambda x: computed(x)[1],
        loss=loss,
        f_scale=_BEND_SIGMA,
        x_scale=np.array([_scale(name) for name in problem.names]),
        max_nfev=60,
    )
    return np.asarray(found.x, dtype=np.float64)


def _scale(name: str) -> float:
    return next((value for part, value in _SCALES.items() if part in name), _OTHER_SCALE)


def _held_out(problem: MountProblem, change: FloatArray, kept: MaskArray, factor: float) -> HeldOutStandstills | None:
    """Fit without every fifth standstill and judge by these; None where too few are left to fit to."""
    seen = problem.sightings
    stands = np.unique(problem.stand[kept])
    apart = np.isin(problem.stand, stands[_HELD_OUT_EACH // 2 :: _HELD_OUT_EACH]) & kept
    rest = kept & ~apart
    if not apart.any() or len(stands) < 2 * _HELD_OUT_EACH or not set(seen.mark[apart]) <= set(seen.mark[rest]):
        return None
    at = _linear(problem, change, rest)
    sought = problem.predict(at)
    known = information(problem, at, rest)
    with np.errstate(divide="ignore"):
        known = known + np.diag(1.0 / problem.prior_sigma**2)
    if not well_conditioned(known):
        return None
    noise = problem.covariance_px2(sought.by_angle)[apart]
    jacobian = sought.jacobian[apart]
    expected = noise + jacobian @ scaled_inverse(known) @ np.swapaxes(jacobian, 1, 2)
    residual = (seen.pixel_px - sought.pixel_px)[apart]
    return HeldOutStandstills(
        rms_px=float(np.sqrt(np.mean(residual**2))),
        noise_px=float(np.sqrt(np.mean(np.einsum("nii->n", noise)) / 2.0)),
        expected_px=factor * float(np.sqrt(np.mean(np.einsum("nii->n", expected)) / 2.0)),
        residual_px=residual,
    )


def require_enough(problem: MountProblem) -> None:
    """Raise `MountFitError` where it is plain that the sightings cannot do it, with what is missing."""
    seen, where = problem.sightings, f"station {problem.station.name}"
    stands = len(np.unique(problem.stand))
    if stands < _LEAST_STANDSTILLS:
        got = f"{len(seen)} sightings at {stands} pair{'s' * (stands != 1)} of angles"
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
