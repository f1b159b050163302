"""Structured rows appended one by one and kept compactly: blocks of numpy memory instead of Python objects."""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_BLOCK_ROWS = 2048


class GrowingTable:
    """A table of one structured dtype that grows by blocks; `rows` makes one of them."""

    def __init__(self, dtype: DTypeLike) -> None:
        self.dtype = np.dtype(dtype)
        self._blocks: list[NDArray[Any]] = []
        self._used = 0

    def __len__(self) -> int:
        return sum(len(block) for block in self._blocks[:-1]) + (self._used if self._blocks else 0)

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(block.nbytes for block in self._blocks)

    def append(self, *cells: Any) -> None:
        """Append one row, its cells in the dtype's order."""
        if not self._blocks or self._used == len(self._blocks[-1]):
            self._blocks.append(np.zeros(_BLOCK_ROWS, self.dtype))
            self._used = 0
        self._blocks[-1][self._used] = cells
        self._used += 1

    def rows(self) -> NDArray[Any]:
        """Return all rows as one array, not to be written to: the table keeps no other."""
        if not self._blocks:
            return np.zeros(0, self.dtype)
        if len(self._blocks) > 1 or self._used < len(self._blocks[0]):
            self._blocks = [np.concatenate([*self._blocks[:-1], self._blocks[-1][: self._used]])]
            self._used = len(self._blocks[0])
        return self._blocks[0]
