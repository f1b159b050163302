"""Segmentation of the scalar image into target and background: all methods behind one interface.

A method takes ``u`` (h, w) float32 in [0, 1] and ``inside`` (h, w), the region that the start contour
encloses, and returns a level set φ (h, w) float32, positive on the target. What follows (regions, choice,
target point) is the same for all of them.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from groundstation.detection import chan_vese
from groundstation.detection.config import DetectionConfig, LevelSetConfig, SegmentationMethod
from groundstation.detection.local_fitting import evolve_local
from groundstation.detection.segmentation_baselines import make_baseline

Float32Array = NDArray[np.float32]
Segmenter = Callable[[Float32Array, NDArray[np.bool_]], Float32Array]


def make_segmenter(config: DetectionConfig) -> Segmenter:
    """Return the method that the configuration names."""
    match config.segmentation:
        case SegmentationMethod.CHAN_VESE:
            return partial(_chan_vese, config=config.level_set)
        case _:
            return make_baseline(config)


def _chan_vese(u: Float32Array, inside: NDArray[np.bool_], config: LevelSetConfig) -> Float32Array:
    """Evolve the compiled level set in its narrow band, or, with a local term, over the window."""
    weights = (config.mu, config.nu, config.lambda1, config.lambda2)
    stop = (config.stop_fraction, config.stop_after)
    if config.local_share > 0:
        # a first step against means of the whole window would discard the purpose of local means
        phi = np.where(inside, np.float32(1), np.float32(-1))
        local = (config.local_share, config.local_sigma_px)
        evolve_local(u, phi, weights, local, config.eps, config.time_step, config.iterations, *stop)
    else:
        numerics = (config.eps, config.time_step)
        phi = chan_vese.divide(u, inside, weights, numerics, config.iterations, stop, config.visits_per_px)
    return phi
