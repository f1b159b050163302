"""Rolling shutter: when each row of a picture is exposed, relative to the picture's stamp.

The stamp is the middle row's mid-exposure; the rows follow each other evenly, the last one ``readout_s`` after the
first. A negative ``readout_s`` is a sensor that is read out from the bottom.
"""

from typing import TypeVar

import numpy as np

from groundstation.arrays import FloatArray

Rows = TypeVar("Rows", float, FloatArray)


def row_share(row_px: Rows, height_px: int) -> Rows:
    """Return a row's offset from the middle of the picture, as a share of its height (rows -½ to h - ½: -½ to ½)."""
    return (row_px + 0.5) / height_px - 0.5


def row_delay_s(row_px: Rows, height_px: int, readout_s: float) -> Rows:
    """Return how long after the stamp a row is exposed, s; rows outside the picture follow the same line."""
    return row_share(row_px, height_px) * readout_s


def exposed_row_delay_s(row_px: Rows, height_px: int, readout_s: float) -> Rows:
    """Return how long after the stamp a row is exposed, s; rows outside the picture as the first or the last one."""
    delay: Rows = np.clip(row_share(row_px, height_px), -0.5, 0.5) * readout_s
    return delay
