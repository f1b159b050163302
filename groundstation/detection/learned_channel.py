"""The learned channel: a small network that tells aircraft from what lies behind it, and where the nose is.

It was trained by `training/` on drawn aircraft over drawn and real backgrounds; its card is docs/learned-channel.md.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.errors import InputError

# the trained map is too flat: with this exponent its covariance is that of its errors on landing-1 and takeoff-1, which
# it was trained on (normalised square per degree of freedom, mean: 0.16 without, 0.6 with it, on landing-1)
_SHARPNESS = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelMaps:
    """What the network gives for a window.

    Attributes
    ----------
    aircraft : (96, 128) float32, logarithm of the odds of aircraft against everything else.
    other : (96, 128) float32, the same of birds and other flying things.
    nose : (96, 128) float32, probability that the nose is at the pixel; its sum is 1, wherever it may be.
    """

    aircraft: Float32Array
    other: Float32Array
    nose: Float32Array


class LearnedChannel:
    """The network, on one thread; each camera has its own.

    Parameters
    ----------
    weights : content of an ONNX file, as `groundstation.files.channel_weights` reads it.

    Raises `InputError` where that is no network.
    """

    def __init__(self, weights: bytes) -> None:
        try:
            self._network = cv2.dnn.readNetFromONNX(np.frombuffer(weights, np.uint8))
        except cv2.error as fault:
            raise InputError("weights of the learned channel", got=str(fault.err), wanted="an ONNX network") from fault

    def maps(self, window: ImageArray) -> ChannelMaps:
        """Return the maps of a window (96, 128, 3) uint8 BGR."""
        self._network.setInput(np.ascontiguousarray(window.transpose(2, 0, 1)[None], np.float32))
        neither, aircraft, other, nose = self._network.forward()[0]
        return ChannelMaps(
            aircraft=aircraft - np.logaddexp(neither, other),
            other=other - np.logaddexp(neither, aircraft),
            nose=_probabilities(_SHARPNESS * nose),
        )


def nose_of(nose: Float32Array) -> tuple[FloatArray, FloatArray]:
    """Return mean (2,) and covariance (2, 2) of a nose map, window px."""
    rows, columns = (np.arange(n, dtype=np.float64) for n in nose.shape)
    by_column, by_row = nose.sum(axis=0, dtype=np.float64), nose.sum(axis=1, dtype=np.float64)
    mean = np.array([by_column @ columns, by_row @ rows])
    du, dv = columns - mean[0], rows - mean[1]
    cross = float(dv @ nose.astype(np.float64) @ du)
    return mean, np.array([[float(by_column @ du**2), cross], [cross, float(by_row @ dv**2)]])


def _probabilities(logits: Float32Array) -> Float32Array:
    shifted = np.exp(logits - logits.max())
    return np.asarray(shifted / shifted.sum(), np.float32)
