"""Levels of an 8-bit picture to light and back, with a display's exponent and a camera's shoulder."""

import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray

# of sRGB as a whole; the cameras of the clips are consumer ones
_GAMMA = 2.2
# above this share of the full level a camera's curve bends towards white
_SHOULDER = 0.7
_LIGHT_OF_LEVEL = ((np.arange(256) / 255.0) ** _GAMMA).astype(np.float32)


def light_of(image: ImageArray) -> Float32Array:
    """Return the light of levels, 1 at 255."""
    return np.asarray(_LIGHT_OF_LEVEL[image])


def levels_of(light: Float32Array) -> Float32Array:
    """Return the levels, not rounded, of light."""
    return np.asarray(np.float32(255.0) * np.clip(light, 0.0, 1.0) ** np.float32(1.0 / _GAMMA), np.float32)


def reflectance_of(colours_bgr: FloatArray) -> FloatArray:
    """Return the share of light that paint of these colours, 0 to 255 in full light, throws back."""
    return np.asarray((colours_bgr / 255.0) ** _GAMMA)


def with_shoulder(light: FloatArray) -> FloatArray:
    """Return light by the camera's response curve, which approaches white asymptotically."""
    over = np.maximum(light - _SHOULDER, 0.0) / (1.0 - _SHOULDER)
    return np.asarray(np.where(light > _SHOULDER, _SHOULDER + (1.0 - _SHOULDER) * (1.0 - np.exp(-over)), light))
