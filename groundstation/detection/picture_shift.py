"""How far the whole picture has moved since the last frame: pan, tilt and shake of the camera.

Measured on small grey copies by the motion of corners; the target's own corners are left out.
"""

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.detection.frame_alignment import image_motion

_REDUCTION = 4
_CUT_CORRELATION = 0.3
_CUT_CHANGE = 12.0  # grey levels


def small_copy(image: ImageArray) -> ImageArray:
    """Return a grey copy of a picture (h, w, 3), four times smaller."""
    h, w = image.shape[:2]
    size = (max(w // _REDUCTION, 1), max(h // _REDUCTION, 1))
    # every second pixel is enough here, and green is nearly grey
    small = cv2.resize(np.ascontiguousarray(image[::2, ::2, 1]), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)
