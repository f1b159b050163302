"""Daylight, haze, dusk and night."""

from dataclasses import dataclass

import numpy as np

from groundstation.onboard.scenes.ground import Colour
from groundstation.onboard.scenes.ground_kernel import Illumination


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """How a scene is lit and what the camera makes of it; colours are red, green, blue, linear.

    Attributes
    ----------
    sun, haze, zenith : colours of the light on the ground, of the horizon and of the sky overhead.
    visibility_m : distance over which contrast falls to 1/e.
    cloud_shadow : share of the light that clouds take, 0 to 1.
    cloud_m : size of the shadows across and along the runway.
    skyline_rad : height of woods and hills.
    fall : how much brighter the right border is than the left one, as a share of the middle.
    own_lamp : the aircraft's landing light, at 60 m, in units of ``sun``.
    lamp_power : of the runway's lamps, m²; 0 where they are off.
    gain : exposure. noise, shot_noise : sigmas in grey levels of 255, at black and added at white.
    blur_px : sigma of the optics.
    """

    sun: Colour = (1.0, 0.98, 0.92)
    haze: Colour = (0.62, 0.70, 0.80)
    zenith: Colour = (0.25, 0.42, 0.75)
    visibility_m: float = 6000.0
    cloud_shadow: float = 0.25
    cloud_m: tuple[float, float] = (160.0, 210.0)
    skyline_rad: float = 0.012
    fall: float = 0.0
    own_lamp: float = 0.0
    lamp_power: float = 0.0
    gain: float = 1.0
    noise: float = 1.5
    shot_noise: float = 2.0
    blur_px: float = 0.6

    def illumination(self) -> Illumination:
        """Return what `ground_kernel.render_ground` takes of it."""
        across_m, along_m = self.cloud_m
        return Illumination(
            sun=np.array(self.sun, np.float64),
            haze=np.array(self.haze, np.float64),
            zenith=np.array(self.zenith, np.float64),
            visibility_m=float(self.visibility_m),
            cloud_shadow=float(self.cloud_shadow),
            skyline_rad=float(self.skyline_rad),
            fall=float(self.fall),
            own_lamp=float(self.own_lamp),
            cloud_across_m=float(across_m),
            cloud_along_m=float(along_m),
        )


DAY = Light()
HAZE = Light(
    sun=(0.95, 0.92, 0.85), haze=(0.80, 0.79, 0.76), zenith=(0.6, 0.68, 0.8), visibility_m=700.0, cloud_shadow=0.1
)
DUSK = Light(
    sun=(0.42, 0.27, 0.17), haze=(0.62, 0.36, 0.22), zenith=(0.12, 0.14, 0.28), visibility_m=2500.0, cloud_shadow=0.45,
    fall=0.7, lamp_power=9000.0, gain=1.5, noise=3.0, shot_noise=3.0,
)  # fmt: skip
NIGHT = Light(
    sun=(0.030, 0.034, 0.045), haze=(0.012, 0.014, 0.024), zenith=(0.004, 0.005, 0.012), visibility_m=4000.0,
    cloud_shadow=0.2, own_lamp=0.02, lamp_power=8000.0, gain=4.0, noise=6.0, shot_noise=5.0, blur_px=0.9,
)  # fmt: skip
