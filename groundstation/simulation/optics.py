"""Sensor model of a rendered camera: exposure, gain, blur, noise, colour pattern."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.picture import BayerPattern
from groundstation.simulation.parameter_checks import require_not_negative, require_positive

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
    """

    pattern: BayerPattern | None = BayerPattern.RG
    exposure_s: float = REFERENCE_EXPOSURE_S
    gain: float = 1.0
    electrons_per_level: float = 40.0
    read_noise_electrons: float = 12.0
    blur_px: float = 0.6

    def __post_init__(self) -> None:
        require_positive("Optics: exposure_s", self.exposure_s)
        require_positive("Optics: gain", self.gain)
        require_positive("Optics: electrons_per_level", self.electrons_per_level)
        require_not_negative("Optics: read_noise_electrons", self.read_noise_electrons)
        require_not_negative("Optics: blur_px", self.blur_px)

    @property
    def brightness(self) -> float:
        """Grey levels of the picture to one of the scenery."""
        return self.gain * self.exposure_s / REFERENCE_EXPOSURE_S

    @property
    def channels(self) -> NDArray[np.int64]:
        """Which of B, G, R a pixel has, (2, 2) by even and odd row and column."""
        return np.array(_CHANNELS[self.pattern])

    @property
    def noise(self) -> tuple[float, float]:
        """Return slope and floor of the noise's variance over the grey level: shot noise and read noise, levels²."""
        per_level = self.electrons_per_level / self.gain
        return 1.0 / per_level, (self.read_noise_electrons / per_level) ** 2
