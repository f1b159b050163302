"""The tracker of one camera that a name selects."""

from groundstation.detection.config import DetectorKind
from groundstation.single_camera.learned_tracker import LearnedPixelTracker
from groundstation.single_camera.pixel_tracker import PixelTracker


def make_tracker(kind: DetectorKind, image_size_px: tuple[int, int]) -> PixelTracker | LearnedPixelTracker:
    """Return a tracker of pictures (w, h): with the classic detector, or with that one and the learned channel.

    Raises `InputError` where the learned channel's weights are missing.
    """
    if kind is DetectorKind.LEARNED:
        return LearnedPixelTracker(image_size_px)
    return PixelTracker(image_size_px)
