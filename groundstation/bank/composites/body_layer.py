"""One drawn body as a layer over a real picture: its light and its cover in a window."""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import Float32Array, FloatArray
from groundstation.bank.composites.composite_light import CompositeLight
from groundstation.simulation.body_raster import BodyExposure, BodyRaster, BodyWindow
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.render_primitives import merged
from groundstation.simulation.scene_body import Body, Skin


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyLayer:
    """A body in one picture.

    Attributes
    ----------
    away_m : how far its place is from the eye.
    exposure : where and how it is exposed.
    drawn : its light times cover, and its cover, with all blur, (h, w, 4); linear light.
    """

    away_m: float
    exposure: BodyExposure
    drawn: BodyWindow

    @property
    def cover(self) -> Float32Array:
        """Coverage (h, w) of each pixel, 0 to 1."""
        return self.drawn.cover[:, :, 3]


class LayerPainter:
    """Draws bodies as layers of one camera's pictures.

    Parameters
    ----------
    raster : of the camera; blurs as the clip is blurred.
    eye_runway_m : (3,) of the camera.
    light : of the clip.
    """

    def __init__(self, raster: BodyRaster, eye_runway_m: FloatArray, light: CompositeLight) -> None:
        self._raster, self._eye, self._light = raster, eye_runway_m, light

    def layer(self, body: Body, t_s: float, head: HeadMotion, exposure_s: float) -> BodyLayer | None:
        """Return a body's layer; None where it is not in the picture."""
        seen = self._raster.exposed(body, t_s, head, exposure_s)
        if seen is None:
            return None
        away = float(np.linalg.norm(body.place(seen.t_s) - self._eye))
        instants = self._raster.instants(body, seen)
        windows = []
        for dt_s in instants:
            then = replace(
                seen, t_s=seen.t_s + dt_s, head=seen.head.after(dt_s), motion_px=seen.motion_px / len(instants)
            )
            skin = body.skin(then.t_s)
            drawn = self._window(skin, self._light.shades(skin, away), then)
            if drawn is not None:
                windows.append(self._raster.blurred(drawn, then.motion_px))
        if not windows:
            return None
        cover, corner = merged([(w.cover, w.corner) for w in windows], len(instants))
        return BodyLayer(away_m=away, exposure=seen, drawn=BodyWindow(cover=cover, corner=corner))

    def outline(self, body: Body, seen: BodyExposure) -> BodyWindow | None:
        """Draw a body without any blur or colours; None where it is not in the picture."""
        skin = body.skin(seen.t_s)
        return self._window(skin, np.zeros((len(skin.opacity), 3)), replace(seen, motion_px=np.zeros(2)))

    def extent(self, body: Body, seen: BodyExposure) -> tuple[float, float]:
        """Return the width of a body's whole outline, px, and the share of it in the picture."""
        width, share = self._raster.extent(body.skin(seen.t_s), seen)
        return (width, share) if math.isfinite(width) else (0.0, 0.0)

    def _window(self, skin: Skin, light_bgr: FloatArray, seen: BodyExposure) -> BodyWindow | None:
        chosen = self._raster.facing(skin, self._eye)
        shown = Skin(
            corners_runway_m=skin.corners_runway_m[chosen],
            normals_runway=skin.normals_runway[chosen],
            colours_bgr=skin.colours_bgr[chosen],
            opacity=skin.opacity[chosen],
        )
        return self._raster.window(shown, light_bgr[chosen], seen)
