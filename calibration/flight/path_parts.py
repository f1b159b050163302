"""The paths of a flight: the antenna's between gaps of its fixes and the heads', and how smooth each of them is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import block_diag, csr_matrix, diags, vstack

from calibration.flight.problem import SLOW_S, FlightProblem
from calibration.flight.smooth_path import PathBasis, Smoothness, find_smoothness, path_basis
from groundstation.arrays import FloatArray

# knots of a head are this number of readings apart, or this long where readings are slow: the motion between two of
# them is unknown, but not smoother for that
_READINGS_EACH_KNOT = 2.0
_SLOW_KNOT_S = 0.04
# heads in mrad, the antenna in m: numbers of one size
MILLI = 1e3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathPart:
    """One stretch of one path with d axes: the antenna's (``station`` None, m) or a head's (rad, in mrad inside).

    ``t_s`` (n,), ``samples`` (n, d), ``sigma`` (n, d); ``first`` is where its d · K coefficients begin, axis by axis.
    """

    station: str | None
    basis: PathBasis
    t_s: FloatArray
    samples: FloatArray
    sigma: FloatArray
    smoothness: tuple[Smoothness, ...]
    first: int

    @property
    def size(self) -> int:
        """d · K."""
        return self.basis.count * self.samples.shape[1]

    def known(self) -> tuple[csr_matrix, FloatArray]:
        """Return design and data of samples and smoothness, in sigmas."""
        design = self.basis.at(self.t_s)
        rows, data = [], []
        for axis, smooth in enumerate(self.smoothness):
            weight = 1.0 / (self.sigma[:, axis] * smooth.noise_factor)
            differences = self.basis.differences(smooth.order)
            rows.append(vstack([design.multiply(weight[:, None]), diags(1.0 / smooth.difference) @ differences]))
            data += [self.samples[:, axis] * weight, np.zeros(differences.shape[0])]
        return block_diag(rows, format="csr"), np.concatenate(data)

    def coefficients(self, theta: FloatArray) -> FloatArray:
        """Return (d, K) of all coefficients."""
        return theta[self.first : self.first + self.size].reshape(-1, self.basis.count)


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
        axes = zip(own.samples.T, own.sigma.T, strict=True)
        before = next((part for part in known if own.same_as(part)), None)
        if before is not None:
            parts.append(replace(before, first=first))
            first += before.size
            continue
        parts.append(
            PathPart(
                station=own.station,
                basis=basis,
                t_s=t,
                samples=own.samples,
                sigma=own.sigma,
                smoothness=tuple(find_smoothness(basis, t, samples, sigma) for samples, sigma in axes),
                first=first,
            )
        )
        first += parts[-1].size
    return tuple(parts)
