"""Figures by drawn factor: which airframe, sky, size or camera is the weakest condition, and its effect on the hits."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.bank.frame_classes import FRAME_FACTORS, class_column
from groundstation.bank.pooled_figures import COVERAGE, HIT, MISLEADING, WRONG, Ratio, pooled, ratio_interval
from groundstation.bank.result_table import Row

PREFIX = "factor "


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassFigures:
    """Figures of the sessions, or of the frames, of one class of a factor.

    Attributes
    ----------
    factor, kind : the factor, and the class.
    sessions, frames : how many have visible frames, and how many frames those are.
    hit, low, high : share of visible frames hit with its 95 % interval over sessions; None where these do not tell.
    wrong : share of visible frames with a wrong point.
    coverage, misleading : of the class's sessions; None for classes of frames.
    harm : by how much the share of hits over all frames would rise if this class had that of all others.
    excluded : share of the frames with the aircraft that are not visible; None for classes of frames.
    """

    factor: str
    kind: str
    sessions: int
    frames: int
    hit: float
    low: float | None
    high: float | None
    wrong: float
    coverage: float | None
    misleading: float | None
    harm: float
    excluded: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Columns:
    """The columns that hold a class's visible, hit and wrong frames."""

    visible: str
    hit: str
    wrong: str


_SESSION_COLUMNS = _Columns(visible="visible_frames", hit="hit", wrong="wrong_visible")


def factor_figures(rows: Sequence[Row]) -> list[ClassFigures]:
    """Return the figures of every class of every factor, the most harmful first."""
    found = [*_by_session(rows), *_by_frame(rows)]
    return sorted(found, key=lambda figures: (-figures.harm, figures.factor, figures.kind))


def _by_session(rows: Sequence[Row]) -> Iterator[ClassFigures]:
    factors = sorted({name for row in rows for name in row if name.startswith(PREFIX)})
    for factor in factors:
        for kind in sorted({str(row[factor]) for row in rows if row.get(factor) is not None}):
            own = [row for row in rows if row.get(factor) == kind]
            figures = _class_figures(rows, own, _SESSION_COLUMNS, factor.removeprefix(PREFIX), kind)
            if figures is not None:
                yield figures


def _by_frame(rows: Sequence[Row]) -> Iterator[ClassFigures]:
    for factor in FRAME_FACTORS:
        for kind in factor.classes:
            columns = _Columns(**{what: class_column(factor, kind, what) for what in ("visible", "hit", "wrong")})
            figures = _class_figures(rows, rows, columns, factor.name, kind)
            if figures is not None:
                yield figures


def _class_figures(
    rows: Sequence[Row], own: Sequence[Row], columns: _Columns, factor: str, kind: str
) -> ClassFigures | None:
    """Return the figures of one class; None without a visible frame."""
    used = [row for row in own if row.get(columns.visible)]
    visible, hit, wrong = (
        np.array([float(row[column] or 0.0) for row in used])
        for column in (columns.visible, columns.hit, columns.wrong)
    )
    frames = visible.sum()
    if not frames:
        return None
    low, high = ratio_interval(hit, visible) or (None, None)
    of_sessions = columns is _SESSION_COLUMNS
    return ClassFigures(
        factor=factor,
        kind=kind,
        sessions=len(used),
        frames=int(frames),
        hit=float(hit.sum() / frames),
        low=low,
        high=high,
        wrong=float(wrong.sum() / frames),
        coverage=_value(own, COVERAGE) if of_sessions else None,
        misleading=_value(own, MISLEADING) if of_sessions else None,
        harm=_harm(rows, float(frames), float(hit.sum())),
        excluded=_excluded(own) if of_sessions else None,
    )


def _harm(rows: Sequence[Row], frames: float, hit: float) -> float:
    """Return how much the share of hits would rise if a class's frames were hit as often as all others."""
    all_frames = sum(float(row[HIT.below] or 0.0) for row in rows)
    all_hit = sum(float(row[HIT.above] or 0.0) for row in rows)
    others = all_frames - frames
    return (all_hit - hit) / others - all_hit / all_frames if others > 0.0 else 0.0


def _excluded(rows: Sequence[Row]) -> float | None:
    frames = sum(int(row["frames"]) for row in rows)
    return 1.0 - sum(int(row[WRONG.below]) for row in rows) / frames if frames else None


def _value(rows: Sequence[Row], ratio: Ratio) -> float | None:
    return pooled(rows, ratio).value
