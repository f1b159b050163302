"""Conditioning of the images of a single-camera tracker: small images are enlarged, noisy ones smoothed.

A target of three pixels has hardly an interior, and in strong noise no single pixel has enough contrast, while the sum
of several has. Other images are passed unchanged.
"""

import cv2
import numpy as np

from groundstation.arrays import ImageArray

_SMALL_PX = 400  # pictures not wider than this are enlarged
_NOISY = 4.0  # grey levels, one sigma: from here on smoothing gains more than it blurs
_SMOOTHING_PX = 1.0
_MEASURE_EVERY = 15
_ROW_STEP = 8
_BLOCK_PX = 32
_QUIET_SHARE = 30  # per cent: the quieter blocks show the noise, the others the scene


def noise_of(image: ImageArray) -> float:
    """Return one sigma of a picture's noise (h, w, 3) in grey levels, from its quietest parts."""
    rows = image[::_ROW_STEP, :, 1].astype(np.int16)
    bend = np.abs(rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:])
    columns = bend.shape[1] // _BLOCK_PX
    if columns == 0:
        return 0.0
    blocks = bend[:, : columns * _BLOCK_PX].reshape(bend.shape[0], columns, _BLOCK_PX)
    # mean of |bend| of white noise is √(2/π) √6 σ
    return float(np.percentile(blocks.mean(axis=2), _QUIET_SHARE)) / (np.sqrt(2.0 / np.pi) * np.sqrt(6.0))


class ImageConditioner:
    """Prepares the pictures of one camera.

    Parameters
    ----------
    image_size_px : (w, h) of every input picture.

    Attributes
    ----------
    scale : pixels of the working picture per pixel of the input picture.
    size_px : (w, h) of the working picture.
    """

    def __init__(self, image_size_px: tuple[int, int]) -> None:
        self.scale = 2 if image_size_px[0] <= _SMALL_PX else 1
        self.size_px = (image_size_px[0] * self.scale, image_size_px[1] * self.scale)
        self._count = 0
        self._noisy = False

    def prepare(self, image: ImageArray) -> ImageArray:
        """Return the working picture (h, w, 3) of a picture; it is the same array where there is nothing to do."""
        if self._count % _MEASURE_EVERY == 0:
            self._noisy = noise_of(image) >= _NOISY
        self._count += 1
        if self._noisy:
            image = np.asarray(cv2.GaussianBlur(image, (5, 5), _SMOOTHING_PX), np.uint8)
        if self.scale > 1:
            image = np.asarray(cv2.resize(image, self.size_px, interpolation=cv2.INTER_CUBIC), np.uint8)
        return image
