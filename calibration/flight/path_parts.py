"""The paths of a flight: the antenna's between gaps of its fixes and the heads', and how smooth each of them is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import block_diag, csr_matrix, diags, hstack, vstack

from calibration.flight.lasting_error import LastingError, lasting_error, lasting_sigma, may_last
from calibration.flight.problem import SLOW_S, FlightProblem
from calibration.flight.smooth_path import ORDERS, PathBasis, Smoothness, find_smoothness, path_basis
from groundstation.arrays import FloatArray

# knots of a head are this number of readings apart, or this long where readings are slow: the motion between two of
# them is unknown, but not smoother for that
_READINGS_EACH_KNOT = 2.0
_SLOW_KNOT_S = 0.04
# heads in mrad, the antenna in m: numbers of one size
MILLI = 1e3
# of the stated sigma, from which the noise that fixes show is sought
_UNSTATED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathPart:
    """One stretch of one path with d axes: the antenna's (``station`` None, m) or a head's (rad, in mrad inside).

    ``t_s`` (n,), ``samples`` (n, d), ``sigma`` (n, d); ``first`` is where its d · K coefficients begin, axis by axis;
    those of an error of the samples that ``lasting`` follow.
    """

    station: str | None
    basis: PathBasis
    t_s: FloatArray
    samples: FloatArray
    sigma: FloatArray
    smoothness: tuple[Smoothness, ...]
    first: int
    lasting: LastingError | None = None

    @property
    def size(self) -> int:
        """Number of coefficients: d · K, and those of the lasting error."""
        return self._own_size + (0 if self.lasting is None else self.lasting.size)

    @property
    def _own_size(self) -> int:
        return self.basis.count * self.samples.shape[1]

    def known(self) -> tuple[csr_matrix, FloatArray]:
        """Return design and data of samples and smoothness, in sigmas."""
        design = self.basis.at(self.t_s)
        rows, data, weights = [], [], []
        for axis, smooth in enumerate(self.smoothness):
            weight = 1.0 / (self.sigma[:, axis] * smooth.noise_factor)
            differences = self.basis.differences(smooth.order)
            rows.append(vstack([design.multiply(weight[:, None]), diags(1.0 / smooth.difference) @ differences]))
            data += [self.samples[:, axis] * weight, np.zeros(differences.shape[0])]
            weights.append(vstack([diags(weight), csr_matrix((differences.shape[0], len(weight)))]))
        known = block_diag(rows, format="csr")
        if self.lasting is None:
            return known, np.concatenate(data)
        by_error = self.lasting.at(self.t_s)
        shifted = block_diag([weight @ by_error for weight in weights])
        prior = self.lasting.prior()
        below = hstack([csr_matrix((prior.shape[0], known.shape[1])), prior])
        both = vstack([hstack([known, shifted]), below], format="csr")
        return both, np.concatenate([*data, np.zeros(prior.shape[0])])

    def coefficients(self, theta: FloatArray) -> FloatArray:
        """Return (d, K) of all coefficients."""
        return theta[self.first : self.first + self._own_size].reshape(-1, self.basis.count)

    @property
    def centres_s(self) -> FloatArray:
        """When each coefficient acts most (size,), s."""
        own = np.tile(self.basis.centres_s, self.samples.shape[1])
        return own if self.lasting is None else np.concatenate([own, self.lasting.centres_s])

    @property
    def lasting_first(self) -> int:
        """Where the coefficients of the lasting error begin."""
        return self.first + self._own_size

    def lasting_coefficients(self, theta: FloatArray) -> FloatArray:
        """Return (d, 1 + m) of all coefficients: the lasting error's constant and knots."""
        if self.lasting is None:
            return np.zeros((self.samples.shape[1], 0))
        return theta[self.lasting_first : self.first + self.size].reshape(-1, self.lasting.each)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathSamples:
    """Samples of one stretch of a path, as in `PathPart`, and the time between knots."""

    station: str | None
    t_s: FloatArray
    samples: FloatArray
    sigma: FloatArray
    step_s: float

    def same_as(self, part: PathPart) -> bool:
        """Return whether a part was found from these samples."""
        arrays = ((self.t_s, part.t_s), (self.samples, part.samples), (self.sigma, part.sigma))
        return self.station == part.station and all(np.array_equal(own, others) for own, others in arrays)


def path_samples(problem: FlightProblem) -> list[PathSamples]:
    """Return the samples of the antenna between gaps of the fixes, and of each head where it has a curve."""
    step_s = problem.track.step_s
    found = [
        PathSamples(station=None, t_s=fixes.t_s, samples=fixes.position_m, sigma=fixes.sigma_m, step_s=step_s)
        for fixes in problem.track.stretches
    ]
    for name, observed in problem.observations.items():
        sigma = problem.stations[name].angle_sigma_rad
        for curve in problem.curves(name) if sigma > 0 else ():
            inside = (observed.readings_s >= curve.from_s) & (observed.readings_s <= curve.to_s)
            t, angles = observed.readings_s[inside], observed.readings_rad[inside]
            found.append(
                PathSamples(
                    station=name,
                    t_s=t,
                    samples=MILLI * angles,
                    sigma=np.full(angles.shape, MILLI * sigma),
                    step_s=_head_step_s(t),
                )
            )
    return found


