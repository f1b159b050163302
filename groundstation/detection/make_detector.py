"""The detector that the configuration names."""

from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.detector import Detector
from groundstation.detection.learned_detector import LearnedDetector


def make_detector(config: DetectionConfig, image_size_px: tuple[int, int]) -> Detector | LearnedDetector:
    """Return the detector of one camera. Raises `InputError` where the learned channel's weights are missing."""
    if config.detector is DetectorKind.LEARNED:
        return LearnedDetector(config, image_size_px)
    return Detector(config, image_size_px)
