"""Rows of an approach: needles, height above the threshold, advice, and the touchdown foretold on the runway."""

import numpy as np
import rerun as rr

from groundstation.arrays import FloatArray
from groundstation.landing.touchdown import TouchdownForecast
from groundstation.landing_site.runway import LandingRunway
from groundstation.viewer import entity_paths
from groundstation.viewer.approach_row import ApproachRow
from groundstation.viewer.columns import ColumnBatch, scalars

# the outline lies so far above the strip that is drawn
_ABOVE_M = 0.05


class ApproachChannel:
    """Collects rows and hands them over as columns.

    Parameters
    ----------
    runway : the site's, on which touchdowns are drawn.
    """

    def __init__(self, runway: LandingRunway) -> None:
        self._runway = runway
        self._rows: list[ApproachRow] = []
        self._last_level: str | None = None
        self._last_deviations_s = -np.inf

    def add(self, row: ApproachRow) -> None:
        """Keep a row until the next `take`."""
        self._rows.append(row)

    def take(self) -> list[ColumnBatch]:
        """Return all rows since the last call and forget them."""
        rows, self._rows = self._rows, []
        if not rows:
            return []
        return [self._advice(rows), *self._deviations(rows), self._touchdown(rows)]

    def _advice(self, rows: list[ApproachRow]) -> ColumnBatch:
        """Return a row for each change of the advice's level."""
        levels, at_s = [], []
        for row in rows:
            level = None if row.advice is None else str(row.advice.level)
            if level is not None and level != self._last_level:
                self._last_level = level
                levels.append(level)
                at_s.append(row.t_s)
        columns = rr.StateChange.columns(state=levels)
        return ColumnBatch(entity=entity_paths.ADVICE, t_s=np.array(at_s), columns=columns)

    def _deviations(self, rows: list[ApproachRow]) -> list[ColumnBatch]:
        """Return needles, and the height of the nose above the threshold with ±2σ, once for each estimate."""
        found = []
        for row in rows:
            if row.deviations is not None and row.deviations.t_s > self._last_deviations_s:
                self._last_deviations_s = row.deviations.t_s
                found.append(row.deviations)
        t_s = [d.t_s for d in found]
        on_path = [(d.t_s, d.glide_path.needle) for d in found if d.glide_path is not None]
        heights = [
            (d.height.value, d.height.value - 2.0 * d.height.sigma, d.height.value + 2.0 * d.height.sigma)
            for d in found
        ]
        return [
            scalars(entity_paths.CENTRE_LINE_NEEDLE, t_s, [(d.centre_line_needle,) for d in found]),
            scalars(entity_paths.GLIDE_PATH_NEEDLE, [t for t, _ in on_path], [(needle,) for _, needle in on_path]),
            scalars(entity_paths.THRESHOLD_HEIGHT, t_s, heights),
        ]

    def _touchdown(self, rows: list[ApproachRow]) -> ColumnBatch:
        """Return the outline of the region foretold at each time; one without clears it."""
        outlines = [None if row.touchdown is None else self._outline(row.touchdown) for row in rows]
        drawn = [outline for outline in outlines if outline is not None]
        lengths = [0 if outline is None else 1 for outline in outlines]
        strips = np.array(drawn, dtype=np.float32).reshape(-1, drawn[0].shape[0] if drawn else 2, 3)
        columns = rr.LineStrips3D.columns(strips=strips)
        t_s = np.array([row.t_s for row in rows])
        return ColumnBatch(entity=entity_paths.TOUCHDOWN, t_s=t_s, columns=columns.partition(np.array(lengths)))

    def _outline(self, touchdown: TouchdownForecast) -> FloatArray:
        """Return the closed outline (k, 3), runway frame."""
        flat = touchdown.outline_m()
        closed = np.concatenate([flat, flat[:1]])
        return self._runway.runway_position(np.column_stack([closed, np.full(len(closed), _ABOVE_M)]))
