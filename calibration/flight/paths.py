"""Residuals of a flight, with the paths of the aircraft and of the PTUs unknown (docs/derivation.md, section 16).

A path is constrained by its noisy samples (fixes, readings), its smoothness, and the pixels. For
each change of the calibration the best paths are solved for (variable projection), so that neither the
fixes' nor the encoders' noise counts as motion, and errors common to frames and stations count once:

    r = (W (h(c, θ) − z), (B θ − y) / σ, D θ / s),    θ(c) = argmin |r|²,    dr/dc = (I − A A⁺) J_c   (Kaufman 1975)

with A the derivative by the paths' coefficients θ. Its information is that of the pixels with all paths integrated out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import block_diag, csc_matrix, csr_matrix, vstack
from scipy.sparse.linalg import SuperLU, splu

from calibration.flight.lasting_error import joined, mean_sigma
from calibration.flight.path_design import PathDesign, path_design
from calibration.flight.path_parts import MILLI, PathPart, path_parts
from calibration.flight.problem import AngleCurve, FlightProblem, PixelPredictions
from calibration.flight.windowed_inverse import WindowedInverse
from calibration.robust_fit import FitProblem, Linearisation, whitening_of
from groundstation.arrays import FloatArray, MaskArray

_ROUNDS = 2
_PROBES = 16
_LARGEST = 50
# pixels whose covariance is computed at once
_CHUNK = 100
# an entry of a solution takes as long as so many products within the band
_BAND_WORTH = 30


# where fixes are off by metres, the paths move by as much, which is no small step near a camera
_FAR_ROUNDS = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Linear:
    """Pixels at one point: predictions, whitened residuals (2n,), derivatives by coefficients (2n, K) and change."""

    predicted: dict[str, PixelPredictions]
    residual: FloatArray
    by_path: csr_matrix
    by_change: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Solved:
    """The paths' coefficients at one change, pixels linearised there, and the factors of the normal matrix."""

    theta: FloatArray
    linear: _Linear
    root: SuperLU


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlockScores:
    """Parts of the gradient by blocks of time (n, p), and their covariance by noise alone (n, p, p)."""

    seen: FloatArray
    expected: FloatArray


