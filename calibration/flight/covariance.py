"""How well a flight determines its calibration: (JᵀWJ)⁻¹, with an allowance for errors that last."""

from dataclasses import replace

import numpy as np

from calibration.flight.fit import FlightFit, FlightSolution, StationFit, find_solution
from calibration.flight.paths import PathResiduals
from calibration.flight.problem import ANTENNA, FlightProblem, left_jacobian
from calibration.information import inverse, unit_diagonal
from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_quantile

# errors that last are seen as blocks of time that do not average out
_BLOCK_S = 1.0
LEAST_BLOCKS = 6
# in this share of flights chance alone raises none of the combinations
_CHANCE = 0.95
# with fewer pixels the mean of a block says nothing of their scatter
_LEAST_IN_BLOCK = 4
_ROTATIONS = (("runway_from_base", slice(0, 3)), ("head_from_camera", slice(6, 9)))


def solve_flight(problem: FlightProblem, start: FloatArray | None = None) -> FlightFit:
    """Find parameters and covariance from a start (p,), zero by default; raises `FlightFitError` as `find_solution`."""
    return with_covariance(find_solution(problem, start))


def with_covariance(solution: FlightSolution, point_sigma_m: float = 0.0) -> FlightFit:
    """Return the fit with (JᵀWJ)⁻¹, the flight's part enlarged by the reduced chi-square and correlated errors.

    ``point_sigma_m``: 1 sigma of a constant displacement of the observed point along the body.
    """
    joint, change, fits = solution.joint, solution.change, solution.stations
    problem = joint.problem
    linearised = joint.fit_problem().linearise(change)
    known = np.isfinite(problem.prior_sigma)
    prior = np.diag(np.where(known, 1.0 / problem.prior_sigma, 0.0) ** 2)
    flown = linearised.information - prior
    count = 2 * sum(int(fit.kept.sum()) for fit in fits.values()) + int(known.sum())
    # information of the pixels beyond the residual freedom of fixes and readings
    chi_square = (linearised.chi_square - joint.base) / max(count - len(change), 1)
    covariance = inverse(flown / max(1.0, chi_square) + prior)
    alone = np.sqrt(np.diag(covariance))
    by_point = point_sigma_m * moved_by_point(joint, change, covariance)
    covariance = _raised(joint, change, covariance, flown / max(1.0, chi_square))
    lasting = np.sqrt(np.diag(covariance)) / alone
    covariance += np.outer(by_point, by_point)
    turned = _about_solution(problem, change)
    offset_m, offset_sigma_m = joint.lasting_offset(change)
    return FlightFit(
        problem=problem,
        change=change,
        covariance=turned @ covariance @ turned.T,
        reduced_chi_square=chi_square,
        lasting_factor=lasting,
        point_sigma_m=0.0 if ANTENNA[0] in problem.names else point_sigma_m,
        condition=float(np.linalg.cond(unit_diagonal(linearised.information))),
        stations=dict(fits),
        parts=joint.parts,
        lasting_offset_m=offset_m,
        lasting_sigma_m=offset_sigma_m,
        misfit_px={name: lasting_misfit_px(problem.observations[name].t_s, fit) for name, fit in fits.items()},
    )


def _about_solution(problem: FlightProblem, change: FloatArray) -> FloatArray:
    """Return T (p, p) from rotation vectors added to the rig's to small rotations about the solution."""
    turned = np.eye(len(change))
    for name in problem.observations:
        station = problem.station_change(change, name)
        for group, part in _ROTATIONS:
            places = [k for k, n in enumerate(problem.names) if n.startswith(f"{name}.{group}.")]
            if len(places) == 3:
                turned[np.ix_(places, places)] = left_jacobian(station[part])
    return turned


