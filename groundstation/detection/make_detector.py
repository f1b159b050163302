"""The detector and the finder that the configuration names, or those of a function that takes their place."""

from groundstation.detection.candidate_finder import AcquisitionConfig, CandidateFinder
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.detector import Detector
from groundstation.detection.detector_callback import CallbackDetector, CallbackFinder, DetectorCallback
from groundstation.detection.learned_detector import LearnedDetector
from groundstation.detection.learned_finder import LearnedFinder
from groundstation.geometry.camera import Lens


def make_detector(
    config: DetectionConfig,
    image_size_px: tuple[int, int],
    callback: DetectorCallback | None = None,
    station: str = "",
) -> Detector | LearnedDetector | CallbackDetector:
    """Return the detector of one camera. Raises `InputError` where the learned channel's weights are missing."""
    if callback is not None:
        return CallbackDetector(callback, config, station)
    if config.detector is DetectorKind.LEARNED:
        return LearnedDetector(config, image_size_px)
    return Detector(config, image_size_px)


def make_finder(
    acquisition: AcquisitionConfig,
    detection: DetectionConfig,
    lens: Lens,
    callback: DetectorCallback | None = None,
    station: str = "",
) -> CandidateFinder | LearnedFinder | CallbackFinder:
    """Return what searches the whole frames of one camera. Raises `InputError` as `make_detector` does."""
    if callback is not None:
        return CallbackFinder(callback, station)
    if detection.detector is DetectorKind.LEARNED:
        return LearnedFinder(acquisition, detection, lens.image_size_px, lens)
    return CandidateFinder(acquisition, lens.image_size_px, lens)
