"""Pictures of 16 bits a pixel that hold the levels of a camera of 12 bits or fewer as they came.

Of deeper pictures the upper eight bits are used. A camera of 12 bits writes levels to 4095; where they are not moved to
the top of the 16 bits, 16 levels are left of them, which no detector complains of.
"""

import cv2
import numpy as np

from groundstation.files.image_header import is_decodable

# beyond the levels of a camera of 12 bits, and what such levels are multiples of where they were moved to the top
_LEVELS, _MOVED = 4096, 16
# what is darker tells nothing: a lens cap
_DARK = 256
WANTED_DEPTH = "8 bits, or levels moved to the top of the 16 (12-bit levels times 16)"


def shallow_levels(data: bytes) -> str | None:
    """Return what a coded picture has where its 16 bits are used up to the twelfth only; None for any other."""
    if not is_decodable(data):
        return None
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        grey = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None
    if grey is None or grey.dtype != np.uint16:
        return None
    brightest = int(grey.max())
    if not _DARK <= brightest < _LEVELS or not np.any(grey % _MOVED):
        return None
    return f"16 bits a pixel, none brighter than {brightest} of 65535"
