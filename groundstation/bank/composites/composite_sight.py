"""Projection of a path into a composite's camera, and the frames in which it is clear of the real aircraft."""

from collections.abc import Sequence

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.bank.composites.composite_spec import RATE_HZ, CompositeCamera
from groundstation.bank.composites.segment_view import SegmentView
from groundstation.box import Box
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.trajectory import Trajectory

# the aircraft keeps so far away from the labelled box of the real one, px
CLEAR_PX = 12.0
# and its sphere below so many widths of the picture
_WIDEST = 0.8
_NEAREST_M, _LOWEST_M = 12.0, 1.5


class CompositeSight:
    """Visibility of an aircraft in the frames of a segment; a sphere about its nose encloses all of it.

    Parameters
    ----------
    camera, view : of the composite, and of the segment.
    airframe : the aircraft.

    Attributes
    ----------
    size_px : (w, h) of the pictures.
    horizon_row : of the first picture; None without ground.
    """

    def __init__(self, camera: CompositeCamera, view: SegmentView, airframe: AirframeSpec) -> None:
        self.camera, self.airframe, self.size_px = camera, airframe, view.size_px
        self.horizon_row = view.horizon_row
        self._middle = 0.5 * (np.array(view.size_px) - 1.0)
        geometry = camera.station(view.size_px).geometry()
        poses = [geometry.camera_pose(head.pan_rad, head.tilt_rad) for head in camera.heads(view.shifts_px)]
        self._eye = poses[0].position_runway_m
        self._runway_from_camera = np.array([pose.runway_from_camera for pose in poses])
        self._reach_m = airframe.span_m * max(0.5, airframe.hull.length_per_span)

    def point(self, frame: int, pixel_px: FloatArray, away_m: float) -> FloatArray:
        """Return the point (3,) m, runway frame, so far away on the ray of a pixel (2,) of a frame."""
        ray = np.array([*(pixel_px - self._middle) / self.camera.focal_px, 1.0])
        return np.asarray(self._eye + away_m * (self._runway_from_camera[frame] @ (ray / np.linalg.norm(ray))))

    def free(self, path: Trajectory, boxes: Sequence[Box[float] | None]) -> MaskArray:
        """Return in which frames (n,) the aircraft is in the picture, and clear of the real one's box."""
        places = path.position(np.arange(len(self._runway_from_camera)) / RATE_HZ)
        lines = places - self._eye
        rays = np.einsum("nji,nj->ni", self._runway_from_camera, lines)
        away, depth = np.linalg.norm(lines, axis=1), np.maximum(rays[:, 2], 1e-6)
        pixels = self._middle + self.camera.focal_px * rays[:, :2] / depth[:, None]
        half = self.camera.focal_px * self._reach_m / np.maximum(away, 1e-6)
        free = (rays[:, 2] > 0.0) & np.all((pixels >= 0.0) & (pixels <= 2.0 * self._middle), axis=1)
        free &= (away > _NEAREST_M) & (places[:, 2] > _LOWEST_M) & (2.0 * half < _WIDEST * self.size_px[0])
        known = np.array([box if box is not None else (np.inf, np.inf, -np.inf, -np.inf) for box in boxes])
        reach = half + CLEAR_PX
        across = (known[:, 0] - reach < pixels[:, 0]) & (pixels[:, 0] < known[:, 2] + reach)
        along = (known[:, 1] - reach < pixels[:, 1]) & (pixels[:, 1] < known[:, 3] + reach)
        return np.asarray(free & ~(across & along))
