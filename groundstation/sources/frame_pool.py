"""Memory for decoded frames, reused once a frame is no longer referenced.

A picture of a few megabytes comes from the operating system page by page, and each page is cleared first: for a
frame that lives a tenth of a second that costs as much as its colours. A frame's memory comes back by itself when
the last array that looks into it is gone, slices included, so a referenced frame is never overwritten.
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
        # NumPy makes this array, the first to look into the memory, the base of every slice: it dies with the last
        picture: ImageArray = np.ndarray(self._shape, np.uint8, buffer=memory)
        weakref.finalize(picture, self._free.append, memory).atexit = False
        return picture