def _head_step_s(readings_s: FloatArray) -> float:
    usual = float(np.median(np.diff(readings_s)))
    return _SLOW_KNOT_S if usual > SLOW_S else _READINGS_EACH_KNOT * usual


def path_parts(problem: FlightProblem, known: Sequence[PathPart] = ()) -> tuple[PathPart, ...]:
    """Return the paths of a flight, as smooth as their samples; ``known`` ones of the same samples are reused."""
    samples = path_samples(problem)
    reused = [next((part for part in known if own.same_as(part)), None) for own in samples]
    bases = [path_basis(float(own.t_s[0]), float(own.t_s[-1]), own.step_s) for own in samples]
    new = [own if before is None else None for own, before in zip(samples, reused, strict=True)]
    noise = _reference_noise(new, bases)
    parts: list[PathPart] = []
    first = 0
    for own, basis, free, found in zip(samples, bases, noise.free, reused, strict=True):
        if found is not None:
            parts.append(replace(found, first=first))
            first += found.size
            continue
        lasting = None
        if own.station is None and noise.lasts:
            before = any(part.lasting is not None for part in parts)
            lasting = lasting_error(own.t_s, noise.sigma_m, noise.white_m, continues=before)
        parts.append(
            PathPart(
                station=own.station,
                basis=basis,
                t_s=own.t_s,
                samples=own.samples,
                sigma=own.sigma,
                smoothness=_smoothness(own, basis, free, noise),
                first=first,
                lasting=lasting,
            )
        )
        first += parts[-1].size
    return tuple(parts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ReferenceNoise:
    """What the fixes of all stretches show: one sigma (d,) usually stated, of each for itself, and of what lasts.

    ``free`` is the smoothness of each path by the noise that neighbours show, for the antenna's stretches.
    """

    usual_m: FloatArray
    white_m: FloatArray
    sigma_m: FloatArray
    free: list[list[Smoothness]]

    @property
    def lasts(self) -> bool:
        """Whether an axis has an error that lasts."""
        return bool(np.any(self.sigma_m > 0.0))


def _reference_noise(samples: list[PathSamples | None], bases: list[PathBasis]) -> _ReferenceNoise:
    """Return what the fixes of all stretches show; None among the samples is a path that is known."""
    fixes = [own for own in samples if own is not None and own.station is None]
    free: list[list[Smoothness]] = [[] for _ in samples]
    usual = np.median(np.concatenate([own.sigma for own in fixes]), axis=0) if fixes else np.zeros(3)
    if not fixes or not may_last(usual):
        return _ReferenceNoise(usual_m=usual, white_m=usual, sigma_m=np.zeros(len(usual)), free=free)
    squares, freedom = np.zeros(len(usual)), 0
    for k, (own, basis) in enumerate(zip(samples, bases, strict=True)):
        if own is None or own.station is not None:
            continue
        # by the noise that neighbouring fixes show, whatever is stated; such fixes do not tell the orders apart, and
        # the smoother one leaves the pixels no path that fits
        free[k] = [
            find_smoothness(basis, own.t_s, values, np.full(len(values), _UNSTATED * stated), ORDERS[-1:])
            for values, stated in zip(own.samples.T, usual, strict=True)
        ]
        own_freedom = max(len(own.t_s) - max(ORDERS), 0)
        squares += own_freedom * (_UNSTATED * usual * np.array([s.noise_factor for s in free[k]])) ** 2
        freedom += own_freedom
    white = np.sqrt(squares / max(freedom, 1))
    sigma = lasting_sigma(usual, white, freedom)
    return _ReferenceNoise(usual_m=usual, white_m=white, sigma_m=sigma, free=free)


def _smoothness(
    own: PathSamples, basis: PathBasis, free: list[Smoothness], noise: _ReferenceNoise
) -> tuple[Smoothness, ...]:
    """Return how smooth each axis of a path is, and the noise of its samples over that stated."""
    found = []
    for axis, (values, sigma) in enumerate(zip(own.samples.T, own.sigma.T, strict=True)):
        if free and noise.sigma_m[axis] > 0.0:
            found.append(_without_breaks(free[axis], float(noise.white_m[axis] / noise.usual_m[axis])))
        else:
            found.append(find_smoothness(basis, own.t_s, values, sigma))
    return tuple(found)


def _without_breaks(smooth: Smoothness, noise_factor: float) -> Smoothness:
    """Return an equally smooth path without breaks: fixes that are off by metres place none.

    One that pixels place would hold the log's clock where it was when they did.
    """
    usual = np.full(len(smooth.difference), np.median(smooth.difference))
    return replace(smooth, difference=usual, noise_factor=noise_factor)
