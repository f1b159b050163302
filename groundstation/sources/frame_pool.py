"""Memory for decoded frames, reused once a frame is no longer referenced.

The operating system delivers the memory of a picture of a few megabytes page by page, each cleared first: for a
frame with a lifetime of a tenth of a second that costs as much as its decoding. A frame's memory is reused when
the last array that refers to it is gone, slices included, so a referenced frame is never overwritten.
"""

import weakref
from collections import deque

import numpy as np

from groundstation.arrays import ImageArray


class FramePool:
    """Hands out pictures (h, w, 3) uint8 of one size (w, h); the content of a new one is undefined.

    It holds as many as were ever in use at once. Frames may be let go in any thread.
    """

    def __init__(self, size_px: tuple[int, int]) -> None:
        self._shape = (size_px[1], size_px[0], 3)
        self._free: deque[bytearray] = deque()

    def take(self) -> ImageArray:
        """Return a picture to write into."""
        try:
            memory = self._free.pop()
        except IndexError:
            memory = bytearray(self._shape[0] * self._shape[1] * self._shape[2])
        # NumPy makes this array, the first on the memory, the base of every slice: it is released with the last
        picture: ImageArray = np.ndarray(self._shape, np.uint8, buffer=memory)
        weakref.finalize(picture, self._free.append, memory).atexit = False
        return picture
