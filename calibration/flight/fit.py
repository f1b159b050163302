"""Solving a flight: robustly, then without what is grossly off, with a covariance that allows for lasting errors."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from calibration.flight.paths import PathPart, PathResiduals, path_parts
from calibration.flight.problem import ANTENNA, FlightProblem, left_jacobian
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError

MIN_OBSERVATIONS = 20
_ROBUST_ROUNDS = 4
_FINAL_ROUNDS = 3
# soft-L1 bends here, in sigmas
_BEND_SIGMA = 1.5
# the length of a two-dimensional normal residual: its median, and what one in 25 000 exceeds
_MEDIAN_LENGTH = 1.1774
_GROSS_SIGMA = 4.5
# errors that last are seen as blocks that do not average out
_BLOCK_S = 1.0
_LEAST_BLOCKS = 6
# in so many flights chance alone raises none of the combinations
_CHANCE = 0.95
_SCALES = {
    "runway_from_base": 1e-3,
    "head_from_camera": 1e-3,
    "ptu_position": 0.1,
    "drift": 1e-5,
    "focal": 1.0,
    "principal": 1.0,
}
_OTHER_SCALE = 0.01


class FlightFitError(GroundstationError):
    """The flight does not determine what is asked for, or does not fit at all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationFit:
    """How one station's n looks fit: ``residual_px`` (n, 2), ``kept`` (n,), ``usable`` (n,), noise found over assumed.

    ``usable`` is False where there is no angle or no reference; ``kept`` where the look is gross, too.
    """

    residual_px: FloatArray
    usable: MaskArray
    kept: MaskArray
    noise_factor: float

    @property
    def rms_px(self) -> float:
        """Root mean square distance between seen and predicted pixels that were kept, px."""
        return float(np.sqrt(np.mean(np.sum(self.residual_px[self.kept] ** 2, axis=1)))) if self.kept.any() else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightFit:
    """The solution of a `FlightProblem` of p parameters.

    Attributes
    ----------
    change, sigma : (p,) what was found and one sigma.
    covariance : (p, p), rotations as small angles about the solution, in the frame of their name.
    reduced_chi_square : of the kept residuals by the assumed noise.
    lasting_factor : (p,) by how much errors that last have raised each sigma.
    point_sigma_m : so far along the body the point seen may lie from where it is taken to be; in the covariance.
    condition : of the information, its parameters scaled to unit diagonal.
    parts : the paths of aircraft and heads, with their smoothness.
    """

    problem: FlightProblem
    change: FloatArray
    covariance: FloatArray
    reduced_chi_square: float
    lasting_factor: FloatArray
    condition: float
    point_sigma_m: float = 0.0
    stations: Mapping[str, StationFit] = field(default_factory=dict)
    parts: tuple[PathPart, ...] = ()

    @property
    def sigma(self) -> FloatArray:
        """One sigma of each parameter (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlations (p, p)."""
        return np.asarray(self.covariance / np.outer(self.sigma, self.sigma))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightSolution:
    """What fits best: the change (p,), and how each station fits; how well it is known, `judged` says."""

    change: FloatArray
    stations: Mapping[str, StationFit]
    joint: PathResiduals


@dataclass(slots=True, eq=False)
class _Weighted:
    """Residuals and Jacobian of the kept looks in sigmas, computed once for each point."""

    problem: FlightProblem
    whitening: dict[str, FloatArray]
    kept: dict[str, MaskArray]
    _at: bytes = b""
    _residual: FloatArray = field(default_factory=lambda: np.zeros(0))
    _jacobian: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def residual(self, change: FloatArray) -> FloatArray:
        self._compute(change)
        return self._residual

    def jacobian(self, change: FloatArray) -> FloatArray:
        self._compute(change)
        return self._jacobian

    def _compute(self, change: FloatArray) -> None:
        if change.tobytes() == self._at:
            return
        problem = self.problem
        residuals, jacobians = [], []
        for name, looks in problem.looks.items():
            predicted = problem.predict(name, change)
            # a look that lost its reference meanwhile pulls nowhere
            kept = (self.kept[name] & predicted.usable)[self.kept[name], None, None]
            whitening = self.whitening[name][self.kept[name]] * kept
            off = (predicted.pixel_px - looks.pixel_px)[self.kept[name]]
            residuals.append(np.einsum("nij,nj->ni", whitening, off).ravel())
            jacobians.append((whitening @ predicted.jacobian[self.kept[name]]).reshape(-1, len(change)))
        known = np.isfinite(problem.prior_sigma)
        residuals.append((change / problem.prior_sigma)[known])
        jacobians.append(np.diag(1.0 / problem.prior_sigma)[known])
        self._at = change.tobytes()
        self._residual, self._jacobian = np.concatenate(residuals), np.concatenate(jacobians)


def solve_flight(problem: FlightProblem, start: FloatArray | None = None) -> FlightFit:
    """Find the parameters from a start (p,), zero by default; raises `FlightFitError` where looks are too few."""
    return judged(find_solution(problem, start))


