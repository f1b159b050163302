"""Segmentation methods for comparison: the full-grid level set, those of scikit-image, and the snakes.

Each takes the scalar image and the region inside the start contour, stops by the same rule (at most so many of
the pixels inside change side, so many times running) and returns a φ, positive on the target.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.detection import chan_vese, snake
from groundstation.detection.config import DetectionConfig, LevelSetConfig, SegmentationMethod

Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
_SMALL = np.float32(1e-3)
Segment = Callable[[Float32Array, BoolArray], Float32Array]


def make_baseline(config: DetectionConfig) -> Segment:
    """Return the baseline that the configuration names.

    Everything it compiles is compiled here, so that no frame waits for it.
    """
    segment = _method(config)
    small = np.zeros((16, 16), np.bool_)
    small[4:12, 4:12] = True
    segment(small.astype(np.float32), small)
    return segment


def _method(config: DetectionConfig) -> Segment:
    """Return the baseline that the configuration names, its kernels perhaps not yet compiled."""
    level_set = config.level_set
    stop = (level_set.iterations, level_set.stop_fraction, level_set.stop_after)
    match config.segmentation:
        case SegmentationMethod.CHAN_VESE_FULL:
            return partial(_chan_vese_full, config=level_set)
        case SegmentationMethod.SNAKE:
            return partial(snake.segment, config=config.snake, stop=stop, gvf=False)
        case SegmentationMethod.GVF_SNAKE:
            return partial(snake.segment, config=config.snake, stop=stop, gvf=True)
        case SegmentationMethod.SKIMAGE_CHAN_VESE:
            return partial(_skimage_chan_vese, config=level_set, skimage=_skimage_segmentation())
        case SegmentationMethod.SKIMAGE_CHAN_VESE_STEPPED:
            skimage = _skimage_segmentation()
            return partial(_skimage_chan_vese, config=level_set, skimage=skimage, stepped=True)
        case SegmentationMethod.SKIMAGE_MORPHOLOGICAL:
            return partial(_skimage_morphological, config=level_set, skimage=_skimage_segmentation())
        case SegmentationMethod.CHAN_VESE:
            raise ValueError("the level set itself is no baseline")


def _skimage_segmentation() -> Any:
    """Return the module ``skimage.segmentation``."""
    # imported here: no other method needs it, and every start of the program would wait for it
    from skimage import segmentation

    return segmentation


def _chan_vese_full(u: Float32Array, inside: BoolArray, config: LevelSetConfig) -> Float32Array:
    """Evolve the level set over the whole grid, from the same first data step as the compiled one."""
    phi = chan_vese.start(u, inside)
    weights = (config.mu, config.nu, config.lambda1, config.lambda2)
    stop = (config.stop_fraction, config.stop_after)
    chan_vese.evolve_full(u, phi, weights, config.eps, config.time_step, config.iterations, *stop)
    return phi


def _skimage_chan_vese(
    u: Float32Array, inside: BoolArray, config: LevelSetConfig, skimage: Any, stepped: bool = False
) -> Float32Array:
    """Run scikit-image's level set (Getreuer, IPOL 2012) from a small step of φ on the start contour.

    ``stepped`` starts it where the compiled one starts, after that one's first data step inside the contour.
    From φ = ±1 no pixel would change side for some iterations, which would count as convergence. It has neither ν
    nor ε (0 and 1), and its δ lacks the factor 1/π, which goes into the time step. It runs one iteration at a
    time, because its own stopping rule tests φ instead of its sign.
    """
    numbers = {"mu": config.mu, "lambda1": config.lambda1, "lambda2": config.lambda2, "dt": config.time_step / np.pi}
    once = {**numbers, "tol": 0.0, "max_num_iter": 1, "extended_output": True}

    def advance(phi: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(skimage.chan_vese(u, init_level_set=phi, **once)[1])

    begun = chan_vese.start(u, inside).astype(np.float64) if stepped else np.where(inside, _SMALL, -_SMALL)
    return _run(advance, begun, config).astype(np.float32)


def _skimage_morphological(u: Float32Array, inside: BoolArray, config: LevelSetConfig, skimage: Any) -> Float32Array:
    """Run scikit-image's morphological level set (Márquez-Neila et al., PAMI 2014) from the start contour.

    Its weight of length is one smoothing per iteration; the contour moves a pixel per iteration at most.
    """
    weights = {"smoothing": 1, "lambda1": config.lambda1, "lambda2": config.lambda2}

    def advance(mask: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(skimage.morphological_chan_vese(u, num_iter=1, init_level_set=mask, **weights))

    mask = _run(advance, inside.astype(np.int8), config)
    return np.where(mask > 0, np.float32(1), np.float32(-1))


def _run(advance: Callable[[NDArray[Any]], NDArray[Any]], state: NDArray[Any], config: LevelSetConfig) -> NDArray[Any]:
    """Repeat ``advance`` on a level set (h, w) until it converges by the common rule."""
    quiet = 0
    for _ in range(config.iterations):
        new = advance(state)
        now = new > 0
        changed = np.count_nonzero(now != (state > 0))
        quiet = quiet + 1 if changed <= config.stop_fraction * np.count_nonzero(now) else 0
        state = new
        if quiet >= config.stop_after:
            break
    return state
