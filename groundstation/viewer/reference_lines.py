"""References, available after a run: reference lines in the session's clock, and the errors against one."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

from groundstation.arrays import FloatArray
from groundstation.viewer import entity_paths
from groundstation.viewer.columns import ColumnBatch, scalars

COLOURS = {
    "dgps": entity_paths.DGPS_COLOUR,
    "truth": entity_paths.TRUTH_COLOUR,
    "smoothed": entity_paths.SMOOTHED_COLOUR,
}
BOUND_SIGMAS = 2.0
# a longer gap in a reference interrupts its line
GAP_S = 1.0
_BLOCK_ROWS = 4000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceLine:
    """A track to compare with: ``name`` ("dgps", "truth" or "smoothed").

    ``t_s`` (n,) session time, ``position_runway_m`` (n, 3). A DGPS line is in the session's clock, by the
    estimated offset.
    """

    name: str
    t_s: FloatArray
    position_runway_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisErrors:
    """Track minus reference: ``against`` names the reference; ``t_s`` (n,) session time.

    ``error_m`` (n, 3) in runway x, y, z and ``sigma_m`` (n, 3) one sigma of the track in each axis.
    """

    against: str
    t_s: FloatArray
    error_m: FloatArray
    sigma_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceTracks:
    """Reference lines of the evaluation, and the errors if a reference was compared."""

    lines: tuple[ReferenceLine, ...] = ()
    errors: AxisErrors | None = None


def log_reference_line(stream: rr.RecordingStream, line: ReferenceLine) -> None:
    """Draw a reference track whole, open where it has gaps, and a marker that moves along it."""
    colour = COLOURS.get(line.name, entity_paths.BOUND_COLOUR)
    entity = f"{entity_paths.AIRCRAFT}/{line.name}"
    gaps = np.flatnonzero(np.diff(line.t_s) > GAP_S) + 1
    strip = rr.LineStrips3D(np.split(line.position_runway_m, gaps), colors=colour, radii=rr.Radius.ui_points(0.8))
    stream.log(f"{entity}/path", strip, static=True)
    stream.log(entity, rr.Points3D.from_fields(colors=colour, radii=rr.Radius.ui_points(4.0)), static=True)
    for rows in _blocks(len(line.t_s)):
        columns = rr.Points3D.columns(positions=line.position_runway_m[rows])
        ColumnBatch(entity=entity, t_s=line.t_s[rows], columns=columns).send(stream)
        stream.flush()


def log_errors(stream: rr.RecordingStream, errors: AxisErrors) -> None:
    """Plot the error of each axis with the track's own 2 sigma bounds."""
    for axis, name in enumerate(entity_paths.AXES):
        bound = BOUND_SIGMAS * errors.sigma_m[:, axis]
        entity = f"{entity_paths.ERROR}/{name}"
        stream.log(
            entity,
            rr.SeriesLines(
                colors=[entity_paths.EKF_COLOUR, entity_paths.BOUND_COLOUR, entity_paths.BOUND_COLOUR],
                names=[f"{name} − {errors.against}", "+2σ", "−2σ"],
                widths=[1.8, 1.0, 1.0],
            ),
            static=True,
        )
        values = np.column_stack([errors.error_m[:, axis], bound, -bound])
        for rows in _blocks(len(values)):
            scalars(entity, errors.t_s[rows], values[rows]).send(stream)
            stream.flush()


def _blocks(count: int) -> list[slice]:
    """Return all rows, block by block: what waits to be written is held several times over."""
    return [slice(first, first + _BLOCK_ROWS) for first in range(0, count, _BLOCK_ROWS)]
