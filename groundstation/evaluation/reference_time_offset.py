"""The offset between the reference's clock and the session's: t_reference = t_session + offset.

Model: position_i = reference(t_i + offset) + L_i·κ + c + e_i, with e_i's covariance that of the estimate and of
the reference together. κ (3) is a constant bias in sigmas of one fix (L_i: Cholesky factor, along y first): a
mounting error or a nose seen off in one camera, whose effect along the track grows with the square of the range.
c (3) is a constant bias in m: an offset of the target point from the nose or of the antenna. Without them both would
bias the offset (3 cm of height are 30 ms in a descent of 1 m/s). The offset is first searched on a grid with a
bounded loss, so that bad reference data (which does not agree on one offset) cannot carry it away, then refined
by Huber-weighted Gauss-Newton steps together with κ and c, which have priors.

Errors are correlated from epoch to epoch (a filter's always), so the inverse of the information would promise too
much: the variance is inflated by what the scores themselves show (`_correlated_variance`). What no inflation
covers: a systematic error along the track of another shape than the two biases.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.position_series import (
    BoolArray,
    IndexArray,
    PositionSeries,
    ReferenceSeries,
    interpolate_positions,
    smooth_velocity,
)

_GRID_STEP_S = 0.02
_GRID_SAMPLES = 3000
_BOUND = 16.0
_REJECT_SIGMA = 6.0
_MIN_SAMPLES = 8
_BLOCKS = 8
_MIN_OVERLAP = 0.5
# how far the target point may be from the nose, all along a session (1 sigma)
TARGET_BIAS_M = 0.05
_NEWTON_STEPS = 40
_CONVERGED_S = 1e-6
_MIN_INFORMATION = 1e-2
# what interpolation and the stamps' own digits leave, whatever the number of epochs
_MIN_SIGMA_S = 5e-4
_VELOCITY_WINDOW_S = 0.5
# the matrices of so many epochs are laid out at once: those of an hour take 60 MB
_BLOCK_ROWS = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeOffset:
    """An offset found: t_reference = t_session + ``offset_s`` ± ``sigma_s`` (1 sigma).

    ``inflation`` is how much the variance was raised for correlated or larger-than-stated errors,
    ``samples`` the epochs used, ``misfit`` the median squared Mahalanobis distance left (2.4 is ideal),
    ``bias`` the constant biases estimated jointly: κ along y, x, z in sigmas of one fix, then c, x, y, z in m.
    """

    offset_s: float
    sigma_s: float
    inflation: float
    samples: int
    misfit: float
    bias: tuple[float, ...] = (0.0,) * 6


@dataclass(frozen=True, slots=True, kw_only=True)
class NoOffset:
    """No offset could be found, and why."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeAlignment:
    """Estimates against the reference at one offset, for the m epochs that have both.

    ``index`` (m,) is the epoch in the series, ``error_m`` (m, 3) estimate minus reference, ``information``
    (m, 3, 3) the inverse of its covariance, ``velocity_m_s`` (m, 3) the reference's, ``factor_m`` (m, 3, 3) the
    errors that one unit of κ makes, of y, x, z.
    """

    index: IndexArray
    error_m: FloatArray
    information: FloatArray
    velocity_m_s: FloatArray
    factor_m: FloatArray

    @property
    def bias_shape_m(self) -> FloatArray:
        """Errors (m, 3, 6) that biases of one unit make: κ of y, x, z, then c."""
        constant = np.broadcast_to(np.eye(3), self.factor_m.shape)
        return np.concatenate([self.factor_m, constant], axis=2)

    @property
    def lag_information(self) -> FloatArray:
        """Information (m,) of each epoch on the offset, in 1/s²."""
        return np.einsum("ni,nij,nj->n", self.velocity_m_s, self.information, self.velocity_m_s)

    @property
    def lag_score(self) -> FloatArray:
        """Score (m,): information times the offset still missing, as each epoch sees it, in 1/s."""
        return np.einsum("ni,nij,nj->n", self.velocity_m_s, self.information, self.error_m)

    @property
    def distance2(self) -> FloatArray:
        """Squared Mahalanobis distance (m,) of the errors."""
        return np.einsum("ni,nij,nj->n", self.error_m, self.information, self.error_m)

    @property
    def design(self) -> FloatArray:
        """Derivative (m, 3, 7) of the error by the offset still missing and by the biases."""
        return np.concatenate([self.velocity_m_s[:, :, None], self.bias_shape_m], axis=2)

    def without_bias(self, bias: FloatArray) -> "TimeAlignment":
        """Return the alignment with the errors of the biases (6,) taken off."""
        return replace(self, error_m=self.error_m - self.bias_shape_m @ bias)


