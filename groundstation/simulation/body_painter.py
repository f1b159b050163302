"""Bodies laid over a picture's light, far ones first, where no object of the surroundings hides them."""

from dataclasses import replace

import numpy as np

from groundstation.arrays import Float32Array, FloatArray, MaskArray
from groundstation.simulation import render_kernels
from groundstation.simulation.backdrop import Backdrop
from groundstation.simulation.body_raster import BodyExposure, BodyRaster, BodyWindow
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.optics import Optics
from groundstation.simulation.render_primitives import merged, overlap
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scene_body import Body, PointLight, Skin

_LUMINANCE = np.array([0.114, 0.587, 0.299], np.float32)


class BodyPainter:
    """Draws the bodies of a scene from one camera.

    Parameters
    ----------
    world : the scene.
    eye_runway_m : (3,) the camera with the head at rest.
    raster, backdrop : of the same station.
    optics : exposure and sensor.
    """

    def __init__(
        self, world: RenderedScene, eye_runway_m: FloatArray, raster: BodyRaster, backdrop: Backdrop, optics: Optics
    ) -> None:
        self._world = world
        self._eye = eye_runway_m
        self._raster = raster
        self._backdrop = backdrop
        self._optics = optics
        self._channels = optics.channels
        self.target = world.target()

    def paint(self, t_s: float, head: HeadMotion, light: np.ndarray, measured: bool = False) -> BodyWindow | None:
        """Lay all bodies over the light (h, w); return how the target alone has changed it, where measured."""
        seen: list[tuple[float, Body, BodyExposure]] = []
        for body in (self.target, *self._world.traffic):
            expose = self._raster.exposed if body is self.target else self._raster.exposed_in_view
            exposure = expose(body, t_s, head, self._optics.exposure_at(t_s))
            if exposure is None:
                continue
            if body.casts_shadow:
                self._lay_shadow(body, exposure, light)
            seen.append((self._away(body, exposure), body, exposure))
        change: BodyWindow | None = None
        for away, body, exposure in sorted(seen, key=lambda item: -item[0]):
            drawn = self._smeared(body, exposure, away)
            if drawn is None:
                continue
            if measured and body is self.target:
                before = self._light_in(drawn, light)
                self._lay(drawn, light)
                change = BodyWindow(cover=self._light_in(drawn, light) - before, corner=drawn.corner)
                continue
            both = None if change is None else overlap(change.cover, change.corner, drawn.cover, drawn.corner)
            if change is not None and both is not None:
                change.cover[both[0]] *= 1.0 - drawn.cover[:, :, 3][both[1]]
            self._lay(drawn, light)
        return change

    def silhouette(self, body: Body, seen: BodyExposure) -> BodyWindow | None:
        """Draw a body without any blur or colours; None where it is not in the picture."""
        skin = body.skin(seen.t_s)
        still = replace(seen, motion_px=np.zeros(2))
        return self._window(skin, np.zeros((len(skin.opacity), 3)), still)

    def unhidden(self, t_s: float, head: HeadMotion) -> list[tuple[Body, BodyWindow]]:
        """Return the silhouette of each body in the picture where nothing nearer hides it, the nearest body first.

        The cover's last plane is the share of each pixel, before any blur. The backdrop must face the head.
        """
        seen: list[tuple[float, Body, BodyExposure]] = []
        for body in (self.target, *self._world.traffic):
            exposure = self._raster.exposed_in_view(body, t_s, head, self._optics.exposure_at(t_s))
            if exposure is not None:
                seen.append((self._away(body, exposure), body, exposure))
        found: list[tuple[Body, BodyWindow]] = []
        for away, body, exposure in sorted(seen, key=lambda item: item[0]):
            sharp = self.silhouette(body, exposure)
            if sharp is None:
                continue
            cover = self._over_objects(sharp, away).cover.copy()
            left = np.ones((*cover.shape[:2], 1), np.float32)
            for _, nearer in found:
                both = overlap(left, sharp.corner, nearer.cover, nearer.corner)
                if both is not None:
                    left[both[0]] -= nearer.cover[:, :, 3:][both[1]]
            cover *= left.clip(0.0, 1.0)
            found.append((body, BodyWindow(cover=cover, corner=sharp.corner)))
        return found

    def visible_share(self, mask: MaskArray, corner: tuple[int, int], seen: BodyExposure, t_s: float) -> float:
        """Return the share of the target's silhouette (h, w), as exposed, that nothing nearer hides."""
        if mask.size == 0:
            return 0.0
        left = mask.copy()
        away = self._away(self.target, seen)
        free = self._backdrop.unhidden(mask.shape, corner, away)
        if free is not None:
            left &= free >= 0.5
        # the head as at the picture's stamp
        head = seen.head.after(t_s - seen.t_s)
        for body in self._world.traffic:
            other = self._raster.exposed_in_view(body, t_s, head, seen.exposure_s)
            if other is None or self._away(body, other) >= away:
                continue
            sharp = self.silhouette(body, other)
            both = None if sharp is None else overlap(mask, corner, sharp.cover, sharp.corner)
            if sharp is not None and both is not None:
                left[both[0]] &= sharp.cover[:, :, 3][both[1]] < 0.5
        return float(left.sum() / mask.sum())

    def _away(self, body: Body, seen: BodyExposure) -> float:
        return float(np.linalg.norm(body.place(seen.t_s) - self._eye))

    def _window(
        self, skin: Skin, colours: FloatArray, seen: BodyExposure, lights: tuple[PointLight, ...] = ()
    ) -> BodyWindow | None:
        """Draw the sides of a skin that face the eye."""
        chosen = self._raster.facing(skin, self._eye)
        shown = Skin(
            corners_runway_m=skin.corners_runway_m[chosen],
            normals_runway=skin.normals_runway[chosen],
            colours_bgr=skin.colours_bgr[chosen],
            opacity=skin.opacity[chosen],
        )
        return self._raster.window(shown, colours[chosen], seen, lights)

    def _lay_shadow(self, body: Body, seen: BodyExposure, light: np.ndarray) -> None:
        skin = body.skin(seen.t_s)
        solid = skin.opacity >= 1.0
        on_ground = replace(
            skin,
            corners_runway_m=self._world.shadow(skin.corners_runway_m[solid]),
            opacity=skin.opacity[solid],
        )
        drawn = self._raster.window(on_ground, np.zeros((len(on_ground.opacity), 3)), seen)
        if drawn is None:
            return
        middle = on_ground.corners_runway_m.mean(axis=(0, 1))
        drawn = self._over_objects(
            self._raster.blurred(drawn, seen.motion_px), float(np.linalg.norm(middle - self._eye))
        )
        cover = drawn.cover * np.float32(self._world.shadow_strength)
        self._lay(BodyWindow(cover=cover, corner=drawn.corner), light)

    def _smeared(self, body: Body, seen: BodyExposure, away_m: float) -> BodyWindow | None:
        """Draw a body over its exposure; at several instants where its parts move differently."""
        instants = self._raster.instants(body, seen)
        windows = []
        for dt_s in instants:
            then = replace(
                seen, t_s=seen.t_s + dt_s, head=seen.head.after(dt_s), motion_px=seen.motion_px / len(instants)
            )
            skin = body.skin(then.t_s)
            clear = self._world.transmission(away_m)
            lights = tuple(
                replace(lamp, candela_bgr=clear * lamp.candela_bgr) for lamp in body.lights(then.t_s, self._eye)
            )
            drawn = self._window(skin, self._world.shades(skin, body.place(seen.t_s) - self._eye), then, lights)
            if drawn is not None:
                windows.append(self._raster.blurred(drawn, then.motion_px))
        if not windows:
            return None
        whole = merged([(w.cover, w.corner) for w in windows], len(instants))
        drawn = BodyWindow(cover=whole[0], corner=whole[1])
        if self._optics.pattern is None:
            drawn.cover[:, :, :3] = (drawn.cover[:, :, :3] @ _LUMINANCE)[:, :, None]
        return self._over_objects(drawn, away_m)

    def _over_objects(self, drawn: BodyWindow, away_m: float) -> BodyWindow:
        """Return a window without the parts that nearer objects hide."""
        free = self._backdrop.unhidden(drawn.cover.shape, drawn.corner, away_m)
        return drawn if free is None else BodyWindow(cover=drawn.cover * free[:, :, None], corner=drawn.corner)

    def _lay(self, drawn: BodyWindow, light: np.ndarray) -> None:
        render_kernels.cover(drawn.cover, *drawn.corner, self._channels, light)

    def _light_in(self, drawn: BodyWindow, light: np.ndarray) -> Float32Array:
        """Return the light of a window (h, w), in scenery's levels; 0 outside the picture."""
        found = np.zeros(drawn.cover.shape[:2], np.float32)
        both = overlap(found, drawn.corner, light, (0, 0))
        if both is not None:
            found[both[0]] = light[both[1]] / np.float32(64.0)
        return found
