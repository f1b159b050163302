"""Blocks of the inverse of a sparse normal matrix, for unknowns that are close in time.

Unknowns of smooth paths touch only their neighbours in time. In the order of time the matrix is banded, and the inverse
within a band is cheap (`calibration.flight.banded_inverse`): the effort grows with the flight's length, where solving
for each block of time grows with its square.
"""

import numpy as np
from scipy.linalg import cholesky_banded
from scipy.sparse import csc_matrix

from calibration.flight.banded_inverse import banded_inverse
from groundstation.arrays import FloatArray, IntArray


class WindowedInverse:
    """Entries of N⁻¹ (K, K) between unknowns of one window each."""

    def __init__(self, normal: csc_matrix, time_s: FloatArray, windows: list[IntArray]) -> None:
        """Order the unknowns of ``normal`` by ``time_s`` (K,); each window lists unknowns that are wanted together."""
        order = np.argsort(time_s, kind="stable")
        self._place = np.empty(len(order), dtype=np.int64)
        self._place[order] = np.arange(len(order))
        self._normal = normal.tocoo()
        row, column = self._place[self._normal.row], self._place[self._normal.col]
        self._lower = row >= column
        self._row, self._column = row[self._lower], column[self._lower]
        widest = max((int(np.ptp(self._place[window])) for window in windows if len(window)), default=0)
        self.width = max(int(np.max(self._row - self._column, initial=0)), widest)
        self._bands: FloatArray | None = None

    def window(self, unknowns: IntArray) -> FloatArray:
        """Return N⁻¹ between some unknowns (k,) of one window, (k, k)."""
        if self._bands is None:
            self._bands = self._inverse()
        place = self._place[unknowns]
        first = np.minimum(place[:, None], place)
        return np.asarray(self._bands[np.abs(place[:, None] - place), first])

    def _inverse(self) -> FloatArray:
        bands = np.zeros((self.width + 1, len(self._place)))
        bands[self._row - self._column, self._column] = self._normal.data[self._lower]
        return np.asarray(banded_inverse(cholesky_banded(bands, lower=True)))
