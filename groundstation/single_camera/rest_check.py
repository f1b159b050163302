"""Whether the target of one camera rests: moves with the background, or not at all where no background is seen.

A network takes letters on a sign and gaps in a treeline for small aircraft at times. These rest; what flies does not,
but for a target on which the camera is kept before an even sky, where contrast alone finds it.
"""

import math

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.registration.picture_shift import picture_shift

_EVERY_S = 0.4
# what rests moves by at most such a share of its length in that time
RESTING = 0.15


class RestCheck:
    """Compares the target's place with the background's, every few tenths of a second.

    Attributes
    ----------
    rests : the newest answer; None until there is one.
    """

    def __init__(self) -> None:
        self.rests: bool | None = None
        self._before: tuple[float, ImageArray, Box[float]] | None = None
        self._has_background = False

    def update(self, small: ImageArray, box: Box[float], t_s: float) -> None:
        """Take a frame's small copy, and the box (px) in which the target was seen at ``t_s``.

        Where the background's motion has been measured before and is not now, in a blurred picture, there is no answer.
        """
        if self._before is not None:
            if t_s - self._before[0] < _EVERY_S:
                return
            shift = picture_shift(self._before[1], small, self._before[2])
            if shift is not None or not self._has_background:
                self.rests = _rests(self._before[2], box, shift)
            self._has_background |= shift is not None
        self._before = (t_s, small, box)


def rests_between(before: ImageArray, box_before: Box[float], small: ImageArray, box: Box[float]) -> bool:
    """Return whether a target has moved as the background has, between two small copies of frames and its boxes."""
    return _rests(box_before, box, picture_shift(before, small, box_before))


def _rests(box_before: Box[float], box: Box[float], shift: FloatArray | None) -> bool:
    """Return whether a target has moved by a background's ``shift`` (2,) px, by nothing where there is none."""
    du, dv = (0.0, 0.0) if shift is None else (float(shift[0]), float(shift[1]))
    u, v = (box.x0 + box.x1 - box_before.x0 - box_before.x1), (box.y0 + box.y1 - box_before.y0 - box_before.y1)
    return math.hypot(0.5 * u - du, 0.5 * v - dv) <= RESTING * max(box.w, box.h)