def moved_by_point(joint: PathResiduals, change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the effect on the solution (p,) of an observed point 1 m behind the assumed one.

    It is considered, not estimated: a late clock moves an aircraft in straight flight back in the same way. Zero
    where the antenna's position is estimated, which is equivalent.
    """
    problem = joint.problem
    if ANTENNA[0] in problem.names:
        return np.zeros(len(change))
    wider = replace(problem, names=(*problem.names, ANTENNA[0]), prior_sigma=np.append(problem.prior_sigma, np.inf))
    at = np.append(change, 0.0)
    jacobian = PathResiduals(wider, joint.factors, joint.kept, at, joint.parts).linearise(at).jacobian
    return np.asarray(-covariance @ (jacobian[:, :-1].T @ jacobian[:, -1]))


def lasting_misfit_px(t_s: FloatArray, fit: StationFit) -> float:
    """Return 1 sigma (px, of u and of v) of the part of a station's residuals that lasts for a block of time.

    Zero where it is within chance: less than two of its own sigmas.
    """
    block = np.floor(t_s[fit.kept] / _BLOCK_S).astype(int)
    residuals = fit.residual_px[fit.kept]
    excess = []
    for number in np.unique(block):
        own = residuals[block == number]
        if len(own) >= _LEAST_IN_BLOCK:
            # the mean square of a block's mean, less what white noise makes of it
            excess.append(np.mean(own.mean(axis=0) ** 2 - own.var(axis=0, ddof=1) / len(own)))
    if len(excess) < LEAST_BLOCKS:
        return 0.0
    variance, chance = float(np.mean(excess)), float(np.std(excess) / np.sqrt(len(excess)))
    return float(np.sqrt(variance)) if variance > 2.0 * chance else 0.0


def _raised(joint: PathResiduals, change: FloatArray, covariance: FloatArray, flown: FloatArray) -> FloatArray:
    """Return the covariance (p, p), enlarged for correlated errors: by combinations, never by single parameters.

    Correlated parameters are known in combinations a thousand times better than alone: enlarging one of them by
    itself would rotate the combination, and make another one appear well known. Prior information, which is not
    in ``flown`` (p, p), the information of the flight alone, has no correlated errors.
    """
    sigma = np.sqrt(np.diag(covariance))
    size, axes = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    size = np.maximum(size, 1e-15)
    combined = axes / sigma[:, None]
    gain = covariance @ combined
    factor = correlated_error_factor(joint, change, covariance, gain)
    share = np.clip(np.einsum("ik,ij,jk->k", gain, flown, gain) / size, 0.0, 1.0)
    spread = sigma[:, None] * axes
    return np.asarray((spread * (size * (1.0 + (factor**2 - 1.0) * share))) @ spread.T)


def correlated_error_factor(
    joint: PathResiduals, change: FloatArray, covariance: FloatArray, gain: FloatArray
) -> FloatArray:
    """Return the factor (p,) of each combination's sigma due to correlated errors: blocks of time against expectation.

    ``gain`` (p, p) has in each column the effect of a block's gradient on a combination. Observations of one block, of
    all stations, count as one: steps of an encoder and a biased target point do not average out within it. Scatter
    within chance for so few blocks has no effect.
    """
    p = len(covariance)
    blocks = joint.scores(change, covariance, _BLOCK_S)
    if len(blocks.seen) < max(LEAST_BLOCKS, p // 2):
        return np.ones(p)
    seen = (blocks.seen @ gain) ** 2
    expected = np.maximum(np.einsum("ik,nij,jk->nk", gain, blocks.expected, gain), 0.0)
    total = np.maximum(expected.sum(axis=0), 1e-300)
    ratio = seen.sum(axis=0) / total
    # of a sum of squares of unequal size (Satterthwaite 1946)
    freedom = total**2 / np.maximum((expected**2).sum(axis=0), 1e-300)
    limit = chi_square_quantile(_CHANCE ** (1.0 / p), freedom) / freedom
    return np.asarray(np.where(ratio > limit, np.sqrt(np.maximum(ratio, 1.0)), 1.0))
