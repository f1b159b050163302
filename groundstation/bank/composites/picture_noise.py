"""The noise of a clip where it shows nothing else: its level and how neighbours go together."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, ImageArray

_BLOCK_PX = 16
# of the blocks of a picture, those that hold no texture
_CALM_SHARE = 0.4
# structure longer than this is the scene's shading, px
_SHADING_PX = 3.0
_MOST_CORRELATION = 0.9
# rounding to whole levels is in any picture, levels²
_ROUNDING_VARIANCE = 1.0 / 12.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureNoise:
    """Noise of the grey level.

    Attributes
    ----------
    sigma : one sigma as the clip shows it, rounding to whole levels included.
    blur_px : sigma of the blur by which a coder has made it smooth.
    """

    sigma: float
    blur_px: float

    def draw(self, generator: np.random.Generator, shape: tuple[int, int]) -> Float32Array:
        """Return noise (h, w) that has this level once it is rounded, and this smoothness."""
        sigma = np.float32(math.sqrt(max(self.sigma**2 - _ROUNDING_VARIANCE, 0.0)))
        margin = math.ceil(3.0 * self.blur_px)
        white = generator.standard_normal((shape[0] + 2 * margin, shape[1] + 2 * margin)).astype(np.float32)
        if self.blur_px <= 0.0:
            return np.asarray(sigma * white)
        size = 2 * margin + 1
        kernel = cv2.getGaussianKernel(size, self.blur_px, cv2.CV_32F)
        smooth = cv2.sepFilter2D(white, -1, kernel, kernel)[margin:-margin, margin:-margin]
        # blur reduces the variance to (Σ k²)² of it, for a separable kernel k
        return np.asarray(sigma / np.float32((kernel**2).sum()) * smooth, np.float32)


def picture_noise(frames: Sequence[ImageArray]) -> PictureNoise:
    """Measure the noise of frames (h, w, 3) of one clip in their calmest blocks, rounding included.

    White noise that is blurred by a Gaussian of sigma b has the correlation exp(−1 / (4 b²)) between neighbours.
    """
    sigmas, correlations = [], []
    for frame in frames:
        grey = np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), np.float32)
        rest = grey - cv2.GaussianBlur(grey, (0, 0), _SHADING_PX)
        rows, columns = (n // _BLOCK_PX * _BLOCK_PX for n in rest.shape)
        blocks = rest[:rows, :columns].reshape(rows // _BLOCK_PX, _BLOCK_PX, columns // _BLOCK_PX, _BLOCK_PX)
        spread = blocks.std(axis=(1, 3))
        calm = spread <= np.quantile(spread, _CALM_SHARE)
        chosen = blocks.transpose(0, 2, 1, 3)[calm]
        sigmas.append(float(np.sqrt((chosen**2).mean())))
        both = float((chosen[:, :, 1:] * chosen[:, :, :-1]).mean())
        correlations.append(both / max(float((chosen**2).mean()), 1e-9))
    correlation = min(float(np.median(correlations)), _MOST_CORRELATION)
    blur = math.sqrt(-0.25 / math.log(correlation)) if correlation > 0.02 else 0.0
    sigma = max(float(np.median(sigmas)) / math.sqrt(_kept_share(blur)), math.sqrt(_ROUNDING_VARIANCE))
    return PictureNoise(sigma=sigma, blur_px=blur)


def _kept_share(blur_px: float) -> float:
    """Return the share of the variance of noise that is left without its slow part.

    It is ∫ |B|² (1 − S)² / ∫ |B|², of which B and S are the transforms of the blur and of `_SHADING_PX`'s.
    """
    b, s = blur_px**2, _SHADING_PX**2
    return 1.0 - 2.0 * b / (b + 0.5 * s) + b / (b + s)
