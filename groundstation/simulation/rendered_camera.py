"""A station's camera in a `RenderedScene`: raw pictures and their exact truth.

A picture depends on seed, station, time, angles and rates alone; the same again is the same to the last bit. An
object has room to work in: one thread at a time.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray, MaskArray
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.picture import RawPicture
from groundstation.rig.rig import Station
from groundstation.simulation import render_kernels
from groundstation.simulation.backdrop import Backdrop
from groundstation.simulation.body_painter import BodyPainter
from groundstation.simulation.body_raster import BodyRaster, BodyWindow
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.optics import Optics
from groundstation.simulation.parameter_checks import require
from groundstation.simulation.render_primitives import crop_mask, overlap
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scene_body import Body
from groundstation.simulation.scenery import Surroundings, surroundings_of

MAX_SIZE_PX = 8192
_NOISE_STREAM = 301
_NORMALS = 1 << 20
_WHITE = 255.0
_ROUNDING_VARIANCE = 1.0 / 12.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PictureTruth:
    """Truth of a picture.

    Attributes
    ----------
    pixel_px : (2,) where the nose is; None where it is not in front of the camera.
    visible : whether that is in the picture.
    silhouette : (h, w) which pixels the aircraft covers by half or more, before any blur; (0, 0) where none, or not
        asked for.
    corner_px : x, y of its upper-left pixel.
    width_px : width of the box around the whole aircraft, including its parts outside the picture.
    share_in_view : share of the whole silhouette that is inside the picture; 0 if no silhouette is requested.
    visible_share : share of the silhouette inside the picture that neither an object nor traffic hides; likewise.
    """

    pixel_px: FloatArray | None
    visible: bool
    silhouette: MaskArray
    corner_px: tuple[int, int]
    width_px: float = 0.0
    share_in_view: float = 0.0
    visible_share: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shot:
    """A picture, its truth, and the matched filter's signal-to-noise ratio of the aircraft in it.

    ``snr`` is the root of the sum over all pixels of (change of the level by the aircraft / noise)².
    """

    picture: RawPicture
    truth: PictureTruth
    snr: float


class RenderedCamera:
    """The camera of one station, as the station truly is.

    Parameters
    ----------
    world : the rendered scene.
    station : geometry, lens and rolling shutter; its clock plays no part.
    optics : exposure and sensor.
    seed : of the noise.
    number : distinguishes cameras of one seed.
    around : `surroundings_of` this eye, drawn further as the camera turns; None makes it.
    """

    def __init__(
        self,
        world: RenderedScene,
        station: Station,
        optics: Optics | None = None,
        *,
        seed: int = 0,
        number: int = 0,
        around: Surroundings | None = None,
    ) -> None:
        w, h = station.lens.image_size_px
        fits = max(w, h) <= MAX_SIZE_PX
        require(
            fits, f"RenderedCamera: station {station.name}", got=f"{w} × {h} px", wanted=f"at most {MAX_SIZE_PX} px"
        )
        self.world = world
        self.station = station
        self.optics = Optics() if optics is None else optics
        self._geometry = station.geometry()
        self._seed = (seed, _NOISE_STREAM, number)
        self._eye = self._geometry.camera_pose(0.0, 0.0).position_runway_m
        focal = float(station.lens.focal_px.max())
        grey = self.optics.pattern is None
        if around is None:
            around = surroundings_of(world.scenery, self._eye, focal, grey)
        self._around = around
        self._raster = BodyRaster(station, math.hypot(self.optics.blur_px, self.optics.defocus_px))
        self._backdrop = Backdrop(station, self.optics, around)
        self._painter = BodyPainter(world, self._eye, self._raster, self._backdrop, self.optics)
        generator = np.random.default_rng(self._seed)
        self._normals = generator.standard_normal(_NORMALS + w, dtype=np.float32)
        self._light = np.empty((h, w), np.uint16)
        self._kept: Float32Array | None = None
        if self.optics.vignetting or self.optics.flicker:
            self._kept = self.optics.vignette((w, h), (0.5 * (w - 1), 0.5 * (h - 1)))

    def draw_surroundings(self) -> None:
        """Draw all of the surroundings, so that no picture has to wait for a part of them; takes some seconds."""
        self._around.draw_all()

    def picture(
        self, t_s: float, pan_rad: float, tilt_rad: float, pan_rate_rad_s: float = 0.0, tilt_rate_rad_s: float = 0.0
    ) -> RawPicture:
        """Return the picture exposed around a true session time, s, at true angles and rates, rad and rad/s."""
        head = HeadMotion(
            pan_rad=pan_rad, tilt_rad=tilt_rad, pan_rate_rad_s=pan_rate_rad_s, tilt_rate_rad_s=tilt_rate_rad_s
        )
        self._backdrop.face(t_s, head)
        self._backdrop.fill(self._light)
        self._painter.paint(t_s, head, self._light)
        return RawPicture(self._exposed(t_s), self.optics.pattern)

    def film(
        self, t_s: float, pan_rad: float, tilt_rad: float, pan_rate_rad_s: float = 0.0, tilt_rate_rad_s: float = 0.0
    ) -> Shot:
        """Return the picture of the same arguments with its truth, and how well the aircraft shows in it."""
        head = HeadMotion(
            pan_rad=pan_rad, tilt_rad=tilt_rad, pan_rate_rad_s=pan_rate_rad_s, tilt_rate_rad_s=tilt_rate_rad_s
        )
        self._backdrop.face(t_s, head)
        self._backdrop.fill(self._light)
        change = self._painter.paint(t_s, head, self._light, measured=True)
        picture = RawPicture(self._exposed(t_s), self.optics.pattern)
        return Shot(picture=picture, truth=self._truth(t_s, head, silhouette=True), snr=self._snr(change, t_s))

    def truth(
        self,
        t_s: float,
        pan_rad: float,
        tilt_rad: float,
        pan_rate_rad_s: float = 0.0,
        tilt_rate_rad_s: float = 0.0,
        *,
        silhouette: bool = True,
    ) -> PictureTruth:
        """Return what the picture of the same arguments truly shows; quick where no silhouette is wanted."""
        head = HeadMotion(
            pan_rad=pan_rad, tilt_rad=tilt_rad, pan_rate_rad_s=pan_rate_rad_s, tilt_rate_rad_s=tilt_rate_rad_s
        )
        if silhouette:
            self._backdrop.face(t_s, head)
        return self._truth(t_s, head, silhouette)

    def bodies(
        self, t_s: float, pan_rad: float, tilt_rad: float, pan_rate_rad_s: float = 0.0, tilt_rate_rad_s: float = 0.0
    ) -> list[tuple[Body, BodyWindow]]:
        """Return the bodies in the picture of the same arguments, the nearest first, where nothing nearer hides them.

        The last plane of a cover (h, w, 4) is the share of each pixel, before any blur. The target is one of them.
        """
        head = HeadMotion(
            pan_rad=pan_rad, tilt_rad=tilt_rad, pan_rate_rad_s=pan_rate_rad_s, tilt_rate_rad_s=tilt_rate_rad_s
        )
        self._backdrop.face(t_s, head)
        return self._painter.unhidden(t_s, head)

    @property
    def target(self) -> Body:
        """The aircraft that lands, as `bodies` returns it."""
        return self._painter.target

    def _truth(self, t_s: float, head: HeadMotion, silhouette: bool) -> PictureTruth:
        nothing = np.zeros((0, 0), dtype=bool)
        target = self._painter.target
        seen = self._raster.exposed(target, t_s, head, self.optics.exposure_at(t_s))
        if seen is None:
            return PictureTruth(pixel_px=None, visible=False, silhouette=nothing, corner_px=(0, 0))
        visible = self._geometry.contains(seen.pixel_px)
        sharp = self._painter.silhouette(target, seen) if silhouette else None
        if sharp is None:
            return PictureTruth(pixel_px=seen.pixel_px, visible=visible, silhouette=nothing, corner_px=(0, 0))
        mask, corner = crop_mask(sharp.cover[:, :, 3] >= 0.5, sharp.corner, self._geometry.image_size_px)
        width, in_view = self._raster.extent(target.skin(seen.t_s), seen)
        return PictureTruth(
            pixel_px=seen.pixel_px,
            visible=visible,
            silhouette=mask,
            corner_px=corner,
            width_px=width,
            share_in_view=in_view if mask.size else 0.0,
            visible_share=self._painter.visible_share(mask, corner, seen, t_s),
        )

    def _levels(self, t_s: float) -> Float32Array:
        """Return the grey levels (h, w) to one of the scenery, in the picture of a time, s."""
        h, w = self._light.shape
        rows = t_s + row_delay_s(np.arange(h, dtype=np.float64), h, self.station.readout_s)
        gain = np.float32(self.optics.brightness_at(t_s)) * self.optics.flicker_at(rows)
        kept = np.ones((h, w), np.float32) if self._kept is None else self._kept
        return np.asarray(gain[:, None] * kept)

    def _snr(self, change: BodyWindow | None, t_s: float) -> float:
        """Return how well a change of the light shows: its levels over the noise of the levels there."""
        if change is None:
            return 0.0
        both = overlap(change.cover, change.corner, self._light, (0, 0))
        if both is None:
            return 0.0
        gain = self._levels(t_s)[both[1]]
        after = self._light[both[1]] / 64.0 * gain
        before = after - change.cover[both[0]] * gain
        slope, floor = self.optics.noise
        shown, behind = np.minimum(after, _WHITE), np.clip(before, 0.0, _WHITE)
        variance = slope * behind + floor + _ROUNDING_VARIANCE
        return float(math.sqrt(float(((shown - behind) ** 2 / variance).sum())))

    def _exposed(self, t_s: float) -> ImageArray:
        """Return the light as the sensor reads it, (h, w)."""
        h, w = self._light.shape
        moment = round(t_s * 1e6) & 0xFFFFFFFFFFFFFFFF
        starts = np.random.default_rng((*self._seed, moment)).integers(0, _NORMALS, h)
        raw = np.empty((h, w), np.uint8)
        brightness, noise = self.optics.brightness_at(t_s), self.optics.noise
        if self._kept is None:
            render_kernels.expose(self._light, brightness, *noise, self._normals, starts, raw)
            return raw
        rows = t_s + row_delay_s(np.arange(h, dtype=np.float64), h, self.station.readout_s)
        gain = np.float32(brightness) * self.optics.flicker_at(rows)
        render_kernels.expose_unevenly(self._light, self._kept, gain, *noise, self._normals, starts, raw)
        return raw
