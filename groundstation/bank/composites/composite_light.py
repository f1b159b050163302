"""The light of a clip on drawn bodies: its sky from above, its ground from below, and a sun where its sky is clear.

Light is linear, 1 at level 255. A white skin (reflectance 1) under a sky that is the same everywhere shows the sky's
light; one that faces down reflects the ground's.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.bank.composites.composite_spec import CompositeSun
from groundstation.bank.composites.linear_light import reflectance_of, with_shoulder
from groundstation.bank.composites.picture_light import PictureLight
from groundstation.simulation.scene_body import Skin

# of grass and bare soil in B, G, R, where a clip shows no ground
_ALBEDO = np.array([0.06, 0.11, 0.12])
# of a sun 10 to 50° high against a white that its own light makes neutral, B, G, R
_SUN_BGR = np.array([0.88, 0.97, 1.0])
# Koschmieder: visibility is where 2 % of a contrast are left, ln 50
_VISIBILITY_LOG = math.log(50.0)


class CompositeLight:
    """Shades skins in the light of a clip.

    Parameters
    ----------
    shown : what the clip shows of its light.
    sun : what it does not.
    """

    def __init__(self, shown: PictureLight, sun: CompositeSun) -> None:
        self._sky = sun.ambient * shown.sky_bgr
        self._sun = shown.clearness * sun.strength * shown.sky_luminance * _SUN_BGR
        self._towards_sun = sun.direction_runway
        lit = self._sky + max(float(self._towards_sun[2]), 0.0) * self._sun
        self._ground = _ALBEDO * lit if shown.ground_bgr is None else shown.ground_bgr
        self._air = shown.sky_bgr
        self._visibility_m = sun.visibility_m

    def shades(self, skin: Skin, away_m: float) -> FloatArray:
        """Return the light (n, 3) BGR that comes from a skin so far away, m, haze included, below 1."""
        up = skin.normals_runway[:, 2:]
        facing = np.maximum(skin.normals_runway @ self._towards_sun, 0.0)[:, None]
        falling = 0.5 * (1.0 + up) * self._sky + 0.5 * (1.0 - up) * self._ground + facing * self._sun
        own = with_shoulder(reflectance_of(skin.colours_bgr) * falling)
        clear = math.exp(-_VISIBILITY_LOG * away_m / self._visibility_m)
        return np.asarray(clear * own + (1.0 - clear) * self._air)
