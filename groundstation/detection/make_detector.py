"""The detector and the finder that the configuration names."""

from groundstation.detection.candidate_finder import AcquisitionConfig, CandidateFinder
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.detector import Detector
from groundstation.detection.learned_detector import LearnedDetector
from groundstation.detection.learned_finder import LearnedFinder
from groundstation.geometry.camera import Lens


def make_detector(config: DetectionConfig, image_size_px: tuple[int, int]) -> Detector | LearnedDetector:
    """Return the detector of one camera. Raises `InputError` where the learned channel's weights are missing."""
    if config.detector is DetectorKind.LEARNED:
        return LearnedDetector(config, image_size_px)
    return Detector(config, image_size_px)


def make_finder(
    acquisition: AcquisitionConfig, detection: DetectionConfig, lens: Lens
) -> CandidateFinder | LearnedFinder:
    """Return what searches the whole frames of one camera. Raises `InputError` as `make_detector` does."""
    if detection.detector is DetectorKind.LEARNED:
        return LearnedFinder(acquisition, detection, lens.image_size_px, lens)
    return CandidateFinder(acquisition, lens.image_size_px, lens)