def find_solution(problem: FlightProblem, start: FloatArray | None = None) -> FlightSolution:
    """Find what fits best, as `solve_flight`, without its covariance."""
    change = np.zeros(len(problem.names)) if start is None else start.copy()
    factors = dict.fromkeys(problem.looks, 1.0)
    for _ in range(_ROBUST_ROUNDS):
        problem = _pointed(problem, change)
        fits = {name: _station_fit(problem, name, change, factors[name], gross=False) for name in problem.looks}
        _require_enough(problem, fits)
        # the scale follows the residuals down from a start that may be far off
        factors = {name: fit.noise_factor for name, fit in fits.items()}
        change = _minimised(problem, _weighted(problem, change, fits), change, "soft_l1", 60)
    parts = path_parts(problem)
    for _ in range(_FINAL_ROUNDS):
        problem = _pointed(problem, change)
        fits = {name: _station_fit(problem, name, change, factors[name], gross=True) for name in problem.looks}
        _require_enough(problem, fits)
        joint = _joint(problem, change, fits, factors, parts)
        change = _minimised(problem, joint, change, "linear", 12)
        factors, parts = _noise(joint, change), joint.loosened(change)
    fits = {name: replace(fit, noise_factor=factors[name]) for name, fit in fits.items()}
    return FlightSolution(change=change, stations=fits, joint=_joint(problem, change, fits, factors, parts))


def _pointed(problem: FlightProblem, change: FloatArray) -> FlightProblem:
    return replace(problem, track=problem.track.pointed(problem.antenna_m(change)))


def _minimised(
    problem: FlightProblem, weighted: "_Weighted | PathResiduals", start: FloatArray, loss: str, most: int
) -> FloatArray:
    found = least_squares(
        weighted.residual,
        start,
        jac=weighted.jacobian,
        loss=loss,
        f_scale=_BEND_SIGMA,
        x_scale=np.array([_scale(name) for name in problem.names]),
        max_nfev=most,
    )
    return np.asarray(found.x, dtype=np.float64)


def _noise(joint: PathResiduals, change: FloatArray) -> dict[str, float]:
    given = {name: looks.sigma_given for name, looks in joint.problem.looks.items()}
    return {name: max(found, 1.0 if given[name] else 1e-6) for name, found in joint.noise(change).items()}


def _scale(name: str) -> float:
    return next((value for part, value in _SCALES.items() if part in name), _OTHER_SCALE)


def _station_fit(problem: FlightProblem, name: str, change: FloatArray, factor: float, gross: bool) -> StationFit:
    """Judge one station's looks at a solution; ``gross`` leaves out what is far off."""
    looks, predicted = problem.looks[name], problem.predict(name, change)
    off = predicted.pixel_px - looks.pixel_px
    white = np.einsum("nij,nj->ni", _whitening(predicted.covariance_px2), off)
    length = np.linalg.norm(white, axis=1)
    usable = predicted.usable
    median = float(np.median(length[usable])) if usable.any() else 1.0
    found = max(median / _MEDIAN_LENGTH, 1e-6)
    if looks.sigma_given:
        found = max(found, 1.0)
    kept = usable & (length <= _GROSS_SIGMA * found) if gross else usable
    return StationFit(residual_px=off, usable=usable, kept=kept, noise_factor=found if found else factor)


