"""A camera of a station that looks into a `RenderedScene`: raw pictures, and the exact truth of them.

A picture depends on seed, station, time, angles and rates alone; the same again is the same to the last bit. An
object has room to work in: one thread at a time.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray, MaskArray
from groundstation.geometry.rolling_shutter import exposed_row_delay_s, row_delay_s
from groundstation.geometry.rotation import rotation_x, rotation_z
from groundstation.picture import RawPicture
from groundstation.rig.rig import Station
from groundstation.simulation import raster_kernels, render_kernels
from groundstation.simulation.attitude import AircraftPose
from groundstation.simulation.optics import Optics
from groundstation.simulation.parameter_checks import require
from groundstation.simulation.render_primitives import crop_mask, motion_blur_kernel, ray_grid
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scenery import Surroundings, surroundings_of

MAX_SIZE_PX = 8192
_NOISE_STREAM = 301
_NORMALS = 1 << 20
_MAX_LOOKS = 8
_SCALES = (16, 8, 4, 2, 1)
_MAX_SAMPLES = 250_000
_SHUTTER_ROUNDS = 4
_LEAST_MOTION_PX = 0.25
_MAX_MOTION_PX = 400.0
_SHADOW = 0.5  # of the light is taken away


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadMotion:
    """Where a head is at mid-exposure and how it turns: pan and tilt in rad, their rates in rad/s."""

    pan_rad: float
    tilt_rad: float
    pan_rate_rad_s: float = 0.0
    tilt_rate_rad_s: float = 0.0

    def after(self, dt_s: float) -> "HeadMotion":
        """Return the state so much later, s, at constant rates."""
        pan, tilt = self.pan_rad + dt_s * self.pan_rate_rad_s, self.tilt_rad + dt_s * self.tilt_rate_rad_s
        return HeadMotion(
            pan_rad=pan, tilt_rad=tilt, pan_rate_rad_s=self.pan_rate_rad_s, tilt_rate_rad_s=self.tilt_rate_rad_s
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PictureTruth:
    """What a picture truly shows.

    Attributes
    ----------
    pixel_px : (2,) where the nose is; None where it is not in front of the camera.
    visible : whether that is in the picture.
    silhouette : (h, w) which pixels the aircraft covers by half or more, before any blur; (0, 0) where none, or not
        asked for.
    corner_px : x, y of its upper-left pixel.
    """

    pixel_px: FloatArray | None
    visible: bool
    silhouette: MaskArray
    corner_px: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Drawn:
    """The aircraft in a window: ``cover`` (h, w, 4), its corner, and how far its nose moves while exposed, (2,) px."""

    cover: Float32Array
    corner: tuple[int, int]


class RenderedCamera:
    """The camera of one station, as the station truly is.

    Parameters
    ----------
    world : what it looks into.
    station : geometry, lens and rolling shutter; its clock plays no part.
    optics : exposure and sensor.
    seed : of the noise.
    number : distinguishes cameras of one seed.
    around : what `surroundings_of` has drawn for this eye before; None draws it, which takes some seconds.
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
        self._around = surroundings_of(world.scenery, self._eye, focal, grey) if around is None else around
        self._focal = focal
        self._rays = ray_grid(self._geometry.packed, (w, h))
        self._nodes = np.empty((*self._rays.shape[:2], 2))
        self._channels = self.optics.channels
        generator = np.random.default_rng(self._seed)
        self._normals = generator.standard_normal(_NORMALS + w, dtype=np.float32)
        self._light = np.empty((h, w), np.uint16)
        room = max(_MAX_SAMPLES, (w + 2 * self._margin) * (h + 2 * self._margin))
        self._near = np.empty(room, np.float32)
        self._owner = np.empty(room, np.int32)

    def picture(
        self, t_s: float, pan_rad: float, tilt_rad: float, pan_rate_rad_s: float = 0.0, tilt_rate_rad_s: float = 0.0
    ) -> RawPicture:
        """Return the picture exposed around a true session time, s, at true angles and rates, rad and rad/s."""
        head = HeadMotion(
            pan_rad=pan_rad, tilt_rad=tilt_rad, pan_rate_rad_s=pan_rate_rad_s, tilt_rate_rad_s=tilt_rate_rad_s
        )
        self._look_around(head)
        seen = self._moment(t_s, head)
        if seen is not None:
            moment, turned = seen
            pose = self.world.aircraft_at(moment)
            skin = self.world.skin(pose)
            motion = self._motion(moment, turned)
            shadow = self._drawn(self.world.shadow(skin), np.zeros((len(skin), 3)), turned, motion)
            if shadow is not None:
                self._lay(shadow, motion, _SHADOW)
            drawn = self._drawn(skin, self.world.shades(pose, self._eye), turned, motion, self._facing(pose, skin))
            if drawn is not None:
                self._lay(drawn, motion, 1.0)
        return RawPicture(self._exposed(t_s), self.optics.pattern)

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
        nothing = np.zeros((0, 0), dtype=bool)
        seen = self._moment(t_s, head)
        if seen is None:
            return PictureTruth(pixel_px=None, visible=False, silhouette=nothing, corner_px=(0, 0))
        moment, turned = seen
        pixel = self._pixel(moment, turned)
        visible = pixel is not None and self._geometry.contains(pixel)
        mask, corner = self._silhouette(moment, turned) if silhouette else (nothing, (0, 0))
        return PictureTruth(pixel_px=pixel, visible=visible, silhouette=mask, corner_px=corner)

    def _silhouette(self, t_s: float, head: HeadMotion) -> tuple[MaskArray, tuple[int, int]]:
        """Return the aircraft's mask (h, w) and its corner; (0, 0) where it is not in the picture."""
        pose = self.world.aircraft_at(t_s)
        skin = self.world.skin(pose)
        drawn = self._drawn(skin, np.zeros((len(skin), 3)), head, np.zeros(2), self._facing(pose, skin))
        if drawn is None:
            return np.zeros((0, 0), dtype=bool), (0, 0)
        return crop_mask(drawn.cover[:, :, 3] >= 0.5, drawn.corner, self._geometry.image_size_px)

    # -------------------------------------------------------------------------------- the surroundings
    def _look_around(self, head: HeadMotion) -> None:
        """Fill the light with what is behind the aircraft."""
        rows = self._row_times()
        render_kernels.directions(self._rays, self._turns(head, rows), self._nodes)
        exposure = self.optics.exposure_s
        turn = math.hypot(head.pan_rate_rad_s * math.cos(head.tilt_rad), head.tilt_rate_rad_s) * exposure
        looks = min(max(math.ceil(turn * self._focal), 1), _MAX_LOOKS)
        moved = np.zeros_like(self._nodes)
        if looks > 1:
            early, late = np.empty_like(moved), np.empty_like(moved)
            render_kernels.directions(self._rays, self._turns(head, rows - 0.5 * exposure), early)
            render_kernels.directions(self._rays, self._turns(head, rows + 0.5 * exposure), late)
            moved = late - early
            moved[..., 0] = (moved[..., 0] + np.pi) % (2.0 * np.pi) - np.pi
        render_kernels.surroundings(
            self._nodes, moved, looks, self._around.fine, self._around.coarse, self._channels, self._light
        )

    def _row_times(self) -> FloatArray:
        """Return when the rows of nodes are exposed, after the picture's stamp, s."""
        height = self._geometry.image_size_px[1]
        rows = render_kernels.TILE * np.arange(len(self._rays))
        return row_delay_s(np.asarray(rows, dtype=np.float64), height, self.station.readout_s)

    def _turns(self, head: HeadMotion, after_s: FloatArray) -> FloatArray:
        """Return runway_from_camera (n, 3, 3) so much later, s."""
        packed = self._geometry.packed
        base, mounted = packed[0:9].reshape(3, 3), packed[12:21].reshape(3, 3)

        def turn(dt_s: float) -> FloatArray:
            then = head.after(dt_s)
            return np.asarray(base @ rotation_z(then.pan_rad) @ rotation_x(then.tilt_rad) @ mounted)

        if np.ptp(after_s) == 0.0:
            return np.repeat(turn(float(after_s[0]))[None], len(after_s), axis=0)
        return np.array([turn(float(dt_s)) for dt_s in after_s])

    # ------------------------------------------------------------------------------------ the aircraft
    def _pixel(self, t_s: float, head: HeadMotion) -> FloatArray | None:
        """Return where the nose is seen, (2,) px."""
        nose = self.world.trajectory.position(np.array([t_s]))[0]
        projection = self._geometry.project(nose, head.pan_rad, head.tilt_rad)
        return None if projection is None else projection.pixel

    def _moment(self, t_s: float, head: HeadMotion) -> tuple[float, HeadMotion] | None:
        """Return when the nose's row is exposed, and the head then; None if it is not in front."""
        height = self._geometry.image_size_px[1]
        dt = 0.0
        for _ in range(_SHUTTER_ROUNDS if self.station.readout_s else 0):
            pixel = self._pixel(t_s + dt, head.after(dt))
            if pixel is None:
                return None
            dt = float(exposed_row_delay_s(float(pixel[1]), height, self.station.readout_s))
        there = self._pixel(t_s + dt, head.after(dt)) is not None
        return (t_s + dt, head.after(dt)) if there else None

    def _motion(self, t_s: float, head: HeadMotion) -> FloatArray:
        """Return how far the nose moves in the picture within an exposure, (2,) px."""
        half = 0.5 * self.optics.exposure_s
        early, late = self._pixel(t_s - half, head.after(-half)), self._pixel(t_s + half, head.after(half))
        if early is None or late is None:
            return np.zeros(2)
        motion = late - early
        length = float(np.hypot(*motion))
        return motion if length <= _MAX_MOTION_PX else motion * (_MAX_MOTION_PX / length)

    @property
    def _margin(self) -> int:
        return 3 + math.ceil(3.0 * self.optics.blur_px)

    def _facing(self, pose: AircraftPose, skin: FloatArray) -> MaskArray:
        """Return which triangles (n,) show their outer side."""
        normals = self.world.airframe.normals_body @ pose.runway_from_body.T
        return np.asarray(np.einsum("ij,ij->i", normals, self._eye - skin[:, 0]) > 0.0)

    def _drawn(
        self,
        corners_runway_m: FloatArray,
        colours: FloatArray,
        head: HeadMotion,
        motion: FloatArray,
        chosen: MaskArray | None = None,
    ) -> _Drawn | None:
        """Draw triangles (n, 3, 3) into the window that holds them; None where nothing is in the picture."""
        if chosen is not None:
            corners_runway_m, colours = corners_runway_m[chosen], colours[chosen]
        seen = np.empty((len(corners_runway_m) * 3, 3))
        points = np.ascontiguousarray(corners_runway_m.reshape(-1, 3))
        if not raster_kernels.project_corners(self._geometry.packed, points, head.pan_rad, head.tilt_rad, seen):
            return None
        w, h = self._geometry.image_size_px
        margin = self._margin + int(0.5 * np.abs(motion).max())
        # beyond the picture only as far as blur may bring it back in
        low = np.maximum(np.floor(seen[:, :2].min(axis=0)).astype(int) - margin, -margin)
        high = np.minimum(np.ceil(seen[:, :2].max(axis=0)).astype(int) + margin + 1, [w + margin, h + margin])
        width, height = (int(v) for v in high - low)
        if width <= 2 * margin - 1 or height <= 2 * margin - 1:
            return None
        scale = next((s for s in _SCALES if width * height * s * s <= _MAX_SAMPLES), 1)
        shape, room = (height * scale, width * scale), height * width * scale * scale
        if room > self._near.size:
            self._near, self._owner = np.empty(room, np.float32), np.empty(room, np.int32)
        near, owner = self._near[:room].reshape(shape), self._owner[:room].reshape(shape)
        cover = np.empty((height, width, 4), np.float32)
        x0, y0 = int(low[0]), int(low[1])
        raster_kernels.draw(seen.reshape(-1, 3, 3), np.ascontiguousarray(colours), x0, y0, scale, near, owner, cover)
        return _Drawn(cover=cover, corner=(x0, y0))

    def _lay(self, drawn: _Drawn, motion: FloatArray, strength: float) -> None:
        """Blur what was drawn and lay it over the light."""
        cover = drawn.cover
        if float(np.hypot(*motion)) > _LEAST_MOTION_PX:
            cover = np.asarray(
                cv2.filter2D(cover, -1, motion_blur_kernel(motion), borderType=cv2.BORDER_CONSTANT), np.float32
            )
        if self.optics.blur_px > 0.0:
            size = 2 * math.ceil(3.0 * self.optics.blur_px) + 1
            sigma = self.optics.blur_px
            blurred = cv2.GaussianBlur(cover, (size, size), sigma, borderType=cv2.BORDER_CONSTANT)
            cover = np.asarray(blurred, np.float32)
        if self.optics.pattern is None:
            cover[:, :, :3] = (cover[:, :, :3] @ np.array([0.114, 0.587, 0.299], np.float32))[:, :, None]
        if strength != 1.0:
            cover = cover * np.float32(strength)
        render_kernels.cover(cover, *drawn.corner, self._channels, self._light)

    # -------------------------------------------------------------------------------------- the sensor
    def _exposed(self, t_s: float) -> ImageArray:
        """Return the light as the sensor reads it, (h, w)."""
        h, w = self._light.shape
        moment = round(t_s * 1e6) & 0xFFFFFFFFFFFFFFFF
        starts = np.random.default_rng((*self._seed, moment)).integers(0, _NORMALS, h)
        raw = np.empty((h, w), np.uint8)
        render_kernels.expose(self._light, self.optics.brightness, *self.optics.noise, self._normals, starts, raw)
        return raw
