"""Sensor model of a rendered camera: exposure, gain, blur, noise, colour pattern."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import Float32Array
from groundstation.picture import BayerPattern
from groundstation.simulation.parameter_checks import (
    require,
    require_finite,
    require_not_negative,
    require_positive,
)

# a scenery's colours are what this exposure shows with gain 1
REFERENCE_EXPOSURE_S = 0.003
_CHANNELS = {
    None: ((1, 1), (1, 1)),
    BayerPattern.RG: ((2, 1), (1, 0)),
    BayerPattern.GR: ((1, 2), (0, 1)),
    BayerPattern.GB: ((1, 0), (2, 1)),
    BayerPattern.BG: ((0, 1), (1, 2)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExposureStep:
    """From ``t_s`` on, true session time, light is gathered ``factor`` times as long as at the start."""

    t_s: float
    factor: float

    def __post_init__(self) -> None:
        require_finite("ExposureStep: t_s", self.t_s)
        require_positive("ExposureStep: factor", self.factor)


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """Exposure and sensor of a rendered camera.

    Attributes
    ----------
    pattern : colours of the sensor's upper-left four pixels; None is a grey camera.
    exposure_s : how long light is gathered; motion within it blurs.
    gain : grey levels are light × exposure / `REFERENCE_EXPOSURE_S` × gain.
    electrons_per_level : of one grey level at gain 1; shot noise is their square root.
    read_noise_electrons : one sigma of every pixel.
    blur_px : one sigma of the lens's blur of the aircraft; the surroundings are blurred by their interpolation.
    defocus_px : one sigma of a blur of everything, by a lens that is not focused.
    vignetting : share of light that a corner loses; a point at r corner radii has 1/(1 + a r²)² of the centre's,
        as by the cos⁴ law.
    flicker, flicker_hz : amplitude, as a share of the brightness, and frequency of its variation; each row has its own.
    exposure_steps : of the automatic exposure, in order of time.
    """

    pattern: BayerPattern | None = BayerPattern.RG
    exposure_s: float = REFERENCE_EXPOSURE_S
    gain: float = 1.0
    electrons_per_level: float = 40.0
    read_noise_electrons: float = 12.0
    blur_px: float = 0.6
    defocus_px: float = 0.0
    vignetting: float = 0.0
    flicker: float = 0.0
    flicker_hz: float = 1.0
    exposure_steps: tuple[ExposureStep, ...] = ()

    def __post_init__(self) -> None:
        require_positive("Optics: exposure_s", self.exposure_s)
        require_positive("Optics: gain", self.gain)
        require_positive("Optics: electrons_per_level", self.electrons_per_level)
        require_not_negative("Optics: read_noise_electrons", self.read_noise_electrons)
        require_not_negative("Optics: blur_px", self.blur_px)
        require_not_negative("Optics: defocus_px", self.defocus_px)
        for name in ("vignetting", "flicker"):
            value = getattr(self, name)
            require(0.0 <= value < 1.0, f"Optics: {name}", got=value, wanted="a number from 0 to below 1")
        require_positive("Optics: flicker_hz", self.flicker_hz)
        times = [step.t_s for step in self.exposure_steps]
        require(times == sorted(set(times)), "Optics: exposure_steps", got=f"times {times}", wanted="rising times")

    def exposure_at(self, t_s: float) -> float:
        """Return how long light is gathered around a time, s, as the automatic exposure has it by then."""
        factors = [step.factor for step in self.exposure_steps if step.t_s <= t_s]
        return self.exposure_s * factors[-1] if factors else self.exposure_s

    def brightness_at(self, t_s: float) -> float:
        """Return the grey levels of a picture, time in s, to one of the scenery; without flicker."""
        return self.gain * self.exposure_at(t_s) / REFERENCE_EXPOSURE_S

    def flicker_at(self, t_s: NDArray[np.float64]) -> Float32Array:
        """Return by how much rows that are exposed at times (n,), s, are brighter, about 1."""
        return (1.0 + self.flicker * np.sin(2.0 * math.pi * self.flicker_hz * t_s)).astype(np.float32)

    def vignette(self, size_px: tuple[int, int], centre_px: tuple[float, float]) -> Float32Array:
        """Return the share of light (h, w) that each pixel of a picture of so many (w, h) keeps."""
        w, h = size_px
        u, v = np.arange(w) - centre_px[0], np.arange(h) - centre_px[1]
        radius2 = (v * v)[:, None] + u * u
        at_corner = 1.0 / math.sqrt(1.0 - self.vignetting) - 1.0
        return ((1.0 + at_corner * radius2 / (0.25 * (w * w + h * h))) ** -2.0).astype(np.float32)

    @property
    def channels(self) -> NDArray[np.int64]:
        """Index of B, G, R of a pixel, (2, 2) by even and odd row and column."""
        return np.array(_CHANNELS[self.pattern])

    @property
    def noise(self) -> tuple[float, float]:
        """Return slope and floor of the noise's variance over the grey level: shot noise and read noise, levels²."""
        per_level = self.electrons_per_level / self.gain
        return 1.0 / per_level, (self.read_noise_electrons / per_level) ** 2
