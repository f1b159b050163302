"""The one target that a tracker in pixels holds."""

from dataclasses import dataclass

from groundstation.arrays import ImageArray
from groundstation.detection.pixel_motion import PixelMotion


@dataclass(slots=True, kw_only=True, eq=False)
class PixelTarget:
    """What is held of the target: its motion, its size and how it has been doing.

    Attributes
    ----------
    motion : where it is and where it goes.
    size_px : (w, h) of its silhouette, smoothed.
    box : x, y, w, h of its last silhouette in px.
    begun_s, newest_s, seen_s, checked_s : times of its first frame, of the newest one, of the last one that showed
        it, and of the last second look.
    proven : whether it was given, or has shown itself often enough since it was found.
    span_px : width to expect as long as the detector knows nothing better.
    whole_px : its length as second looks have shown it, None if they have not.
    misses : frames running that did not show it.
    frames, seen : how many frames it was looked for in, and how many showed it.
    small : the newest frame's small copy.
    """

    motion: PixelMotion
    size_px: tuple[float, float]
    begun_s: float
    newest_s: float
    seen_s: float
    checked_s: float
    box: tuple[float, float, float, float]
    proven: bool
    span_px: float | None
    whole_px: float | None = None
    misses: int = 0
    frames: int = 0
    seen: int = 0
    small: ImageArray | None = None