@dataclass(slots=True, eq=False)
class PathResiduals:
    """Residuals in sigmas and their derivatives by a change (p,) of the calibration, with the paths eliminated.

    ``factors`` are the ratios of estimated to assumed pixel noise and ``kept`` the observations, by station; ``at`` is
    the change at which the pixels' weights are computed. Rows: pixels by station, then the paths' residuals.
    """

    problem: FlightProblem
    factors: Mapping[str, float]
    kept: Mapping[str, MaskArray]
    at: FloatArray
    parts: tuple[PathPart, ...] = ()
    _known: csr_matrix = None
    _data: FloatArray = field(default_factory=lambda: np.zeros(0))
    _normal: csr_matrix = None
    _alone: FloatArray = field(default_factory=lambda: np.zeros(0))
    _white: dict[str, FloatArray] = field(default_factory=dict)
    _pull: FloatArray = field(default_factory=lambda: np.zeros(0))
    _designs: dict[str, PathDesign] = field(default_factory=dict)
    _done: bytes = b""
    _last: _Solved | None = None

    def __post_init__(self) -> None:
        self.parts = self.parts or path_parts(self.problem)
        pieces = [part.known() for part in self.parts]
        joins = self._joins()
        self._known = vstack([block_diag([design for design, _ in pieces]), *joins], format="csr")
        self._data = np.concatenate([*(data for _, data in pieces), *(np.zeros(j.shape[0]) for j in joins)])
        self._normal = (self._known.T @ self._known).tocsc()
        self._pull = self._known.T @ self._data
        self._alone = np.asarray(_factors(self._normal).solve(self._pull))
        along = self._along(self._alone)
        for name in along.observations:
            own = along.predict(name, self.at).own_px2[self.kept[name]] * self.factors[name] ** 2
            self._white[name] = whitening_of(own)

    def _joins(self) -> list[csr_matrix]:
        """Return the rows by which the fixes' lasting error goes on from stretch to stretch."""
        count = sum(part.size for part in self.parts)
        along = [part for part in self.parts if part.lasting is not None]
        return [
            joined(one.lasting, one.lasting_first, two.lasting, two.lasting_first, count)
            for one, two in pairwise(along)
            if one.lasting is not None and two.lasting is not None
        ]

    @property
    def base(self) -> float:
        """What fixes, readings and smoothness leave over without the pixels, in squared sigmas."""
        return float(np.sum((self._known @ self._alone - self._data) ** 2))

    @property
    def has_lasting_error(self) -> bool:
        """Whether the fixes have an error that lasts, so that only the paths found say where the aircraft was."""
        return any(part.lasting is not None for part in self.parts)

    def lasting_offset(self, change: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean (d,) of the fixes' lasting error over the flight, m, and one sigma of it; else nothing."""
        theta, d = self._solve(change).theta, 0
        total, weight, sigma = np.zeros(3), 0.0, np.zeros(3)
        for part in self.parts:
            error = part.lasting
            if error is None:
                continue
            d, span_s = len(error.sigma_m), float(error.knots_s[-1] - error.knots_s[0])
            own = part.lasting_coefficients(theta)
            total += span_s * (own[:, 0] + own[:, 1:].mean(axis=1))
            weight += span_s
            sigma = error.sigma_m
        if not d:
            return np.zeros(0), np.zeros(0)
        return total / weight, mean_sigma(sigma, weight)

    def predictions(self, change: FloatArray) -> dict[str, PixelPredictions]:
        """Return the pixels of each station along the paths found for a change (p,)."""
        return self._solve(change).linear.predicted

    def path_covariances(self, change: FloatArray, station: str, which: MaskArray) -> FloatArray:
        """Return what the paths' uncertainty makes of a station's pixels ``which`` (n,): (k, 2, 2) px²."""
        at = self._solve(change)
        seen, k = at.linear.predicted[station], int(which.sum())
        found = np.zeros((k, 2, 2))
        places = np.flatnonzero(which)
        for first in range(0, k, _CHUNK):
            chosen = np.zeros(len(which), dtype=np.bool_)
            chosen[places[first : first + _CHUNK]] = True
            white = np.broadcast_to(np.eye(2), (int(chosen.sum()), 2, 2))
            A = self._by_paths(station, seen, chosen, white)
            covariance = np.asarray(A @ at.root.solve(A.T.toarray()))
            rows = 2 * np.arange(len(white))
            found[first : first + _CHUNK] = covariance[rows[:, None, None] + [[0], [1]], rows[:, None, None] + [[0, 1]]]
        return found

    def fit_problem(self) -> FitProblem:
        """Return the fit of the calibration (p,), with its priors."""
        return FitProblem(
            evaluate=self.linearise, prior_sigma=self.problem.prior_sigma, step_scale=self.problem.step_scale
        )

    def linearise(self, change: FloatArray) -> Linearisation:
        """Return the residuals of pixels and paths, and their derivatives with the paths following."""
        at = self._solve(change)
        linear = at.linear
        moved = at.root.solve(np.asarray(linear.by_path.T @ linear.by_change))
        pixels = linear.by_change - linear.by_path @ moved
        return Linearisation(
            residual=np.concatenate([linear.residual, self._known @ at.theta - self._data]),
            jacobian=np.vstack([pixels, -(self._known @ moved)]),
        )

    def noise(self, change: FloatArray) -> dict[str, float]:
        """Return each station's noise found over assumed: what its pixels leave over, and may."""
        at = self._solve(change)
        found, first = {}, 0
        rng = np.random.default_rng(0)
        for name, kept in self.kept.items():
            rows = slice(first, first + 2 * int(kept.sum()))
            first = rows.stop
            residual, A = at.linear.residual[rows], at.linear.by_path[rows]
            # the trace of A N⁻¹ Aᵀ (Hutchinson 1990)
            signs = rng.choice([-1.0, 1.0], (len(residual), _PROBES))
            through = np.asarray(A.T @ signs)
            taken = float(np.sum(through * at.root.solve(through))) / _PROBES
            free = max(len(residual) - taken, 0.1 * len(residual))
            found[name] = self.factors[name] * float(np.sqrt(residual @ residual / free))
        return found

    def loosened(self, change: FloatArray) -> tuple[PathPart, ...]:
        """Return the paths of the antenna with the breaks freed that pixels and fixes together show."""
        at = self._solve(change)
        return tuple(
            self._loosened(part, at) if part.station is None and part.lasting is None else part for part in self.parts
        )

    def _loosened(self, part: PathPart, at: _Solved) -> PathPart:
        smooth = list(part.smoothness)
        for axis, coefficients in enumerate(part.coefficients(at.theta)):
            first = part.first + axis * part.basis.count
            D = part.basis.differences(smooth[axis].order)
            found, taken = D @ coefficients, np.zeros(D.shape[0])
            # only the largest can break the path, and each costs a solution
            largest = np.argsort(np.abs(found) / smooth[axis].difference)[-_LARGEST:]
            columns = np.zeros((len(at.theta), len(largest)))
            columns[first : first + part.basis.count] = D[largest].T.toarray()
            taken[largest] = np.sum(columns * at.root.solve(columns), axis=0)
            judged = np.zeros(len(found))
            judged[largest] = found[largest]
            smooth[axis] = smooth[axis].loosened(judged, taken)
        return replace(part, smoothness=tuple(smooth))

    def scores(self, change: FloatArray, covariance: FloatArray, block_s: float) -> "BlockScores":
        """Return the score of each block of time, and its covariance by noise alone.

        The covariance (p, p) is that of a fit whose noise is as assumed. A path that yields in one block yields in its
        neighbour, too: blocks are negatively correlated, and only the expectation shows an excess.
        """
        at = self._solve(change)
        linear = at.linear
        times = np.concatenate([seen.reference_s[self.kept[name]] for name, seen in linear.predicted.items()])
        _, block = np.unique(np.floor((times - times.min()) / block_s), return_inverse=True)
        block = np.repeat(block, 2)
        count, p = int(block.max()) + 1, len(change)
        projected = self.linearise(change).jacobian[: len(linear.residual)]
        seen, expected = np.zeros((count, p)), np.zeros((count, p, p))
        rows = [np.flatnonzero(block == k) for k in range(count)]
        windows = [np.unique(linear.by_path[own].indices).astype(np.int64) for own in rows]
        inverse = WindowedInverse(self._normal_at(linear), self._coefficient_times(linear), windows)
        banded = inverse.width**2 < _BAND_WORTH * count * p
        for k, (own, window) in enumerate(zip(rows, windows, strict=True)):
            J, A = linear.by_change[own], linear.by_path[own]
            seen[k] = J.T @ linear.residual[own]
            cross = J.T @ projected[own]
            if banded:
                of_paths = np.asarray(A[:, window].T @ J)
                taken = of_paths.T @ inverse.window(window) @ of_paths
            else:
                of_paths = np.asarray(A.T @ J)
                taken = of_paths.T @ at.root.solve(of_paths)
            expected[k] = J.T @ J - taken - cross @ covariance @ cross.T
        return BlockScores(seen=seen, expected=expected)

    def _coefficient_times(self, linear: _Linear) -> FloatArray:
        """Return when each coefficient acts most (K,), s of the reference's clock."""
        times = np.zeros(len(self._alone))
        for part in self.parts:
            later = 0.0
            if part.station is not None:
                seen, kept = linear.predicted[part.station], self.kept[part.station]
                later = float(np.median((seen.reference_s - seen.reading_s)[kept]))
            times[part.first : part.first + part.size] = part.centres_s + later
        return times

    def _along(self, theta: FloatArray) -> FlightProblem:
        """Return the problem with the paths of these coefficients."""
        tracks, rates = [], []
        curves: dict[str, list[AngleCurve]] = {name: [] for name in self.problem.observations}
        for part in self.parts:
            found = [part.basis.spline(c) for c in part.coefficients(theta)]
            if part.station is None:
                tracks.append(found)
                rates.append([part.basis.rate(spline) for spline in found] if part.lasting is not None else None)
            else:
                pan, tilt = (part.basis.spline(c / MILLI) for c in part.coefficients(theta))
                curves[part.station].append(
                    AngleCurve(from_s=part.basis.from_s, to_s=part.basis.to_s, axes=(pan, tilt))
                )
        observations = {
            name: replace(seen, curves=tuple(curves[name])) for name, seen in self.problem.observations.items()
        }
        return replace(self.problem, observations=observations, track=self.problem.track.along(tracks, rates))

    def _solve(self, change: FloatArray) -> _Solved:
        if self._last is not None and change.tobytes() == self._done:
            return self._last
        theta = self._alone
        for _ in range(_FAR_ROUNDS if self.has_lasting_error else _ROUNDS):
            linear = self._linearised(theta, change)
            root = _factors(self._normal_at(linear))
            aim = linear.by_path.T @ (linear.by_path @ theta - linear.residual) + self._pull
            theta = np.asarray(root.solve(aim))
        linear = self._linearised(theta, change)
        self._last, self._done = (
            _Solved(theta=theta, linear=linear, root=_factors(self._normal_at(linear))),
            change.tobytes(),
        )
        return self._last

    def _normal_at(self, linear: _Linear) -> csc_matrix:
        """Return the normal matrix (K, K) of the coefficients: samples, smoothness and pixels."""
        return self._normal + (linear.by_path.T @ linear.by_path).tocsc()

    def _linearised(self, theta: FloatArray, change: FloatArray) -> _Linear:
        along = self._along(theta)
        predicted, residuals, by_path, by_change = {}, [], [], []
        for name, observed in along.observations.items():
            seen, kept = along.predict(name, change), self.kept[name]
            predicted[name] = seen
            # an observation that lost its reference meanwhile has no weight
            white = self._white[name] * seen.usable[kept][:, None, None]
            off = (seen.pixel_px - observed.pixel_px)[kept]
            residuals.append(np.einsum("nij,nj->ni", white, off).ravel())
            by_change.append((white @ seen.jacobian[kept]).reshape(-1, len(change)))
            by_path.append(self._by_paths(name, seen, kept, white))
        return _Linear(
            predicted=predicted,
            residual=np.concatenate(residuals),
            by_path=vstack(by_path, format="csr"),
            by_change=np.concatenate(by_change),
        )

    def _by_paths(self, name: str, seen: PixelPredictions, kept: MaskArray, white: FloatArray) -> csr_matrix:
        """Return the derivatives (2n, K) of a station's whitened pixels by the coefficients of all paths.

        A fixes' lasting error has none: it is the fixes', not the aircraft's.
        """
        reference_s, reading_s = seen.reference_s[kept], seen.reading_s[kept]
        design = self._designs.get(name)
        if design is None or not design.is_for(reference_s, reading_s):
            design = path_design(self.parts, name, reference_s, reading_s, len(self._alone))
            self._designs[name] = design
        return design.matrix(white @ seen.by_point_px_m[kept], white @ seen.by_angle_px_rad[kept] / MILLI)


def _factors(normal: csc_matrix) -> SuperLU:
    """Return the factors of a positive definite matrix, which needs no pivots.

    Ordered as a symmetric one it has a sixth of the time of an ordering by columns: 3 ms for 18 ms, a landing by a
    receiver without corrections (2026-11).
    """
    return splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
