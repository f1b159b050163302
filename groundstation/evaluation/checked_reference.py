"""A DGPS reference prepared for comparison: time offset estimated, bad spans excluded, positions moved to the nose."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.config import EvaluationConfig, OffsetSource
from groundstation.evaluation.lagging_reference import find_lagging
from groundstation.evaluation.position_series import (
    InterpolatedReference,
    PositionSeries,
    ReferenceSeries,
    interpolate,
    nose_from_antenna,
    reference_from_fixes,
)
from groundstation.evaluation.reference_exclusion import (
    ExcludedSpan,
    covers,
    find_frozen,
    find_gaps,
    find_glitches,
)
from groundstation.evaluation.reference_time_offset import NoOffset, ReferenceAligner, TimeOffset, estimate_offset
from groundstation.messages import DgpsFix

# how large a constant bias may be, in sigmas of one estimate; a filter's sigma is smaller and its bias is not
_BIAS_SIGMAS = {OffsetSource.TRIANGULATION: 1.0, OffsetSource.TRACK: 3.0}
_ROUNDS = 4
_LAG_ROUNDS = 8
_SETTLED_S = 1e-4
_SURE_SIGMA = 3.0
_WORSE_FIT = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckedReference:
    """A reference ready for comparison.

    Attributes
    ----------
    fixes : the usable fixes, at the nose, in the reference's own clock.
    all_fixes : every fix, at the nose, for pictures.
    offset : t_reference = t_session + offset, or why there is none.
    applied_offset_s : what the comparison uses: the offset found, or 0 where the clocks are one by the session's word.
        Where none was found and the clocks are not one, nothing is usable.
    clocks_given : whether they are.
    offset_source : what was aligned.
    excluded : spans left out, in the session's clock.
    """

    fixes: ReferenceSeries
    all_fixes: ReferenceSeries
    offset: TimeOffset | NoOffset
    applied_offset_s: float
    offset_source: OffsetSource
    excluded: tuple[ExcludedSpan, ...]
    max_gap_s: float
    clocks_given: bool

    def at(self, t_session_s: FloatArray) -> InterpolatedReference:
        """Interpolate the reference at session times (m,); excluded spans and gaps are not usable."""
        at = interpolate(self.fixes, t_session_s + self.applied_offset_s, self.max_gap_s)
        comparable = self.clocks_given or isinstance(self.offset, TimeOffset)
        good = at.usable & ~covers(list(self.excluded), t_session_s) & comparable
        return InterpolatedReference(
            position_m=at.position_m, velocity_m_s=at.velocity_m_s, sigma_m=at.sigma_m, usable=good
        )


def check_reference(
    fixes: Sequence[DgpsFix],
    track: PositionSeries,
    triangulated: PositionSeries,
    antenna_in_body_m: FloatArray | None,
    config: EvaluationConfig,
    clocks_given: bool = False,
) -> CheckedReference:
    """Find clock offset and bad stretches of a DGPS log by the track (or the triangulated points) of the session.

    If ``clocks_given``, the session's clock is the DGPS clock: the offset found is a check of that
    and is not applied.
    """
    reference = reference_from_fixes(fixes)
    if antenna_in_body_m is not None:
        reference = nose_from_antenna(reference, antenna_in_body_m)
    source, series = _offset_series(track, triangulated, config)
    # of an hour each takes some MB, and one is not looked at again
    del track, triangulated
    gaps = find_gaps(reference, config.max_interpolation_gap_s)
    found = _ReferenceFindings(frozen=find_frozen(reference, None, 0.0, config))
    for _ in range(_ROUNDS):
        held = found.frozen
        _look(reference, series, gaps, found, config, _BIAS_SIGMAS[source])
        if found.frozen == held:
            break
    applied = found.offset.offset_s if isinstance(found.offset, TimeOffset) else 0.0
    applied = 0.0 if clocks_given else applied
    own = [s.shifted(-applied) for s in (*gaps, *found.frozen, *found.glitches)]
    return CheckedReference(
        fixes=_without(reference, [*found.frozen, *found.glitches]),
        all_fixes=reference,
        offset=found.offset,
        applied_offset_s=applied,
        offset_source=source,
        excluded=tuple(sorted([*own, *found.lagging], key=lambda s: s.from_s)),
        max_gap_s=config.max_interpolation_gap_s,
        clocks_given=clocks_given,
    )


@dataclass(slots=True, kw_only=True)
class _ReferenceFindings:
    """What the rounds have found so far; spans in the reference's clock, the lagging ones in the session's."""

    frozen: list[ExcludedSpan]
    glitches: list[ExcludedSpan] = field(default_factory=list)
    lagging: list[ExcludedSpan] = field(default_factory=list)
    offset: TimeOffset | NoOffset = field(default_factory=lambda: NoOffset(reason="not searched"))


def _look(
    reference: ReferenceSeries,
    series: PositionSeries,
    gaps: list[ExcludedSpan],
    found: _ReferenceFindings,
    config: EvaluationConfig,
    bias_sigmas: float,
) -> None:
    """Do one round: glitches, offset, frozen, lagging, and the offset without them."""
    found.glitches = find_glitches(_without(reference, found.frozen), config)
    usable = _without(reference, [*found.frozen, *found.glitches])
    found.offset = _base_offset(series, usable, found.frozen, config, bias_sigmas)
    found.lagging = []
    if isinstance(found.offset, NoOffset):
        return
    found.frozen = find_frozen(reference, series, found.offset.offset_s, config)
    aligner = ReferenceAligner(
        series, _without(reference, [*found.frozen, *found.glitches]), config.max_interpolation_gap_s
    )
    for _ in range(_LAG_ROUNDS):
        shift = found.offset.offset_s
        out = covers([s.shifted(-shift) for s in (*gaps, *found.frozen, *found.glitches)], series.t_s)
        breaks = [s.shifted(-shift) for s in (*gaps, *found.frozen)]
        lagging = find_lagging(aligner, found.offset, config, ~out, breaks)
        found.lagging = lagging
        pooled = estimate_offset(
            aligner,
            max_offset_s=config.max_offset_s,
            huber_sigma=config.huber_sigma,
            bias_sigmas=bias_sigmas,
            excluded=out | covers(found.lagging, series.t_s),
            start_s=shift,
        )
        if isinstance(pooled, TimeOffset):
            found.offset = pooled
        if abs(found.offset.offset_s - shift) < _SETTLED_S:
            break


def _base_offset(
    series: PositionSeries,
    usable: ReferenceSeries,
    frozen: list[ExcludedSpan],
    config: EvaluationConfig,
    bias_sigmas: float,
) -> TimeOffset | NoOffset:
    """Return the offset of the stretch that lags least, of those between freezes.

    A receiver that has frozen can come back late, never early, so of stretches that disagree the one with the
    smallest offset (and a small sigma) is right, however short. Without a freeze this is all of the log.
    """
    edges = [-np.inf, *sorted(s.to_s for s in frozen), np.inf]
    best: TimeOffset | NoOffset = NoOffset(reason="track and reference share too few epochs")
    candidates = []
    for from_s, to_s in pairwise(edges):
        part = usable.keep((usable.t_s > from_s) & (usable.t_s <= to_s))
        offset = estimate_offset(
            ReferenceAligner(series, part, config.max_interpolation_gap_s),
            max_offset_s=config.max_offset_s,
            huber_sigma=config.huber_sigma,
            bias_sigmas=bias_sigmas,
        )
        if isinstance(offset, TimeOffset):
            candidates.append(offset)
        else:
            best = offset
    if not candidates:
        return best
    fit = min(c.misfit for c in candidates)
    fitting = [c for c in candidates if c.misfit <= _WORSE_FIT * fit + 1.0]
    return min(fitting, key=lambda c: c.offset_s + _SURE_SIGMA * c.sigma_s)


def _without(reference: ReferenceSeries, spans: list[ExcludedSpan]) -> ReferenceSeries:
    """Return the fixes outside the spans (reference clock)."""
    return reference.keep(~covers(spans, reference.t_s))


def _offset_series(
    track: PositionSeries, triangulated: PositionSeries, config: EvaluationConfig
) -> tuple[OffsetSource, PositionSeries]:
    """Return what to align: triangulated points if chosen and at least half as many as the track's."""
    enough = 2 * len(triangulated) >= len(track) and len(triangulated) > 0
    if config.offset_from is OffsetSource.TRIANGULATION and enough:
        return OffsetSource.TRIANGULATION, triangulated
    return OffsetSource.TRACK, track
