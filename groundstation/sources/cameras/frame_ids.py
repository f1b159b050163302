"""Numbers of frames as a camera counts them, unwrapped, so that lost ones can be counted.

GigE Vision counts 1, 2 … 65535, 1 …: sixteen bits, and 0 is not used (GigE Vision 2.0, block_id); other transports and
GigE's extended ids count on in 64 bits. Which of them it is shows itself: a number above 65535 is wide.
"""

from dataclasses import dataclass
from enum import StrEnum

_LARGEST_16 = 0xFFFF
# a number this little behind was overtaken; further back, the camera has restarted its count
_OVERTAKEN = 16


class FrameOrder(StrEnum):
    """How a frame's number follows the one before it."""

    NEXT = "next"
    REPEATED = "repeated"
    OVERTAKEN = "overtaken"
    RESTARTED = "restarted"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameNumber:
    """``index`` never wraps nor decreases, except for an overtaken frame; ``lost`` are missing just before it."""

    index: int
    lost: int
    order: FrameOrder


class FrameNumbers:
    """Unwraps the numbers of one camera, in order of arrival; the first frame has index 0."""

    def __init__(self) -> None:
        self._last_id: int | None = None
        self._index = -1
        self._wide = False
        self._first_id = 1

    def restart(self) -> None:
        """Forget the camera's count, but not the index: the camera has been reopened."""
        self._last_id = None

    def take(self, frame_id: int | None) -> FrameNumber:
        """Return the number of the next frame; ``frame_id`` is the camera's, None where it has none."""
        last, self._last_id = self._last_id, frame_id
        if frame_id is None:
            return self._advance(1, FrameOrder.NEXT)
        if frame_id > _LARGEST_16:
            self._wide = True
        if frame_id == 0:
            self._first_id = 0
        if last is None:
            return self._advance(1, FrameOrder.NEXT)
        period = None if self._wide else _LARGEST_16 + 1 - self._first_id
        step = frame_id - last
        if period is not None:
            # the way round that is shorter: a jump of half the circle back is as far as one forward
            step = (step + period // 2) % period - period // 2
        if step > 0:
            return self._advance(step, FrameOrder.NEXT)
        if step < -_OVERTAKEN:
            return self._advance(1, FrameOrder.RESTARTED)
        self._last_id = last
        order = FrameOrder.REPEATED if step == 0 else FrameOrder.OVERTAKEN
        return FrameNumber(index=self._index + step, lost=0, order=order)

    def _advance(self, step: int, order: FrameOrder) -> FrameNumber:
        self._index += step
        return FrameNumber(index=self._index, lost=step - 1, order=order)
