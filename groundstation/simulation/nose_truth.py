"""True pixel of the nose in each picture of the device simulator."""

from array import array

import numpy as np

from groundstation.arrays import FloatArray


class NoseTruth:
    """Truth of a camera's pictures: host time of mid-exposure and the nose's pixel, in flat memory.

    ``missing`` is the number of pictures that were due and did not come: not rendered in time, or a fault's.
    """

    def __init__(self) -> None:
        self._rows = array("d")
        self._next: int | None = None
        self.missing = 0

    def add(self, number: int, t_s: float, u_px: float, v_px: float) -> None:
        """Note a picture; the pixel is not a number where the nose is behind the camera."""
        self.missing += 0 if self._next is None else max(number - self._next, 0)
        self._next = number + 1
        self._rows.extend((t_s, u_px, v_px))

    def rows(self) -> FloatArray:
        """Return t, u, v of all pictures, (n, 3)."""
        return np.array(self._rows).reshape(-1, 3)