def _whitening(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _weighted(problem: FlightProblem, change: FloatArray, fits: Mapping[str, StationFit]) -> _Weighted:
    whitening = {
        name: _whitening(problem.predict(name, change).covariance_px2) / fit.noise_factor for name, fit in fits.items()
    }
    return _Weighted(problem=problem, whitening=whitening, kept={name: fit.kept for name, fit in fits.items()})


def _joint(
    problem: FlightProblem,
    change: FloatArray,
    fits: Mapping[str, StationFit],
    factors: Mapping[str, float],
    parts: tuple[PathPart, ...],
) -> PathResiduals:
    return PathResiduals(problem, factors, {name: fit.kept for name, fit in fits.items()}, change, parts)


def _require_enough(problem: FlightProblem, fits: Mapping[str, StationFit]) -> None:
    for name, fit in fits.items():
        count, all_of_them = int(fit.kept.sum()), len(problem.looks[name])
        if count < MIN_OBSERVATIONS:
            got = f"{count} of {all_of_them} pixels with angle, reference and a fit"
            raise FlightFitError(f"station {name}: got {got}; wanted at least {MIN_OBSERVATIONS}")


def judged(solution: FlightSolution, point_sigma_m: float = 0.0) -> FlightFit:
    """Return the fit with (JᵀWJ)⁻¹, the flight's part of it raised by the reduced chi-square and by what lasts.

    ``point_sigma_m``: so far along the body the point seen may lie from where it is taken to be, the same all the time.
    """
    joint, change, fits = solution.joint, solution.change, solution.stations
    problem = joint.problem
    residual, jacobian = joint.residual(change), joint.jacobian(change)
    known = np.isfinite(problem.prior_sigma)
    before = np.diag(np.where(known, 1.0 / problem.prior_sigma, 0.0) ** 2)
    told = jacobian.T @ jacobian - before
    count = 2 * sum(int(fit.kept.sum()) for fit in fits.values()) + int(known.sum())
    # what the pixels add to that which fixes and readings leave over by themselves
    chi_square = (float(residual @ residual) - joint.base) / max(count - len(change), 1)
    covariance = _inverse(told / max(1.0, chi_square) + before)
    alone = np.sqrt(np.diag(covariance))
    by_point = point_sigma_m * moved_by_point(joint, change, covariance)
    covariance = _raised(joint, change, covariance, told / max(1.0, chi_square))
    lasting = np.sqrt(np.diag(covariance)) / alone
    covariance += np.outer(by_point, by_point)
    turned = np.eye(len(change))
    for name in problem.looks:
        station = problem.station_change(change, name)
        for group, part in (("runway_from_base", slice(0, 3)), ("head_from_camera", slice(6, 9))):
            places = [k for k, n in enumerate(problem.names) if n.startswith(f"{name}.{group}.")]
            if len(places) == 3:
                turned[np.ix_(places, places)] = left_jacobian(station[part])
    return FlightFit(
        problem=problem,
        change=change,
        covariance=turned @ covariance @ turned.T,
        reduced_chi_square=chi_square,
        lasting_factor=lasting,
        point_sigma_m=0.0 if ANTENNA[0] in problem.names else point_sigma_m,
        condition=float(np.linalg.cond(_unit(told + before))),
        stations=dict(fits),
        parts=joint.parts,
    )


def moved_by_point(joint: PathResiduals, change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return what the solution (p,) makes of a point seen 1 m behind where it is taken to be.

    It is considered, not solved for: a clock that is late puts an aircraft that flies straight just as far behind. Zero
    where the place of the antenna is to be found, which is the same.
    """
    problem = joint.problem
    if ANTENNA[0] in problem.names:
        return np.zeros(len(change))
    wider = replace(problem, names=(*problem.names, ANTENNA[0]), prior_sigma=np.append(problem.prior_sigma, np.inf))
    at = np.append(change, 0.0)
    jacobian = PathResiduals(wider, joint.factors, joint.kept, at, joint.parts).jacobian(at)
    return np.asarray(-covariance @ (jacobian[:, :-1].T @ jacobian[:, -1]))


def _unit(information: FloatArray) -> FloatArray:
    """Return the information with its parameters scaled to unit diagonal."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(information / np.outer(scale, scale))


def _inverse(information: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(np.linalg.pinv(_unit(information), rcond=1e-14, hermitian=True) / np.outer(scale, scale))


def _raised(joint: PathResiduals, change: FloatArray, covariance: FloatArray, told: FloatArray) -> FloatArray:
    """Return the covariance (p, p), raised by what lasts: combination by combination, never parameter by parameter.

    Parameters that go together are known in combinations a thousand times better than alone: to raise one of them by
    itself would turn the combination, and state another one as well known. What was known before the flight, and not
    ``told`` by it (p, p), has no errors that last.
    """
    sigma = np.sqrt(np.diag(covariance))
    size, axes = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    size = np.maximum(size, 1e-15)
    combined = axes / sigma[:, None]
    gain = covariance @ combined
    factor = _lasting_factor(joint, change, covariance, gain)
    share = np.clip(np.einsum("ik,ij,jk->k", gain, told, gain) / size, 0.0, 1.0)
    spread = sigma[:, None] * axes
    return np.asarray((spread * (size * (1.0 + (factor**2 - 1.0) * share))) @ spread.T)


def _lasting_factor(joint: PathResiduals, change: FloatArray, covariance: FloatArray, gain: FloatArray) -> FloatArray:
    """Return by how much (p,) errors that last raise the sigma of each combination: blocks of time against expectation.

    ``gain`` (p, p) has in each column what a block's gradient does to a combination. Looks of one block, of all
    stations, count as one observation: steps of an encoder and a biased target point do not average out within it. What
    chance makes of so few blocks raises nothing.
    """
    p = len(covariance)
    blocks = joint.scores(change, covariance, _BLOCK_S)
    if len(blocks.seen) < max(_LEAST_BLOCKS, p // 2):
        return np.ones(p)
    seen = (blocks.seen @ gain) ** 2
    expected = np.maximum(np.einsum("ik,nij,jk->nk", gain, blocks.expected, gain), 0.0)
    total = np.maximum(expected.sum(axis=0), 1e-300)
    ratio = seen.sum(axis=0) / total
    # of a sum of squares of unequal size (Satterthwaite 1946)
    freedom = total**2 / np.maximum((expected**2).sum(axis=0), 1e-300)
    limit = chi2.ppf(_CHANCE ** (1.0 / p), freedom) / freedom
    return np.asarray(np.where(ratio > limit, np.sqrt(np.maximum(ratio, 1.0)), 1.0))
