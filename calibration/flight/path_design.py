"""Derivatives of a station's pixels by the coefficients of all paths: a sparse matrix whose places the times decide.

A fit evaluates it hundreds of times while the times stay the same, and to place the entries took longer than to compute
them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from calibration.flight.path_parts import PathPart
from groundstation.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathPiece:
    """What one path adds.

    Attributes
    ----------
    moves_point : the antenna's path, not a head's.
    axes : of the path, each with the same basis.
    basis : (k,) values of basis functions. pixel : (k,) rows of the pixels that they belong to.
    """

    moves_point: bool
    axes: int
    basis: FloatArray
    pixel: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathDesign:
    """Places of a station's n pixels at ``reference_s`` and ``reading_s`` (n,).

    ``order`` (m,) brings the pieces' products into the order of the matrix ``indices``, ``indptr`` of ``size`` columns.
    """

    reference_s: FloatArray
    reading_s: FloatArray
    pieces: tuple[PathPiece, ...]
    order: IntArray
    indices: IntArray
    indptr: IntArray
    size: int

    def is_for(self, reference_s: FloatArray, reading_s: FloatArray) -> bool:
        """Return whether the pixels are at these times."""
        return np.array_equal(self.reference_s, reference_s) and np.array_equal(self.reading_s, reading_s)

    def matrix(self, by_point: FloatArray, by_angle: FloatArray) -> csr_matrix:
        """Return (2n, K) for pixels with derivatives (n, 2, 3) by the antenna and (n, 2, 2) by the angles."""
        values = [np.zeros(0)]
        for piece in self.pieces:
            by = by_point if piece.moves_point else by_angle
            for axis in range(piece.axes):
                values += [piece.basis * by[piece.pixel, component, axis] for component in range(2)]
        entries = (np.concatenate(values)[self.order], self.indices, self.indptr)
        return csr_matrix(entries, shape=(2 * len(self.reference_s), self.size))


def path_design(
    parts: Sequence[PathPart], station: str, reference_s: FloatArray, reading_s: FloatArray, size: int
) -> PathDesign:
    """Return where the derivatives of a station's pixels by ``size`` coefficients of all paths stand.

    A fixes' lasting error has none: it is the fixes', not the aircraft's.
    """
    rows, columns = ([np.zeros(0, dtype=np.int64)] for _ in range(2))
    pieces = []
    for part in parts:
        if part.station not in (None, station):
            continue
        times = reference_s if part.station is None else reading_s
        inside = np.flatnonzero((times >= part.basis.from_s) & (times <= part.basis.to_s))
        if not len(inside):
            continue
        basis = part.basis.at(times[inside]).tocsr()
        pixel, place = np.repeat(inside, np.diff(basis.indptr)), part.first + basis.indices.astype(np.int64)
        axes = part.samples.shape[1]
        pieces.append(PathPiece(moves_point=part.station is None, axes=axes, basis=basis.data, pixel=pixel))
        for axis in range(axes):
            for component in range(2):
                rows.append(2 * pixel + component)
                columns.append(place + axis * part.basis.count)
    at = (np.concatenate(rows), np.concatenate(columns))
    # no entry is there twice: each path has coefficients of its own
    ordered = csr_matrix((np.arange(len(at[0])), at), shape=(2 * len(reference_s), size))
    return PathDesign(
        reference_s=reference_s,
        reading_s=reading_s,
        pieces=tuple(pieces),
        order=ordered.data,
        indices=ordered.indices,
        indptr=ordered.indptr,
        size=size,
    )
