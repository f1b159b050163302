"""Columns of one entity: writing a Rerun recording by columns is much cheaper than by rows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.viewer import entity_paths

# Rerun puts (0, 0) at the upper-left corner of the first pixel, we at its centre
CORNER_FROM_CENTRE_PX = 0.5
MAX_CONTOUR_POINTS = 100
SIGMAS = 3.0
_CIRCLE = np.stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 33)), np.sin(np.linspace(0.0, 2.0 * np.pi, 33))])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ColumnBatch:
    """Rows of one entity: its path, the session time (n,) of each row in s, and the columns."""

    entity: str
    t_s: FloatArray
    columns: rr.ComponentColumnList

    def send(self, stream: rr.RecordingStream) -> None:
        """Write the rows; a batch without rows writes nothing."""
        if len(self.t_s):
            stream.send_columns(
                self.entity, indexes=[entity_paths.time_column(self.t_s)], columns=self.columns, strict=True
            )


def scalars(
    entity: str, t_s: Sequence[float] | FloatArray, values: Sequence[Sequence[float]] | FloatArray
) -> ColumnBatch:
    """Return rows of k numbers each; ``values`` is (n, k)."""
    table = np.array(values, dtype=np.float64).reshape(len(t_s), len(values[0]) if len(values) else 1)
    lengths = np.full(len(t_s), table.shape[1])
    columns = rr.Scalars.columns(scalars=table.ravel()).partition(lengths)
    return ColumnBatch(entity=entity, t_s=np.array(t_s), columns=columns)


def present(rows: Sequence[object]) -> NDArray[np.int64]:
    """Return how many elements each row has, (n,): one, or none where the row is absent and so clears the view."""
    return np.array([row is not None for row in rows], dtype=np.int64)


def ellipses(centres_px: FloatArray, covariances_px2: FloatArray) -> NDArray[np.float32]:
    """Return the 3 sigma outlines (n, 33, 2) px of n pixels (n, 2) with covariances (n, 2, 2)."""
    variances, axes = np.linalg.eigh(covariances_px2)
    radii = SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    outlines = np.einsum("nij,nj,jk->nki", axes, radii, _CIRCLE)
    return (centres_px[:, None, :] + outlines + CORNER_FROM_CENTRE_PX).astype(np.float32)


def crosses(centres_px: FloatArray, inner_px: float, outer_px: float) -> NDArray[np.float32]:
    """Return four strokes around each pixel (n, 2), open in the middle: (4n, 2, 2) px."""
    directions = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    strokes = np.stack([inner_px * directions, outer_px * directions], axis=1)
    placed = centres_px[:, None, None, :] + strokes + CORNER_FROM_CENTRE_PX
    return placed.reshape(-1, 2, 2).astype(np.float32)


def outline_pieces(contour_px: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Split an outline (n, 2) at its rows of NaN, thin it to about `MAX_CONTOUR_POINTS`, close each piece."""
    step = max(1, -(-len(contour_px) // MAX_CONTOUR_POINTS))
    breaks = np.flatnonzero(np.isnan(contour_px[:, 0]))
    pieces = np.split(contour_px, breaks) if len(breaks) else [contour_px]
    outlines = []
    for number, whole in enumerate(pieces):
        piece = whole[1:] if number else whole  # `split` leaves the separating row in front
        if len(piece) > 1:
            closed = np.concatenate([piece[::step], piece[:1]])
            outlines.append((closed + CORNER_FROM_CENTRE_PX).astype(np.float32))
    return outlines