class ReferenceAligner:
    """Lays a series of estimates over a reference at any offset; keeps what does not depend on the offset."""

    def __init__(self, series: PositionSeries, reference: ReferenceSeries, max_gap_s: float) -> None:
        self.series = series
        self.reference = reference
        self.max_gap_s = max_gap_s
        noise = np.median(reference.sigma_m, axis=0) if len(reference) else np.ones(3)
        self._information = np.empty_like(series.covariance_m2)
        self._factor = np.empty_like(series.covariance_m2)
        for rows in _blocks(len(series)):
            covariance = series.covariance_m2[rows] + np.diag(noise**2)
            self._information[rows] = np.linalg.inv(covariance)
            self._factor[rows] = _factor_y_first(covariance)
        slopes = smooth_velocity(reference.t_s, reference.position_m, _VELOCITY_WINDOW_S)
        self._slopes = ReferenceSeries(t_s=reference.t_s, position_m=slopes, sigma_m=reference.sigma_m)

    def at(self, offset_s: float, excluded: BoolArray | None = None, every: int = 1) -> TimeAlignment:
        """Return the alignment at one offset, without the ``excluded`` (n,) epochs, of each ``every``-th one."""
        return self._of(slice(0, len(self.series), every), offset_s, excluded)

    def parts(self, offset_s: float, excluded: BoolArray | None = None) -> Iterator[TimeAlignment]:
        """Yield the alignment at one offset in parts of `_BLOCK_ROWS` epochs, in their order."""
        for rows in _blocks(len(self.series)):
            yield self._of(rows, offset_s, excluded)

    def _of(self, rows: slice, offset_s: float, excluded: BoolArray | None) -> TimeAlignment:
        t_s = self.series.t_s[rows]
        position, usable = interpolate_positions(self.reference, t_s + offset_s, self.max_gap_s)
        good = usable if excluded is None else usable & ~excluded[rows]
        index = np.flatnonzero(good)
        slope, _ = interpolate_positions(self._slopes, t_s[index] + offset_s, self.max_gap_s)
        return TimeAlignment(
            index=rows.start + index * (rows.step or 1),
            error_m=self.series.position_m[rows][index] - position[index],
            information=self._information[rows][index],
            velocity_m_s=slope,
            factor_m=self._factor[rows][index],
        )


def _blocks(count: int) -> Iterator[slice]:
    """Yield slices of ``count`` rows, at least one, in order."""
    for first in range(0, max(count, 1), _BLOCK_ROWS):
        yield slice(first, min(first + _BLOCK_ROWS, count))


def _factor_y_first(covariance_m2: FloatArray) -> FloatArray:
    """Return L (n, 3, 3) with L·Lᵀ = covariance, its columns along y, x, z in this order of elimination."""
    order = np.array([1, 0, 2])
    factor = np.linalg.cholesky(covariance_m2[:, order][:, :, order])
    back = np.argsort(order)
    return np.asarray(factor[:, back, :], dtype=np.float64)


def estimate_offset(
    aligner: ReferenceAligner,
    *,
    max_offset_s: float,
    huber_sigma: float,
    bias_sigmas: float,
    excluded: BoolArray | None = None,
    start_s: float | None = None,
) -> TimeOffset | NoOffset:
    """Find the offset within ± ``max_offset_s``, or near ``start_s`` if given, without the ``excluded`` (n,) epochs.

    ``bias_sigmas`` is the prior sigma of each component of κ.
    """
    offset = _search(aligner, max_offset_s, excluded) if start_s is None else start_s
    if offset is None:
        return NoOffset(reason="track and reference share too few epochs")
    bias: FloatArray = np.zeros(6)
    prior = np.diag([0.0, *[bias_sigmas**-2] * 3, *[TARGET_BIAS_M**-2] * 3])
    for _ in range(_NEWTON_STEPS):
        normal = _normal(aligner.parts(offset, excluded), bias, huber_sigma)
        if normal.used < _MIN_SAMPLES:
            return NoOffset(reason="track and reference agree at too few epochs")
        if normal.lag_information <= _MIN_INFORMATION:
            return NoOffset(reason="the aircraft does not move enough to show an offset")
        solution = np.linalg.solve(normal.information + prior, normal.score)
        step, bias = float(solution[0]), np.asarray(solution[1:], dtype=np.float64)
        offset += float(np.clip(step, -_GRID_STEP_S, _GRID_STEP_S))
        if abs(step) < _CONVERGED_S:
            break
    return _described(aligner, excluded, offset, bias, prior, huber_sigma)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _OffsetNormalEquations:
    """The weighted normal equations of offset and biases: information (7, 7), score (7,), and of how many epochs.

    ``lag_information`` is that on the offset alone, in 1/s².
    """

    information: FloatArray
    score: FloatArray
    used: int
    lag_information: float


