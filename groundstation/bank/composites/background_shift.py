"""Motion of a clip's background from frame to frame: pan, tilt and shake of its camera."""

from collections.abc import Sequence

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.registration.picture_shift import picture_shift

_NOWHERE = Box(0.0, 0.0, 0.0, 0.0)


def background_shifts(small: Sequence[ImageArray], boxes: Sequence[Box[float] | None]) -> FloatArray:
    """Return where the scene of the first frame is in each of n frames (n, 2), px of the full picture.

    It is summed over the steps between small copies, the real aircraft's ``boxes`` left out; a plain sky shows no step
    and counts as still.
    """
    shifts = np.zeros((len(small), 2))
    for k in range(1, len(small)):
        box = boxes[k - 1]
        step = picture_shift(small[k - 1], small[k], _NOWHERE if box is None else box)
        shifts[k] = shifts[k - 1] + (0.0 if step is None else step)
    return shifts
