"""Methods compared in the paper's detection experiments, and the paper's statement on each."""

from dataclasses import replace

from groundstation.detection.config import DetectionConfig, DetectorKind, SegmentationMethod, SnakeConfig

SEED = 7
DEFAULT = DetectionConfig(detector=DetectorKind.CLASSIC)
PAPERS_CHOICE, FULL = "250×100", "full frame"
# the paper's text names the smallest and the chosen size; the others keep their shape of 5:2
SIZES = ((150, 60), (200, 80), (250, 100), (300, 120), (400, 160), (600, 240))
SWEEP = {
    **{f"{w}×{h}": replace(DEFAULT, roi_basic_px=(w, h)) for w, h in SIZES},
    f"{PAPERS_CHOICE}, 0 sigma": replace(DEFAULT, roi_sigmas=0.0),
    FULL: replace(DEFAULT, roi_basic_px=(100_000, 100_000)),
}
OURS = "Chan-Vese, narrow band (default)"
METHODS = {
    OURS: DEFAULT,
    "Chan-Vese, full grid": replace(DEFAULT, segmentation=SegmentationMethod.CHAN_VESE_FULL),
    # each snake with the smoothing that suits it best: wide for the plain one, or its force ends a pixel off
    "snake": replace(DEFAULT, segmentation=SegmentationMethod.SNAKE, snake=SnakeConfig(sigma_px=2.0)),
    "GVF snake": replace(DEFAULT, segmentation=SegmentationMethod.GVF_SNAKE),
    "scikit-image chan_vese": replace(DEFAULT, segmentation=SegmentationMethod.SKIMAGE_CHAN_VESE),
    "scikit-image chan_vese, our start": replace(DEFAULT, segmentation=SegmentationMethod.SKIMAGE_CHAN_VESE_STEPPED),
    "scikit-image morphological": replace(DEFAULT, segmentation=SegmentationMethod.SKIMAGE_MORPHOLOGICAL),
}
PAPER_ROI = {
    PAPERS_CHOICE: "the choice: deviation below 1.00 px on average in u and in v, about 20 ms",
    FULL: "157 ms mean, 212 ms worst",
}
PAPER_METHODS = {
    OURS: "segments several regions and picks the right one; slightly slower than the snake",
    "snake": "fastest, by little; loses a wing seen apart; errors grow near the ground",
    "GVF snake": "errors grow near the ground",
}
