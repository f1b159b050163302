"""The one target that a tracker in pixels holds."""

import copy
from dataclasses import dataclass, field

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.single_camera.pixel_identity import TargetAppearance
from groundstation.single_camera.pixel_motion import PixelMotion


@dataclass(slots=True, kw_only=True, eq=False)
class PixelTarget:
    """What is held of the target: its motion, its size and how it has been doing.

    Attributes
    ----------
    motion : where it is and where it goes.
    size_px : (w, h) of its silhouette, smoothed.
    box : of its last silhouette in px.
    begun_s, newest_s, seen_s, checked_s : times of its first frame, of the newest one, of the last one that showed
        it, and of the last second look.
    proven : whether it was given and clearly there, or has shown itself often enough since it was found.
    span_px : width to expect as long as the detector has no better one.
    whole_px : its length as second looks have shown it, None if they have not.
    misses : frames running that did not show it.
    frames, seen : how many frames it was looked for in, and how many showed it.
    small : the newest frame's small copy.
    identity : what it looks like, and whether what is seen is still the target.
    """

    motion: PixelMotion
    size_px: tuple[float, float]
    begun_s: float
    newest_s: float
    seen_s: float
    checked_s: float
    box: Box[float]
    proven: bool
    span_px: float | None
    whole_px: float | None = None
    misses: int = 0
    frames: int = 0
    seen: int = 0
    small: ImageArray | None = None
    identity: TargetAppearance = field(default_factory=TargetAppearance)

    @property
    def length_px(self) -> float:
        """Its length as second looks have shown it, or else as the detector has."""
        return max(self.size_px) if self.whole_px is None else self.whole_px

    def go_back(self, t_s: float) -> None:
        """Return to the path and size from before what is seen began to look like something else."""
        known = self.identity.doubt(t_s)
        self.motion = copy.copy(known.motion)
        self.motion.predict(t_s - known.t_s)
        self.size_px, self.whole_px = known.size_px, known.whole_px