def _normal(parts: Iterable[TimeAlignment], bias: FloatArray, huber_sigma: float) -> _OffsetNormalEquations:
    """Sum the normal equations over the parts of an alignment, weighted by the errors left by the biases (6,)."""
    information, score, used, lag = np.zeros((7, 7)), np.zeros(7), 0, 0.0
    for a in parts:
        weight = _weights(a.without_bias(bias).distance2, huber_sigma)
        weighted = a.design.transpose(0, 2, 1) @ (weight[:, None, None] * a.information)
        information += (weighted @ a.design).sum(axis=0)
        score += np.einsum("nij,nj->i", weighted, a.error_m)
        used += int(np.count_nonzero(weight))
        lag += float(weight @ a.lag_information)
    return _OffsetNormalEquations(information=information, score=score, used=used, lag_information=lag)


def _described(
    aligner: ReferenceAligner,
    excluded: BoolArray | None,
    offset_s: float,
    bias: FloatArray,
    prior: FloatArray,
    huber_sigma: float,
) -> TimeOffset | NoOffset:
    """Return the offset with its honest sigma."""
    normal = _normal(aligner.parts(offset_s, excluded), bias, huber_sigma)
    information = normal.information + prior
    if normal.used < _MIN_SAMPLES or information[0, 0] <= _MIN_INFORMATION:
        return NoOffset(reason="track and reference agree at too few epochs")
    covariance = np.linalg.inv(information)
    moves, distances = [], []
    for a in aligner.parts(offset_s, excluded):
        clean = a.without_bias(bias)
        distances.append(clean.distance2)
        weighted = a.design.transpose(0, 2, 1) @ (_weights(clean.distance2, huber_sigma)[:, None, None] * a.information)
        # what each epoch moved the offset by; their sum's variance is the offset's
        moves.append(np.einsum("i,nij,nj->n", covariance[0], weighted, clean.error_m))
    expected = float(covariance[0] @ normal.information @ covariance[0])
    inflation = max(1.0, _correlated_variance(np.concatenate(moves)) / max(expected, 1e-300))
    return TimeOffset(
        offset_s=offset_s,
        sigma_s=float(np.hypot(np.sqrt(inflation * covariance[0, 0]), _MIN_SIGMA_S)),
        inflation=inflation,
        samples=normal.used,
        misfit=float(np.median(np.concatenate(distances))),
        bias=tuple(float(b) for b in bias),
    )


def _search(aligner: ReferenceAligner, max_offset_s: float, excluded: BoolArray | None) -> float | None:
    """Return the grid offset at which most estimates agree with the reference: least mean bounded loss."""
    every = max(1, len(aligner.series) // _GRID_SAMPLES)
    steps = round(max_offset_s / _GRID_STEP_S)
    offsets = _GRID_STEP_S * np.arange(-steps, steps + 1)
    gains, counts = np.zeros(len(offsets)), np.zeros(len(offsets))
    for k, offset in enumerate(offsets):
        d2 = aligner.at(float(offset), excluded, every).distance2
        counts[k] = len(d2)
        # agreement counted, not disagreement: data that the offset moves out of reach is no gain
        gains[k] = float((_BOUND - np.minimum(d2, _BOUND)).sum())
    enough = counts >= max(_MIN_SAMPLES, _MIN_OVERLAP * counts.max())
    if not enough.any():
        return None
    # per epoch in common, so that an offset is not preferred for its longer overlap
    return float(offsets[int(np.argmax(np.where(enough, gains / np.maximum(counts, 1), -1.0)))])


def _weights(distance2: FloatArray, huber_sigma: float) -> FloatArray:
    """Return Huber weights (m,) of three-dimensional residuals, zero beyond the rejection distance."""
    distance = np.sqrt(distance2)
    limit = huber_sigma * np.sqrt(3.0)
    weight = np.minimum(1.0, limit / np.maximum(distance, 1e-12))
    return np.where(distance > _REJECT_SIGMA * np.sqrt(3.0), 0.0, weight)


def _correlated_variance(scores: FloatArray) -> float:
    """Return the variance of the sum of correlated zero-mean scores (m,), from the scores themselves.

    The larger of two estimates: from their autocorrelation up to its first non-positive term (short memory), and
    from the sums over `_BLOCKS` stretches of the session (slow drifts, which the former misses under much noise).
    """
    n = len(scores)
    centred = scores - scores.mean()
    total = float(centred @ centred)
    for lag in range(1, n // 2):
        term = float(centred[:-lag] @ centred[lag:])
        if term <= 0:
            break
        total += 2.0 * term
    blocks = np.array([part.sum() for part in np.array_split(centred, _BLOCKS)])
    # the mean was taken off, so one of the blocks' sums is not free
    slow = float(blocks @ blocks) * _BLOCKS / (_BLOCKS - 1)
    return max(total, slow if n >= _BLOCKS * _MIN_SAMPLES else 0.0)
