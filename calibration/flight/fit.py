"""Solving a flight: a robust fit, then one without outliers in which the paths of aircraft and heads are unknown."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.flight.path_parts import PathPart, path_parts
from calibration.flight.paths import PathResiduals
from calibration.flight.problem import FlightProblem, PixelPredictions
from calibration.robust_fit import (
    OUTLIER_SIGMA,
    FitProblem,
    Linearisation,
    Loss,
    fit_reweighted,
    noise_factor,
    pixel_linearisation,
    stacked,
    whitened_length,
    whitening_of,
)
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError

MIN_OBSERVATIONS = 20
_ROBUST_ROUNDS = 4
_FINAL_ROUNDS = 3
_FINAL_EVALUATIONS = 12
# where fixes have an error that lasts, as many as it takes until the observations that are kept stay the same: eleven
# on a drawn flight with gaps, where to end after eight made the result depend on the processor's rounding
_MOST_ROUNDS = 30
# the robust fit, the paths, and each final round
SOLUTION_STEPS = 2 + _FINAL_ROUNDS
_LEAST_NOISE_FACTOR = 1e-6


class FlightFitError(GroundstationError):
    """The flight does not determine the requested parameters, or does not fit at all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationFit:
    """How one station's n observations fit.

    Attributes
    ----------
    residual_px : (n, 2).
    usable : (n,) False where there is no angle or no reference.
    kept : (n,) usable and no outlier.
    noise_factor : noise found over that assumed.
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
    change, sigma : (p,) the estimate and one sigma.
    covariance : (p, p), rotations as small angles about the solution, in the frame of their name.
    reduced_chi_square : of the kept residuals by the assumed noise.
    lasting_factor : (p,) factor of each sigma due to correlated errors.
    point_sigma_m : 1 sigma of the observed point's displacement along the body; included in the covariance.
    condition : of the information, its parameters scaled to unit diagonal.
    parts : the paths of aircraft and heads, with their smoothness.
    misfit_px : 1 sigma of what each station's pixels are off by for a second and more, of u and of v.
    lasting_offset_m, lasting_sigma_m : (d,) mean of the fixes' lasting error over the flight, and one sigma of it as
        they state it; empty without one.
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
    misfit_px: Mapping[str, float] = field(default_factory=dict)
    lasting_offset_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    lasting_sigma_m: FloatArray = field(default_factory=lambda: np.zeros(0))

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
    """The change (p,) of least cost and the fit of each station; its covariance comes from `with_covariance`.

    ``paths`` have the smoothness of their samples alone; those of ``joint`` that of pixels and samples together.
    """

    change: FloatArray
    stations: Mapping[str, StationFit]
    joint: PathResiduals
    paths: tuple[PathPart, ...]


def find_solution(
    problem: FlightProblem,
    start: FloatArray | None = None,
    paths: Sequence[PathPart] = (),
    step: Callable[[], None] = lambda: None,
) -> FlightSolution:
    """Find the change of least cost from a start (p,), zero by default; raises `FlightFitError` if data are few.

    ``paths`` of an earlier solution from the same samples need no second estimate of their smoothness; ``step`` is
    called `SOLUTION_STEPS` times.
    """
    robust = _RobustFlightRounds(problem)
    change = np.zeros(len(problem.names)) if start is None else start
    change = fit_reweighted(robust.weighted_at, change, _ROBUST_ROUNDS)
    step()
    paths = path_parts(robust.problem, paths)
    step()
    final = _PathRounds(robust.problem, {name: fit.noise_factor for name, fit in robust.stations.items()}, paths)
    for k in range(_MOST_ROUNDS):
        before = final.kept
        change = fit_reweighted(final.weighted_at, change, 1, _FINAL_EVALUATIONS)
        final.update_noise(change)
        if k < _FINAL_ROUNDS:
            step()
        # paths that pixels alone hold in place take in, round by round, what a poor start left out
        elif final.kept == before:
            break
        if k + 1 == _FINAL_ROUNDS and not final.has_lasting_error:
            break
    joint = final.joint_at(change)
    found = final.stations_along(joint, change)
    stations = {name: replace(fit, noise_factor=final.factors[name]) for name, fit in found.items()}
    return FlightSolution(change=change, stations=stations, joint=joint, paths=paths)


@dataclass(slots=True, eq=False)
class _RobustFlightRounds:
    """Rounds of the robust fit: no observation is left out, paths are as sampled.

    The noise factors follow the residuals from a start that may be far off.
    """

    problem: FlightProblem
    stations: Mapping[str, StationFit] = field(default_factory=dict)

    def weighted_at(self, change: FloatArray) -> FitProblem:
        """Return the problem with the noise of each observation as it is at a change (p,)."""
        problem = self.problem = with_antenna_of(self.problem, change)
        predicted = {name: problem.predict(name, change) for name in problem.observations}
        self.stations = {
            name: _station_fit(problem, name, seen, without_outliers=False) for name, seen in predicted.items()
        }
        _require_enough(problem, self.stations)
        whitening = {
            name: whitening_of(predicted[name].covariance_px2) / fit.noise_factor for name, fit in self.stations.items()
        }
        kept = {name: fit.kept for name, fit in self.stations.items()}

        def evaluate(at: FloatArray) -> Linearisation:
            return stacked(
                [
                    pixel_linearisation(problem.predict(name, at), observed.pixel_px, whitening[name], kept[name])
                    for name, observed in problem.observations.items()
                ]
            )

        return FitProblem(
            evaluate=evaluate, prior_sigma=problem.prior_sigma, step_scale=problem.step_scale, loss=Loss.SOFT_L1
        )


@dataclass(slots=True, eq=False)
class _PathRounds:
    """Rounds of the final fit: outliers are left out, and the paths are estimated with the calibration."""

    problem: FlightProblem
    factors: dict[str, float]
    parts: tuple[PathPart, ...]
    stations: Mapping[str, StationFit] = field(default_factory=dict)
    _joint: PathResiduals | None = None

    @property
    def has_lasting_error(self) -> bool:
        """Whether the fixes have an error that lasts."""
        return any(part.lasting is not None for part in self.parts)

    @property
    def kept(self) -> dict[str, bytes]:
        """The observations kept in the newest round, by station."""
        return {name: fit.kept.tobytes() for name, fit in self.stations.items()}

    def weighted_at(self, change: FloatArray) -> FitProblem:
        """Return the problem with outliers and noise as they are at a change (p,)."""
        self.problem = with_antenna_of(self.problem, change)
        self.stations = self._stations_at(change)
        _require_enough(self.problem, self.stations)
        self._joint = self.joint_at(change)
        return self._joint.fit_problem()

    def _stations_at(self, change: FloatArray) -> Mapping[str, StationFit]:
        """Return how the stations fit along the fixes; where those are off for long, along the paths found."""
        problem, names = self.problem, self.problem.observations
        fits = {n: _station_fit(problem, n, problem.predict(n, change), without_outliers=True) for n in names}
        if not self.has_lasting_error:
            return fits
        self.stations = self.stations or fits
        joint = self.joint_at(change)
        judged = {}
        for name, seen in joint.predictions(change).items():
            # the path has not followed what was left out, and is uncertain there
            left_out = seen.usable & ~self.stations[name].kept
            covariance = seen.own_px2.copy()
            covariance[left_out] += joint.path_covariances(change, name, left_out)
            along = replace(seen, covariance_px2=covariance)
            judged[name] = _station_fit(problem, name, along, without_outliers=True)
        return judged

    def stations_along(self, joint: PathResiduals, change: FloatArray) -> Mapping[str, StationFit]:
        """Return the newest fits, where fixes are off for long with residuals along the paths of a change (p,)."""
        if not joint.has_lasting_error:
            return self.stations
        seen = joint.predictions(change)
        return {
            name: replace(
                fit,
                residual_px=seen[name].pixel_px - self.problem.observations[name].pixel_px,
                usable=seen[name].usable,
                kept=fit.kept & seen[name].usable,
            )
            for name, fit in self.stations.items()
        }

    def update_noise(self, change: FloatArray) -> None:
        """Estimate noise factors and breaks of the paths from the residuals of the newest fit."""
        if self._joint is None:
            return
        for name, found in self._joint.noise(change).items():
            least = 1.0 if self.problem.observations[name].sigma_given else _LEAST_NOISE_FACTOR
            self.factors[name] = max(found, least)
        self.parts = self._joint.loosened(change)

    def joint_at(self, change: FloatArray) -> PathResiduals:
        """Return the residuals with the newest noise factors and paths, weights taken at a change (p,)."""
        kept = {name: fit.kept for name, fit in self.stations.items()}
        return PathResiduals(self.problem, dict(self.factors), kept, change, self.parts)


def with_antenna_of(problem: FlightProblem, change: FloatArray) -> FlightProblem:
    """Return the problem with the aircraft's attitude taken for the antenna's place of a change (p,)."""
    return replace(problem, track=problem.track.pointed(problem.antenna_m(change)))


def _station_fit(
    problem: FlightProblem, name: str, predicted: PixelPredictions, *, without_outliers: bool
) -> StationFit:
    """Return how one station's observations fit at a prediction."""
    observed, usable = problem.observations[name], predicted.usable
    off = predicted.pixel_px - observed.pixel_px
    length = whitened_length(off, predicted.covariance_px2)
    factor = noise_factor(length[usable], 1.0 if observed.sigma_given else _LEAST_NOISE_FACTOR)
    kept = usable & (length <= OUTLIER_SIGMA * factor) if without_outliers else usable
    return StationFit(residual_px=off, usable=usable, kept=kept, noise_factor=factor)


def _require_enough(problem: FlightProblem, stations: Mapping[str, StationFit]) -> None:
    for name, fit in stations.items():
        count, total = int(fit.kept.sum()), len(problem.observations[name])
        if count < MIN_OBSERVATIONS:
            got = f"{count} of {total} pixels with angle, reference and a fit"
            raise FlightFitError(f"station {name}: got {got}; wanted at least {MIN_OBSERVATIONS}")
