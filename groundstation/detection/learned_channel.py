"""The learned channel: a small network that tells aircraft from what lies behind it, and where the nose is.

It was trained by `training/` on drawn aircraft over drawn and real backgrounds; its card is docs/learned-channel.md.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.detection.channel_window import WINDOW_PX
from groundstation.errors import InputError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

# the trained map is too flat: with this exponent the noses of thirty train worlds not trained on (342 windows)
# are most likely (normalised square: median 0.8, 90 % below 4.8; 0.5 and 2.7 without it)
_SHARPNESS = 1.5
# added to the log odds. Aircraft a few pixels wide cover parts of pixels, and are seldom even odds by what was learned.
# Of 0, 0.6, 0.9 and 1.3 it gives most hits on 56 train worlds not trained on, with as many false responses in windows
# elsewhere as the weights before (0.5 %)
_ODDS_OFFSET = np.float32(0.9)
# neither, aircraft, other flying things, nose
_MAPS = 4
_WANTED = f"an ONNX network from windows (1, 3, {WINDOW_PX[1]}, {WINDOW_PX[0]}) to maps of four"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelMaps:
    """What the network gives for a window.

    Attributes
    ----------
    aircraft : (96, 128) float32, logarithm of the odds of aircraft against everything else.
    nose : (96, 128) float32, probability that the nose is at the pixel; its sum is 1, wherever it may be.
    """

    aircraft: Float32Array
    nose: Float32Array


class LearnedChannel:
    """The network, on the thread that asks; all cameras of a process share what its weights are read into.

    ONNX Runtime takes 2.0 ms a window where OpenCV's DNN module takes 3.7 ms (2026-11, one core of a busy machine).

    Parameters
    ----------
    weights : content of an ONNX file, as `groundstation.files.channel_weights` reads it.

    Raises `InputError` where that is no network.
    """

    def __init__(self, weights: bytes) -> None:
        self._weights = weights
        self._network = _network(weights)

    def __reduce__(self) -> tuple[type["LearnedChannel"], tuple[bytes]]:
        # a session of ONNX Runtime cannot be copied
        return LearnedChannel, (self._weights,)

    def maps(self, window: ImageArray) -> ChannelMaps:
        """Return the maps of a window (96, 128, 3) uint8 BGR."""
        return self._maps_of(self._raw(window)[0])

    def maps_with_aircraft(self, window: ImageArray) -> ChannelMaps | None:
        """Return the maps of a window, None where no pixel of it is more likely aircraft than not."""
        raw = self._raw(window)[0]
        # cheaper than the odds, which are lower
        if not bool(np.any(raw[1] + _ODDS_OFFSET > np.maximum(raw[0], raw[2]))):
            return None
        maps = self._maps_of(raw)
        return maps if float(maps.aircraft.max()) > 0.0 else None

    def _maps_of(self, raw: Float32Array) -> ChannelMaps:
        """Return the maps of the network's output (4, 96, 128)."""
        aircraft, nose = (np.empty(raw.shape[1:], np.float32) for _ in range(2))
        _odds(raw, _ODDS_OFFSET, aircraft)
        _probabilities(raw[3], _SHARPNESS, nose)
        return ChannelMaps(aircraft=aircraft, nose=nose)

    def _raw(self, window: ImageArray) -> Float32Array:
        return _run(self._network, window)


@lru_cache(maxsize=4)
def _network(weights: bytes) -> "InferenceSession":
    """Return a session of ONNX Runtime, which several threads may use at a time; it takes 20 ms to make."""
    # a quarter of a second to import, which only those pay who use it
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    w, h = WINDOW_PX
    try:
        network = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
        shape = _run(network, np.zeros((h, w, 3), np.uint8)).shape
    except Exception as fault:
        # its own exceptions have no common class but this
        raise InputError(
            "weights of the learned channel", got="a file that ONNX Runtime cannot run", wanted=_WANTED
        ) from fault
    if shape != (1, _MAPS, h, w):
        raise InputError("weights of the learned channel", got=f"maps of shape {shape}", wanted=_WANTED)
    return network


def _run(network: "InferenceSession", window: ImageArray) -> Float32Array:
    """Return a network's maps (1, 4, h, w) of a window (h, w, 3)."""
    levels = np.ascontiguousarray(window.transpose(2, 0, 1)[None], np.float32)
    return np.asarray(network.run(None, {network.get_inputs()[0].name: levels})[0], np.float32)


@njit(cache=True, nogil=True)
def _odds(raw: Float32Array, offset: np.float32, aircraft: Float32Array) -> None:
    """Fill the log odds (h, w) of aircraft from the logits (3, h, w) of neither, aircraft, other flying things."""
    for i in range(raw.shape[1]):
        for j in range(raw.shape[2]):
            n, a, o = raw[0, i, j], raw[1, i, j] + offset, raw[2, i, j]
            aircraft[i, j] = a - max(n, o) - math.log1p(math.exp(-abs(n - o)))


@njit(cache=True, nogil=True)
def _probabilities(logits: Float32Array, sharpness: float, out: Float32Array) -> None:
    """Fill a map (h, w) with the softmax of its logits times the sharpness."""
    most = logits.max()
    total = 0.0
    for i in range(logits.shape[0]):
        for j in range(logits.shape[1]):
            value = math.exp(sharpness * (logits[i, j] - most))
            out[i, j] = value
            total += value
    for i in range(logits.shape[0]):
        for j in range(logits.shape[1]):
            out[i, j] /= total


def nose_of(nose: Float32Array) -> tuple[FloatArray, FloatArray]:
    """Return mean (2,) and covariance (2, 2) of a nose map, window px."""
    rows, columns = (np.arange(n, dtype=np.float64) for n in nose.shape)
    by_column, by_row = nose.sum(axis=0, dtype=np.float64), nose.sum(axis=1, dtype=np.float64)
    mean = np.array([by_column @ columns, by_row @ rows])
    du, dv = columns - mean[0], rows - mean[1]
    cross = float(dv @ nose.astype(np.float64) @ du)
    return mean, np.array([[float(by_column @ du**2), cross], [cross, float(by_row @ dv**2)]])
