"""Spans in which the DGPS reference lags: its time offset estimated in sliding windows.

A receiver may report old positions for a while, for instance after a freeze. In each window the offset relative to the
offset of the whole session is estimated by weighted least squares from the scores and informations of the epochs.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.position_series import BoolArray, IndexArray
from groundstation.evaluation.reference_exclusion import ExcludedSpan, ExclusionReason
from groundstation.evaluation.reference_time_offset import ReferenceAligner, TimeAlignment, TimeOffset

_MIN_WINDOW_SAMPLES = 3
_AGREEMENT_SIGMA = 3.0
_MIN_EXPLAINED = 0.85


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalOffsets:
    """The offset relative to the session's, in windows centred on epochs ``t_s`` (m,): ``lag_s`` ± ``sigma_s`` (m,).

    ``across_lag_s`` ± ``across_sigma_s`` is the same from x and z alone; ``explained`` (m,) is the share of the
    window's squared error, in sigmas, that a lag growing linearly takes away.
    """

    t_s: FloatArray
    lag_s: FloatArray
    sigma_s: FloatArray
    across_lag_s: FloatArray
    across_sigma_s: FloatArray
    explained: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _EpochScores:
    """Score and information on the offset of each epoch of a span, (m,) each; ``distance2`` in sigmas²."""

    t_s: FloatArray
    distance2: FloatArray
    score: FloatArray
    information: FloatArray
    across_score: FloatArray
    across_information: FloatArray


def local_offsets(aligner: ReferenceAligner, offset: TimeOffset, window_s: float, stretch: BoolArray) -> LocalOffsets:
    """Estimate the offset relative to ``offset`` in windows of the epochs in ``stretch`` (n,)."""
    scores = _epoch_scores(aligner, offset, stretch)
    t = scores.t_s
    lo = np.searchsorted(t, t - window_s / 2, side="left")
    hi = np.searchsorted(t, t + window_s / 2, side="right")
    lag, sigma = _windowed(scores.score, scores.information, lo, hi, offset.inflation)
    across_lag, across_sigma = _windowed(scores.across_score, scores.across_information, lo, hi, offset.inflation)
    return LocalOffsets(
        t_s=t,
        lag_s=lag,
        sigma_s=sigma,
        across_lag_s=across_lag,
        across_sigma_s=across_sigma,
        explained=_explained(scores, lo, hi),
    )


def _epoch_scores(aligner: ReferenceAligner, offset: TimeOffset, stretch: BoolArray) -> _EpochScores:
    """Return the scores of the epochs in ``stretch`` (n,)."""
    rows = []
    for part in aligner.parts(offset.offset_s, ~stretch):
        a = part.without_bias(np.array(offset.bias))
        across = _without_y(a)
        rows.append(
            (
                aligner.series.t_s[a.index],
                a.distance2,
                a.lag_score,
                a.lag_information,
                across.lag_score,
                across.lag_information,
            )
        )
    t, distance2, score, information, across_score, across_information = map(np.concatenate, zip(*rows, strict=True))
    return _EpochScores(
        t_s=t,
        distance2=distance2,
        score=score,
        information=information,
        across_score=across_score,
        across_information=across_information,
    )


def _explained(scores: _EpochScores, lo: IndexArray, hi: IndexArray) -> FloatArray:
    """Return the share (m,) of the squared Mahalanobis distance in each window that lag = c₀ + c₁·t takes away."""
    score, information = scores.score, scores.information
    t = scores.t_s - scores.t_s[0] if len(scores.t_s) else scores.t_s
    terms = [scores.distance2, score, t * score, information, t * information, t * t * information]
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in terms]
    total, a0, a1, b0, b1, b2 = (s[hi] - s[lo] for s in sums)
    # centred on the information's own mean time, the two parameters are independent
    middle = b1 / np.maximum(b0, 1e-12)
    spread = np.maximum(b2 - middle * b1, 1e-9)
    gain = a0**2 / np.maximum(b0, 1e-12) + (a1 - middle * a0) ** 2 / spread
    return gain / np.maximum(total, 1e-12)


def _without_y(a: TimeAlignment) -> TimeAlignment:
    """Return the alignment by x and z alone: their own 2 × 2 covariance, without information on y."""
    covariance = np.linalg.inv(a.information)
    kept = np.ix_(range(len(covariance)), [0, 2], [0, 2])
    information = np.zeros_like(covariance)
    information[kept] = np.linalg.inv(covariance[kept])
    return replace(a, information=information)


def _windowed(
    score: FloatArray, information: FloatArray, lo: IndexArray, hi: IndexArray, inflation: float
) -> tuple[FloatArray, FloatArray]:
    """Return lag and sigma by window from summed scores and information; sigma is infinite without information."""
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (score, information)]
    total_score, total = (s[hi] - s[lo] for s in sums)
    rich = (total > 1e-9) & (hi - lo >= _MIN_WINDOW_SAMPLES)
    safe = np.where(rich, total, 1.0)
    return np.where(rich, total_score / safe, 0.0), np.where(rich, np.sqrt(inflation / safe), np.inf)


def find_lagging(
    aligner: ReferenceAligner,
    offset: TimeOffset,
    config: EvaluationConfig,
    trusted: BoolArray,
    breaks: list[ExcludedSpan],
) -> list[ExcludedSpan]:
    """Return the lagging spans, in the session's clock.

    ``trusted`` (n,) are the epochs not excluded so far; ``breaks`` the frozen and missing spans (session
    clock) found so far: a lag is expected after the end of one.
    """
    t = aligner.series.t_s
    ordered = sorted(breaks, key=lambda b: b.to_s)
    edges = [-np.inf, *(b.to_s for b in ordered), np.inf]
    spans = []
    for k, (from_s, to_s) in enumerate(pairwise(edges)):
        stretch = trusted & (t >= from_s) & (t <= to_s)
        if not stretch.any():
            continue
        local = local_offsets(aligner, offset, config.lag_window_s, stretch)
        broken_by = ordered[k - 1] if k else None
        found = _lagging_part(local, config, broken_by, offset.sigma_s)
        if found is not None:
            spans.append(_describe(local, *found, broken_by if found[0] == 0 else None))
    return spans


def _lagging_part(
    local: LocalOffsets, config: EvaluationConfig, broken_by: ExcludedSpan | None, base_sigma_s: float
) -> tuple[int, int] | None:
    """Return the first and last lagging window of a stretch, or None.

    Only positive lags count; a leading reference indicates an error of the track. After a freeze, x and z must not
    contradict the lag; otherwise they must show it themselves (a calibration error is in y alone), and the lag must
    explain the errors (a diverged track is wrong in any direction).
    """
    sigma, across_sigma = np.hypot(local.sigma_s, base_sigma_s), np.hypot(local.across_sigma_s, base_sigma_s)
    least = config.lag_unprompted_min_s if broken_by is None else config.lag_min_s
    late = (local.lag_s > config.lag_sigma * sigma) & (local.lag_s > least)
    late &= np.abs(local.lag_s - local.across_lag_s) < config.lag_sigma * across_sigma
    froze = broken_by is not None and broken_by.reason is ExclusionReason.FROZEN
    if not froze:
        late &= (local.across_lag_s > _AGREEMENT_SIGMA * across_sigma) & (local.explained > _MIN_EXPLAINED)
    hits = np.flatnonzero(late)
    if len(hits) == 0:
        return None
    recovered = local.lag_s < np.maximum(sigma, config.lag_min_s / 2)
    after = np.flatnonzero(recovered[hits[-1] :])
    last = int(hits[-1] + after[0]) if len(after) else len(late) - 1
    if froze:
        return 0, last
    before = np.flatnonzero(recovered[: hits[0]])
    return (int(before[-1]) + 1 if len(before) else 0), last


def _describe(local: LocalOffsets, first: int, last: int, broken_by: ExcludedSpan | None) -> ExcludedSpan:
    """Describe windows ``first`` … ``last`` as lagging, from the end of the break before them if there was one."""
    known = np.isfinite(local.sigma_s[first : last + 1])
    top = float(local.lag_s[first : last + 1][known].max()) if known.any() else 0.0
    since = "" if broken_by is None else f", since it was {broken_by.reason.value}"
    return ExcludedSpan(
        from_s=float(local.t_s[first]) if broken_by is None else broken_by.to_s,
        to_s=float(local.t_s[last]),
        reason=ExclusionReason.LAGGING,
        detail=f"late by up to {top:.2f} s more than elsewhere{since}",
    )
