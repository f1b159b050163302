"""The references of a part of a session: the rows of dgps.csv and truth.csv that belong to it, byte for byte."""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from groundstation.evaluation.config import EvaluationConfig
from groundstation.messages import DgpsFix
from groundstation.rig.rig import ClockModel
from groundstation.session import Session

DGPS, TRUTH = "dgps.csv", "truth.csv"


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionPart:
    """A part of a session, session time in s; None is its beginning or its end.

    Attributes
    ----------
    dgps_margin_s : of the DGPS so much more is kept at both ends: its clock may be late or early by as much.
    dgps_offset_s : t_dgps = t_session + offset, as the rig says; 0 if it does not.
    """

    from_s: float | None
    to_s: float | None
    dgps_margin_s: float
    dgps_offset_s: float

    @property
    def is_whole(self) -> bool:
        """Whether nothing is cut."""
        return self.from_s is None and self.to_s is None

    def holds(self, t_s: float, margin_s: float = 0.0) -> bool:
        """Return whether a session time lies in it, or as close as ``margin_s``."""
        low = -math.inf if self.from_s is None else self.from_s - margin_s
        high = math.inf if self.to_s is None else self.to_s + margin_s
        return low <= t_s <= high

    def holds_fix(self, t_s: float) -> bool:
        """Return whether a time of the DGPS clock lies in it, its margin included."""
        return self.holds(t_s - self.dgps_offset_s, self.dgps_margin_s)


def session_part(session: Session, from_s: float | None, to_s: float | None) -> SessionPart:
    """Return a part of a session; the margin is what the evaluation looks for an offset in."""
    config = EvaluationConfig()
    reference = None if session.has_clocks else session.rig.reference
    known = None if reference is None else reference.clock_for(session.clock_identity)
    return SessionPart(
        from_s=from_s,
        to_s=to_s,
        dgps_margin_s=config.max_offset_s + config.max_interpolation_gap_s,
        dgps_offset_s=0.0 if known is None else known,
    )


def cut_fixes(fixes: Sequence[DgpsFix], part: SessionPart) -> tuple[DgpsFix, ...]:
    """Return the fixes of a part."""
    return tuple(fix for fix in fixes if part.holds_fix(fix.t_s))


def cut_references(files: Mapping[str, bytes], session: Session, part: SessionPart) -> dict[str, bytes]:
    """Return a session's own files with the references of a part; one of which nothing is left is not among them.

    Of the truth a row more is kept at both ends, to interpolate between. A table that is at fault, or has no column
    ``t_s``, stays as it is.
    """
    kept = dict(files)
    if part.is_whole:
        return kept
    for name, holds, margin in ((DGPS, part.holds_fix, 0), (TRUTH, part.holds, 1)):
        if name not in files:
            continue
        clock = session.clocks.get(name.removesuffix(".csv"), ClockModel())
        cut = _cut(files[name], clock, holds, margin)
        if cut is None:
            del kept[name]
        else:
            kept[name] = cut
    return kept


def _cut(table: bytes, clock: ClockModel, holds: Callable[[float], bool], margin: int) -> bytes | None:
    """Return the header and the rows in time, and so many before and after; None if there are none."""
    if not table.strip():
        return table
    header, *rows = table.splitlines(keepends=True)
    columns = [name.strip() for name in _cells(header.removeprefix(b"\xef\xbb\xbf"))]
    if "t_s" not in columns:
        return table
    place = columns.index("t_s")
    rows = [row for row in rows if row.strip()]
    try:
        cells = [_cells(row)[place].strip() for row in rows]
        # a row without a time stays with its neighbours
        times = [clock.session_from_device(float(cell)) if cell else math.nan for cell in cells]
    except (ValueError, IndexError, csv.Error):
        return table
    inside = [k for k, t_s in enumerate(times) if holds(t_s)]
    if not inside:
        return None
    return b"".join((header, *rows[max(inside[0] - margin, 0) : inside[-1] + 1 + margin]))


def _cells(row: bytes) -> list[str]:
    """Return the cells of a row, without the quotes about them."""
    return next(csv.reader([row.decode(errors="replace")], skipinitialspace=True), [])
