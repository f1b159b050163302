"""A structured numpy array to which rows are appended one at a time."""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_BLOCK_ROWS = 2048


class GrowableTable:
    """A table of one structured dtype that is resized in place; `rows` returns a view of its rows."""

    def __init__(self, dtype: DTypeLike) -> None:
        self.dtype = np.dtype(dtype)
        self._table: NDArray[Any] = np.zeros(0, self.dtype)
        self._used = 0

    def __len__(self) -> int:
        return self._used

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self._table.nbytes

    def append(self, *cells: Any) -> None:
        """Append one row, its cells in the dtype's order."""
        if self._used == len(self._table):
            self._grow()
        self._table[self._used] = cells
        self._used += 1

    def change(self, row: int, **cells: Any) -> None:
        """Set cells of a row by their names."""
        for name, value in cells.items():
            self._table[name][row] = value

    def rows(self) -> NDArray[Any]:
        """Return all rows so far as one array, not to be written to: it is the table's own memory."""
        return self._table[: self._used]

    def _grow(self) -> None:
        """Make room for another block of rows."""
        try:
            # in place: a copy would need the table twice, at the end of a session when there is most of it
            self._table.resize(len(self._table) + _BLOCK_ROWS)
        except ValueError:
            # a view of the rows is still in use, and keeps the old memory
            self._table = np.concatenate([self._table, np.zeros(_BLOCK_ROWS, self.dtype)])
