"""Background of a picture: the station's panoramas through lens and rolling shutter."""

import math

import numpy as np

from groundstation.arrays import Float32Array, FloatArray
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.geometry.rotation import rotation_x, rotation_z
from groundstation.rig.rig import Station
from groundstation.simulation import render_kernels
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.occlusion_kernels import ObjectDepth, unhidden
from groundstation.simulation.optics import Optics
from groundstation.simulation.render_primitives import ray_grid, smooth_mosaic
from groundstation.simulation.scenery import Surroundings

_MAX_SAMPLES = 8


class Backdrop:
    """The surroundings in one camera's picture; `face` comes before all else of a picture.

    Parameters
    ----------
    station : geometry, lens and rolling shutter.
    optics : exposure and sensor.
    around : the surroundings from the station's camera.
    """

    def __init__(self, station: Station, optics: Optics, around: Surroundings) -> None:
        self._packed = station.geometry().packed
        self._height = station.lens.image_size_px[1]
        self._readout_s = station.readout_s
        self._focal = float(station.lens.focal_px.max())
        self._optics = optics
        self._around = around
        fine, coarse = (ObjectDepth(depth=p.depth, place=p.place) for p in around.panoramas)
        self._depths = (fine, coarse) if around.hides_bodies else None
        self._rays = ray_grid(self._packed, station.lens.image_size_px)
        self._nodes = np.empty((*self._rays.shape[:2], 2))
        self._moved, self._samples = np.zeros_like(self._nodes), 1

    def face(self, t_s: float, head: HeadMotion) -> None:
        """Set the orientation of the camera at a time, s, and how far it turns within the exposure."""
        rows = self._row_times()
        render_kernels.directions(self._rays, self._turns(head, rows), self._nodes)
        exposure = self._optics.exposure_at(t_s)
        turn = math.hypot(head.pan_rate_rad_s * math.cos(head.tilt_rad), head.tilt_rate_rad_s) * exposure
        self._samples = min(max(math.ceil(turn * self._focal), 1), _MAX_SAMPLES)
        self._moved[:] = 0.0
        if self._samples > 1:
            early, late = np.empty_like(self._moved), np.empty_like(self._moved)
            render_kernels.directions(self._rays, self._turns(head, rows - 0.5 * exposure), early)
            render_kernels.directions(self._rays, self._turns(head, rows + 0.5 * exposure), late)
            self._moved[:] = late - early
            self._moved[..., 0] = (self._moved[..., 0] + np.pi) % (2.0 * np.pi) - np.pi
        self._around.draw_seen(self._nodes, self._moved)

    def fill(self, light: np.ndarray) -> None:
        """Fill the light (h, w)."""
        fine, coarse = self._around.panoramas
        render_kernels.surroundings(self._nodes, self._moved, self._samples, fine, coarse, self._optics.channels, light)
        if self._optics.defocus_px > 0.0:
            smooth_mosaic(light, self._optics.defocus_px, coloured=self._optics.pattern is not None)

    def unhidden(self, shape: tuple[int, ...], corner: tuple[int, int], distance_m: float) -> Float32Array | None:
        """Return the share (h, w) of each pixel of a window without a nearer object; None if all of them are free."""
        if self._depths is None:
            return None
        free = np.empty(shape[:2], np.float32)
        place = np.array(corner, dtype=np.float64)
        hidden = unhidden(self._nodes, self._moved, self._samples, *self._depths, distance_m, place, free)
        return free if hidden else None

    def _row_times(self) -> FloatArray:
        """Return when the rows of nodes are exposed, after the picture's stamp, s."""
        rows = render_kernels.TILE * np.arange(len(self._rays))
        return row_delay_s(np.asarray(rows, dtype=np.float64), self._height, self._readout_s)

    def _turns(self, head: HeadMotion, after_s: FloatArray) -> FloatArray:
        """Return runway_from_camera (n, 3, 3) so much later, s."""
        base, mounted = self._packed[0:9].reshape(3, 3), self._packed[12:21].reshape(3, 3)

        def turn(dt_s: float) -> FloatArray:
            then = head.after(dt_s)
            return np.asarray(base @ rotation_z(then.pan_rad) @ rotation_x(then.tilt_rad) @ mounted)

        if np.ptp(after_s) == 0.0:
            return np.repeat(turn(float(after_s[0]))[None], len(after_s), axis=0)
        return np.array([turn(float(dt_s)) for dt_s in after_s])
