"""The paths of a flight: the antenna's between gaps of its fixes and the heads', and how smooth each of them is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import block_diag, csr_matrix, diags, hstack, vstack

from calibration.flight.lasting_error import LastingError, lasting_error, may_last
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
        prior = block_diag([self.lasting.prior(axis) for axis in range(len(weights))])
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
        error = self.lasting
        return own if error is None else np.concatenate([own, np.tile(error.knots_s, len(error.sigma_m))])


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
    parts: list[PathPart] = []
    first = 0
    for own in path_samples(problem):
        t = own.t_s
        basis = path_basis(float(t[0]), float(t[-1]), own.step_s)
        before = next((part for part in known if own.same_as(part)), None)
        if before is not None:
            parts.append(replace(before, first=first))
            first += before.size
            continue
        parts.append(_path_part(own, basis, first))
        first += parts[-1].size
    return tuple(parts)


def _path_part(own: PathSamples, basis: PathBasis, first: int) -> PathPart:
    """Return the path of samples, and the lasting error of an antenna's."""
    usual = np.sqrt(np.mean(own.sigma**2, axis=0))
    shown: list[Smoothness | None] = [None] * len(usual)
    lasting = None
    if own.station is None and may_last(usual):
        # by the noise that neighbouring fixes show, whatever is stated; such fixes do not tell the orders apart, and
        # the smoother one leaves the pixels no path that fits
        free = [
            find_smoothness(basis, own.t_s, samples, np.full(len(samples), _UNSTATED * stated), ORDERS[-1:])
            for samples, stated in zip(own.samples.T, usual, strict=True)
        ]
        white = np.array([_UNSTATED * stated * s.noise_factor for s, stated in zip(free, usual, strict=True)])
        lasting = lasting_error(own.t_s, usual, white, len(own.t_s) - max(ORDERS))
        if lasting is not None:
            shown = [s if sigma > 0.0 else None for s, sigma in zip(free, lasting.sigma_m, strict=True)]
    smoothness = [
        find_smoothness(basis, own.t_s, samples, sigma)
        if known is None
        else _without_breaks(known, _UNSTATED * known.noise_factor)
        for known, samples, sigma in zip(shown, own.samples.T, own.sigma.T, strict=True)
    ]
    return PathPart(
        station=own.station,
        basis=basis,
        t_s=own.t_s,
        samples=own.samples,
        sigma=own.sigma,
        smoothness=tuple(smoothness),
        first=first,
        lasting=lasting,
    )


def _without_breaks(smooth: Smoothness, noise_factor: float) -> Smoothness:
    """Return an equally smooth path without breaks: fixes that are off by metres place none.

    One that pixels place would hold the log's clock where it was when they did.
    """
    usual = np.full(len(smooth.difference), np.median(smooth.difference))
    return replace(smooth, difference=usual, noise_factor=noise_factor)
