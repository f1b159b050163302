"""Bodies in a camera's picture: where and when they are exposed, how far they move, and their triangles in a window."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, MaskArray
from groundstation.geometry.rolling_shutter import exposed_row_delay_s
from groundstation.rig.rig import Station
from groundstation.simulation import raster_kernels
from groundstation.simulation.airframes.airframe import SUNLIT_WHITE_CD_M2
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.raster_kernels import SampleGrid
from groundstation.simulation.render_primitives import motion_blur_kernel
from groundstation.simulation.scene_body import Body, PointLight, Skin

_SCALES = (16, 8, 4, 2, 1)
_MAX_SAMPLES = 250_000
_SHUTTER_ROUNDS = 4
_LEAST_MOTION_PX = 0.25
_MAX_MOTION_PX = 400.0
# a body is drawn at several instants if the motion blur of its corners differs by more than this from its place's
_SMEAR_PX = 1.0
_MAX_INSTANTS = 4
# the grey level at which a white skin in full sun is shown
_SUNLIT_WHITE_LEVEL = 205.0
# how far behind the skin's surface a lamp may lie and still be seen
_LAMP_DEPTH_M = 0.15
_WHOLE_SIDE_PX = 400.0
# how far off the axis the corners of a picture are at most, in angles of a lens without distortion, and how far what
# passes near may move until its row is exposed
_VIEW_SHARE, _SHUTTER_RAD = 1.3, 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyExposure:
    """A body during an exposure.

    Attributes
    ----------
    t_s : when the row of its place is exposed, true session time.
    head : the head then.
    exposure_s : how long.
    pixel_px : (2,) where its place is.
    motion_px : (2,) motion of its place in the picture within the exposure, as drawn.
    rate_px_s : (2,) how fast.
    """

    t_s: float
    head: HeadMotion
    exposure_s: float
    pixel_px: FloatArray
    motion_px: FloatArray
    rate_px_s: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyWindow:
    """A body in a window: ``cover`` (h, w, 4) of B, G, R times cover and cover, and its ``corner`` x, y px."""

    cover: Float32Array
    corner: tuple[int, int]


class BodyRaster:
    """Draws the bodies in one station's picture; one thread at a time.

    Parameters
    ----------
    station : geometry, lens and rolling shutter.
    blur_px : one sigma of all blur but motion's.
    """

    def __init__(self, station: Station, blur_px: float) -> None:
        self._geometry = station.geometry()
        self._readout_s = station.readout_s
        self._blur_px = blur_px
        self._focal = float(station.lens.focal_px.max())
        w, h = station.lens.image_size_px
        self._half_view_rad = _VIEW_SHARE * math.atan(0.5 * math.hypot(w, h) / self._focal) + _SHUTTER_RAD
        self._margin = 3 + math.ceil(3.0 * blur_px)
        room = max(_MAX_SAMPLES, (w + 2 * self._margin) * (h + 2 * self._margin))
        self._near, self._owner = np.empty(room, np.float32), np.empty(room, np.int32)
        self._veil_near, self._veil_owner = np.empty(0, np.float32), np.empty(0, np.int32)

    def pixel(self, body: Body, t_s: float, head: HeadMotion) -> FloatArray | None:
        """Return where a body's place is seen, (2,) px; None where it is not in front."""
        projection = self._geometry.project(body.place(t_s), head.pan_rad, head.tilt_rad)
        return None if projection is None else projection.pixel

    def exposed(self, body: Body, t_s: float, head: HeadMotion, exposure_s: float) -> BodyExposure | None:
        """Return when and how a body is exposed in the picture of a time, s; None if its place is not in front."""
        height = self._geometry.image_size_px[1]
        dt = 0.0
        for _ in range(_SHUTTER_ROUNDS if self._readout_s else 0):
            pixel = self.pixel(body, t_s + dt, head.after(dt))
            if pixel is None:
                return None
            dt = float(exposed_row_delay_s(float(pixel[1]), height, self._readout_s))
        moment, turned = t_s + dt, head.after(dt)
        pixel = self.pixel(body, moment, turned)
        if pixel is None:
            return None
        half = 0.5 * exposure_s
        early = self.pixel(body, moment - half, turned.after(-half))
        late = self.pixel(body, moment + half, turned.after(half))
        motion = np.zeros(2) if early is None or late is None else late - early
        length = float(np.hypot(*motion))
        return BodyExposure(
            t_s=moment,
            head=turned,
            exposure_s=exposure_s,
            pixel_px=pixel,
            motion_px=motion if length <= _MAX_MOTION_PX else motion * (_MAX_MOTION_PX / length),
            rate_px_s=motion / exposure_s,
        )

    def exposed_in_view(self, body: Body, t_s: float, head: HeadMotion, exposure_s: float) -> BodyExposure | None:
        """Return what `exposed` does, or None where by its place, reach and motion no part is in the picture."""
        place = body.place(t_s)
        pose = self._geometry.camera_pose(head.pan_rad, head.tilt_rad)
        line = place - pose.position_runway_m
        away = max(float(np.linalg.norm(line)), 1e-6)
        ahead = float(line @ pose.runway_from_camera[:, 2]) / away
        # most traffic is far outside of the picture: that is known without the row at which it would be exposed
        if ahead <= math.cos(min(self._half_view_rad + 1.3 * body.reach_m / away, 0.5 * math.pi)):
            return None
        seen = self.exposed(body, t_s, head, exposure_s)
        if seen is None:
            return None
        reach = 1.3 * self._focal * body.reach_m / away + self._margin + float(np.abs(seen.motion_px).max())
        w, h = self._geometry.image_size_px
        inside = -reach < seen.pixel_px[0] < w + reach and -reach < seen.pixel_px[1] < h + reach
        return seen if inside else None

    def instants(self, body: Body, seen: BodyExposure) -> tuple[float, ...]:
        """Return after which times, s, from its moment a body is drawn: several where it turns or grows."""
        half = 0.5 * seen.exposure_s
        ends = [self._corners_px(body.skin(seen.t_s + dt), seen.head.after(dt)) for dt in (-half, half)]
        if ends[0] is None or ends[1] is None:
            return (0.0,)
        # corners that a later skin has reordered would be another matter; skins keep their order
        smear = float(np.abs(ends[1][:, :2] - ends[0][:, :2] - seen.motion_px).max())
        count = min(max(math.ceil(smear / _SMEAR_PX), 1), _MAX_INSTANTS) if smear > _SMEAR_PX else 1
        return tuple(seen.exposure_s * ((k + 0.5) / count - 0.5) for k in range(count))

    def window(
        self, skin: Skin, colours: FloatArray, seen: BodyExposure, lights: tuple[PointLight, ...] = ()
    ) -> BodyWindow | None:
        """Draw a skin in its colours (n, 3) into the window that holds it; None where nothing is in the picture."""
        corners = self._corners_px(skin, seen.head)
        if corners is None:
            return None
        corners = self._sheared(corners, seen)
        w, h = self._geometry.image_size_px
        margin = self._margin + int(0.5 * np.abs(seen.motion_px).max())
        # beyond the picture only as far as blur may bring it back in
        low = np.maximum(np.floor(corners[:, :2].min(axis=0)).astype(int) - margin, -margin)
        high = np.minimum(np.ceil(corners[:, :2].max(axis=0)).astype(int) + margin + 1, [w + margin, h + margin])
        width, height = (int(v) for v in high - low)
        if width <= 2 * margin - 1 or height <= 2 * margin - 1:
            return None
        scale = next((s for s in _SCALES if width * height * s * s <= _MAX_SAMPLES), 1)
        grid = self._grid((int(low[0]), int(low[1])), (height * scale, width * scale), scale, skin)
        cover = np.empty((height, width, 4), np.float32)
        raster_kernels.draw(corners.reshape(-1, 3, 3), np.ascontiguousarray(colours), skin.opacity, grid, cover)
        for light in lights:
            self._shine(light, seen.head, grid, cover)
        return BodyWindow(cover=cover, corner=(grid.x0, grid.y0))

    def blurred(self, drawn: BodyWindow, motion_px: FloatArray) -> BodyWindow:
        """Return a window blurred by motion (2,) px and by the lens."""
        cover = drawn.cover
        if float(np.hypot(*motion_px)) > _LEAST_MOTION_PX:
            cover = np.asarray(
                cv2.filter2D(cover, -1, motion_blur_kernel(motion_px), borderType=cv2.BORDER_CONSTANT), np.float32
            )
        if self._blur_px > 0.0:
            size = 2 * math.ceil(3.0 * self._blur_px) + 1
            sigma = self._blur_px
            blurred = cv2.GaussianBlur(cover, (size, size), sigma, borderType=cv2.BORDER_CONSTANT)
            cover = np.asarray(blurred, np.float32)
        return BodyWindow(cover=cover, corner=drawn.corner)

    def extent(self, skin: Skin, seen: BodyExposure) -> tuple[float, float]:
        """Return the width of the whole silhouette's box, px, and the share of the silhouette inside the picture."""
        corners = self._corners_px(skin, seen.head)
        if corners is None:
            return 0.0, 0.0
        corners = self._sheared(corners, seen)
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        size = np.array(self._geometry.image_size_px)
        width = float(high[0] - low[0])
        if np.all(low >= -0.5) and np.all(high <= size - 0.5):
            return width, 1.0
        if np.any(high < -0.5) or np.any(low > size - 0.5):
            return width, 0.0
        # the whole of it in a small window, which is finer or coarser than the picture
        zoom = _WHOLE_SIDE_PX / max(float((high - low).max()), 1e-6)
        scaled = corners.copy()
        scaled[:, :2] = (corners[:, :2] - low) * zoom
        columns, rows = (int(v) + 2 for v in (high - low) * zoom)
        grid = self._grid((0, 0), (rows, columns), 1, skin)
        cover = np.empty((rows, columns, 4), np.float32)
        flat = np.zeros((len(skin.opacity), 3))
        raster_kernels.draw(scaled.reshape(-1, 3, 3), flat, skin.opacity, grid, cover)
        whole = cover[:, :, 3] >= 0.5
        u, v = np.arange(columns) / zoom + low[0], np.arange(rows) / zoom + low[1]
        inside = ((v >= -0.5) & (v <= size[1] - 0.5))[:, None] & ((u >= -0.5) & (u <= size[0] - 0.5))
        return width, float((whole & inside).sum() / max(whole.sum(), 1))

    def facing(self, skin: Skin, eye_runway_m: FloatArray) -> MaskArray:
        """Return which triangles (n,) show their outer side, or are translucent."""
        out = np.einsum("ij,ij->i", skin.normals_runway, eye_runway_m - skin.corners_runway_m[:, 0]) > 0.0
        return np.asarray(out | (skin.opacity < 1.0))

    def _corners_px(self, skin: Skin, head: HeadMotion) -> FloatArray | None:
        """Return u, v, 1/depth (3 n, 3) of the corners; None where one is not in front."""
        points = np.ascontiguousarray(skin.corners_runway_m.reshape(-1, 3))
        seen = np.empty((len(points), 3))
        good = raster_kernels.project_corners(self._geometry.packed, points, head.pan_rad, head.tilt_rad, seen)
        return seen if good and len(seen) else None

    def _sheared(self, corners: FloatArray, seen: BodyExposure) -> FloatArray:
        """Return corners moved by as much as the body does until their own rows are exposed."""
        if self._readout_s == 0.0:
            return corners
        rate = seen.rate_px_s
        per_row = self._readout_s / self._geometry.image_size_px[1]
        # v' − v = rate · (v' − v0) · s per row, of which v0 is the row of its place
        later = (corners[:, 1] - seen.pixel_px[1]) * per_row / max(1.0 - rate[1] * per_row, 0.1)
        corners = corners.copy()
        corners[:, :2] += later[:, None] * rate
        return corners

    def _grid(self, corner: tuple[int, int], shape: tuple[int, int], scale: int, skin: Skin) -> SampleGrid:
        """Return room for so many rows and columns of samples."""
        room = shape[0] * shape[1]
        if room > self._near.size:
            self._near, self._owner = np.empty(room, np.float32), np.empty(room, np.int32)
        veils = room if bool((skin.opacity < 1.0).any()) else 0
        if veils > self._veil_near.size:
            self._veil_near, self._veil_owner = np.empty(veils, np.float32), np.empty(veils, np.int32)
        veil_shape = shape if veils else (0, 0)
        return SampleGrid(
            x0=corner[0],
            y0=corner[1],
            scale=scale,
            near=self._near[:room].reshape(shape),
            owner=self._owner[:room].reshape(shape),
            veil_near=self._veil_near[:veils].reshape(veil_shape),
            veil_owner=self._veil_owner[:veils].reshape(veil_shape),
        )

    def _shine(self, light: PointLight, head: HeadMotion, grid: SampleGrid, cover: Float32Array) -> None:
        """Add a lamp to a window, as light without cover, shared by the four pixels around it."""
        seen = np.empty((1, 3))
        point = light.position_runway_m[None]
        if not raster_kernels.project_corners(self._geometry.packed, point, head.pan_rad, head.tilt_rad, seen):
            return
        x, y = seen[0, 0] - grid.x0, seen[0, 1] - grid.y0
        ix, iy = math.floor(x), math.floor(y)
        rows, columns = cover.shape[:2]
        if not (0 <= ix < columns - 1 and 0 <= iy < rows - 1):
            return
        depth = 1.0 / seen[0, 2]
        nearest = float(grid.near[int((y + 0.5) * grid.scale), int((x + 0.5) * grid.scale)])
        if nearest > 0.0 and 1.0 / nearest < depth - _LAMP_DEPTH_M:
            return
        # E = I / d² spread over pixels of 1/f² sr, in the levels of a skin of known luminance
        level = _SUNLIT_WHITE_LEVEL / SUNLIT_WHITE_CD_M2 * (self._focal / depth) ** 2
        fx, fy = x - ix, y - iy
        shares = np.array([[(1 - fx) * (1 - fy), fx * (1 - fy)], [(1 - fx) * fy, fx * fy]])
        cover[iy : iy + 2, ix : ix + 2, :3] += shares[:, :, None] * (level * light.candela_bgr)
