"""Tuning of the tracker of one camera."""

from dataclasses import dataclass, field

from groundstation.detection.candidate_finder import AcquisitionConfig
from groundstation.detection.config import DetectionConfig
from groundstation.detection.target_confirmation import ConfirmationConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelTrackerConfig:
    """Tuning of the tracker of one camera.

    Attributes
    ----------
    detection, acquisition, search : tuning of its parts. The prediction is good to some pixels, so that little
        has to be added to the target's size in the region of interest, and a fainter target is accepted there.
    least_shake_px, most_shake_px : bounds of what a frame brings beyond constant velocity, one sigma.
    search_after : after so many misses running the whole frame is searched, too.
    another_after_s : and after so long anything else that is found replaces the target, wherever it is.
    lost_after_s : a target that has not been seen for so long is lost.
    proof_s, proof_share : a target found by searching is dropped if fewer than this share of the frames in the
        time after show it.
    size_change : a silhouette whose length differs by more than this factor is looked at twice ...
    check_s : and any silhouette is, once in this time.
    unlikeness : sigmas of its looks beyond which what is seen may be something else ...
    accept_s : ... unless it stays in the target's place for so long.
    """

    detection: DetectionConfig = field(
        default_factory=lambda: DetectionConfig(roi_basic_px=(100, 64), min_contrast_to_noise=2.2)
    )
    acquisition: AcquisitionConfig = field(default_factory=AcquisitionConfig)
    search: ConfirmationConfig = field(default_factory=ConfirmationConfig)
    least_shake_px: float = 2.0
    most_shake_px: float = 20.0
    search_after: int = 2
    another_after_s: float = 1.0
    lost_after_s: float = 3.0
    proof_s: float = 1.0
    proof_share: float = 0.5
    size_change: float = 1.4
    check_s: float = 1.0
    unlikeness: float = 0.8
    accept_s: float = 1.5
