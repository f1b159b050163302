"""Tuning of the detector: every value with its meaning and default."""

from dataclasses import dataclass, field
from enum import StrEnum


class Channel(StrEnum):
    """Which scalar image the level set divides."""

    AUTO = "auto"
    GREY = "grey"
    SATURATION = "saturation"
    COLOUR = "colour"
    BACKGROUND = "background"


class SegmentationMethod(StrEnum):
    """How the scalar image is divided into target and background."""

    CHAN_VESE = "chan_vese"
    # baselines: slower, less capable, or both (detection/segmentation_baselines.py)
    CHAN_VESE_FULL = "chan_vese_full"
    SNAKE = "snake"
    GVF_SNAKE = "gvf_snake"
    SKIMAGE_CHAN_VESE = "skimage_chan_vese"
    SKIMAGE_CHAN_VESE_STEPPED = "skimage_chan_vese_stepped"
    SKIMAGE_MORPHOLOGICAL = "skimage_morphological"


class TargetPoint(StrEnum):
    """Which point of the silhouette is reported."""

    NOSE = "nose"
    CENTROID = "centroid"


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelSetConfig:
    """Weights and numerics of the Chan-Vese level set; the image is scaled to [0, 1].

    Attributes
    ----------
    mu : weight of the contour's length.
    nu : weight of the area inside (positive shrinks).
    lambda1, lambda2 : weights of the misfit inside and outside.
    local_share : share of the misfit taken against means that vary over the picture, for uneven light; 0 is the
        plain Chan-Vese model, 1 region-scalable fitting.
    local_sigma_px : width of the Gaussian window of these means.
    eps : width in px of the regularised Heaviside and delta.
    time_step : artificial time per iteration; the length term is implicit, so large steps are stable.
    iterations : at most this many.
    stop_fraction : stop when fewer than this fraction of the pixels inside changed sides ...
    stop_after : ... in this many iterations running.
    visits_per_px : and at the latest when so many times the picture's pixels have been visited; a target takes
        half of that, a contour that runs away over scenery would take twenty times as much.

    Iterations and the two stops hold for every segmentation method.
    """

    mu: float = 0.02
    nu: float = 0.0
    lambda1: float = 1.0
    lambda2: float = 1.0
    local_share: float = 0.0
    local_sigma_px: float = 8.0
    eps: float = 1.0
    time_step: float = 400.0
    iterations: int = 60
    stop_fraction: float = 0.01
    stop_after: int = 2
    visits_per_px: float = 2.0

    def __post_init__(self) -> None:
        if self.visits_per_px <= 0:
            raise ValueError("visits_per_px must be > 0")
        if min(self.mu, self.lambda1, self.lambda2) < 0 or self.eps <= 0 or self.time_step <= 0:
            raise ValueError("mu, lambda1, lambda2 must be ≥ 0, eps and time_step > 0")
        if not 0 <= self.local_share <= 1 or not 0.5 <= self.local_sigma_px <= 100:
            raise ValueError("local_share must lie in [0, 1], local_sigma_px in [0.5, 100]")
        if self.iterations < 1 or self.stop_after < 1:
            raise ValueError("iterations and stop_after must be ≥ 1")
        if not 0 <= self.stop_fraction < 1:
            raise ValueError("stop_fraction must lie in [0, 1)")


@dataclass(frozen=True, slots=True, kw_only=True)
class SnakeConfig:
    """Weights and numerics of the snakes (detection/snake.py); the stopping rule is in `LevelSetConfig`.

    Attributes
    ----------
    tension : α, weight of the contour's stretch; differences are taken from point to point.
    rigidity : β, weight of its bending, from point to point as well.
    step : artificial time τ per iteration; the strongest force moves a point by this many px. Above 0.5 the
        gradient vector flow moves points from one side of an edge to the other and back.
    spacing_px : distance of neighbouring points, renewed as the contour grows or shrinks.
    sigma_px : the image is smoothed by a Gaussian of this sigma before its gradient is taken.
    gvf_mu : μ, how far the gradient vector flow smooths; at most 0.2, or its unit steps are unstable.
    gvf_iterations : steps of that flow; the edges' pull reaches about as many px.
    """

    tension: float = 0.2
    rigidity: float = 0.05
    step: float = 0.5
    spacing_px: float = 0.5
    sigma_px: float = 0.7
    gvf_mu: float = 0.1
    gvf_iterations: int = 60

    def __post_init__(self) -> None:
        if min(self.tension, self.rigidity) < 0 or min(self.step, self.spacing_px, self.sigma_px) <= 0:
            raise ValueError("tension and rigidity must be ≥ 0, step, spacing_px and sigma_px > 0")
        if not 0 < self.gvf_mu <= 0.2 or self.gvf_iterations < 0:
            raise ValueError("gvf_mu must lie in (0, 0.2], gvf_iterations must be ≥ 0")


class DetectorKind(StrEnum):
    """How a camera's target is detected: by contrasts and learnt appearance, or by the learned channel."""

    CLASSIC = "classic"
    LEARNED = "learned"


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionConfig:
    """Tuning of one camera's detector.

    Attributes
    ----------
    detector : classic, with all settings below; or the learned channel (docs/learned-channel.md), which uses
        ``level_set.mu``, ``target_point``, ``roi_…``, ``gate_sigmas`` and ``min_span_px`` alone.
    weights_sha256 : SHA-256 of the learned channel's weights; empty for those of the program. ``--weights`` sets it.
    segmentation : the method that divides the image.
    level_set : the Chan-Vese weights and numerics, and the stopping rule of every method.
    snake : the snakes' weights and numerics.
    channel : the scalar image that is divided; "auto" selects the one with the best measured contrast.
    learn_background : keep a few earlier frames as a model of the background; "background" is the colour
        distance from them, where they cover it.
    equalise : equalise the histogram of the saturation channel, as the reference system does.
    target_point : the nose, or the silhouette's centroid.
    roi_basic_px : width and height added to the target's last size.
    roi_sigmas : the ROI is widened by this many sigmas of the prediction to either side.
    roi_max_sigma_px : a prediction with a larger sigma than this does not widen the ROI further.
    min_contrast_to_noise : a silhouette with less contrast is a miss.
    gate_sigmas : a silhouette farther from the prediction than this many sigmas is not the target.
    size_gate_sigmas : nor one whose span differs by more than this many sigmas from the expected span.
    min_span_px : nor one smaller than this.
    ambiguity_ratio : a second candidate at least this likely, relative to the best, makes a miss.
    max_working_span_px : larger targets are processed in a reduced image, to limit the time.
    appearance_rate : rate at which the appearance model follows confident frames, per frame.
    appearance_gate : appearance distance in sigmas beyond which a candidate is another object.
    """

    detector: DetectorKind = DetectorKind.LEARNED
    weights_sha256: str = ""
    segmentation: SegmentationMethod = SegmentationMethod.CHAN_VESE
    level_set: LevelSetConfig = field(default_factory=LevelSetConfig)
    snake: SnakeConfig = field(default_factory=SnakeConfig)
    channel: Channel = Channel.AUTO
    learn_background: bool = True
    equalise: bool = False
    target_point: TargetPoint = TargetPoint.NOSE
    roi_basic_px: tuple[int, int] = (250, 100)
    roi_sigmas: float = 3.0
    roi_max_sigma_px: float = 200.0
    min_contrast_to_noise: float = 3.0
    gate_sigmas: float = 5.0
    size_gate_sigmas: float = 3.0
    min_span_px: float = 2.0
    ambiguity_ratio: float = 0.6
    max_working_span_px: float = 160.0
    appearance_rate: float = 0.1
    appearance_gate: float = 1.5

    def __post_init__(self) -> None:
        if min(self.roi_basic_px) < 1 or self.roi_sigmas < 0:
            raise ValueError("roi_basic_px must be ≥ 1 and roi_sigmas ≥ 0")
        if not 0 < self.ambiguity_ratio <= 1 or not 0 <= self.appearance_rate <= 1:
            raise ValueError("ambiguity_ratio and appearance_rate must lie in (0, 1]")
        if self.max_working_span_px < 20:
            raise ValueError("max_working_span_px must be ≥ 20")
        for name in ("roi_max_sigma_px", "min_span_px", "gate_sigmas", "size_gate_sigmas", "appearance_gate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} {getattr(self, name):g} not > 0")
        if self.min_contrast_to_noise < 0:
            raise ValueError(f"min_contrast_to_noise {self.min_contrast_to_noise:g} < 0")
