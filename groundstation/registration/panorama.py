"""A panorama of the ground around one head, and the directions of a picture's pixels in which it is made and read."""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray, IntArray
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_x, rotation_y, rotation_z
from groundstation.rig.rig import Station

# pictures are halved: a twentieth of such a pixel is 0.0009° with a lens of 6,700 px
HALVED = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundPanorama:
    """The grey levels around one head, in directions of its base frame.

    Attributes
    ----------
    grey : (h, w) float32; ``known`` (h, w) where it is of use.
    left_rad, top_rad : azimuth (as pan, counter-clockwise from +y) and height of pixel (0, 0).
    step_rad : of a pixel, in both directions; azimuth and height fall to the right and downwards.
    sigma_rad : of the place of the whole, which all frames share.
    """

    grey: FloatArray
    known: ImageArray
    left_rad: float
    top_rad: float
    step_rad: float
    sigma_rad: float = 0.0


class PictureRays:
    """Directions of a camera's pixels, halved, in the head's frame, and where they are at two angles of the head."""

    def __init__(self, station: Station) -> None:
        w, h = (n // HALVED for n in station.lens.image_size_px)
        self.size_px = (w, h)
        lens = station.lens
        x, y = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h, dtype=np.float64))
        full = np.stack([x, y], axis=-1).reshape(-1, 1, 2) * HALVED + 0.5 * (HALVED - 1.0)
        (fx, fy), (cx, cy) = lens.focal_px.tolist(), lens.principal_point_px.tolist()
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        straight = np.asarray(cv2.undistortPoints(full, matrix, lens.distortion)).reshape(-1, 2)
        rays = np.column_stack([straight, np.ones(len(straight))])
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        self.rays: FloatArray = rays @ matrix_from_wxyz(station.head_from_camera_wxyz).T
        self._lean = rotation_y(station.ptu_axes.lean_rad)
        full_rows = np.repeat(np.arange(h, dtype=np.float64), w) * HALVED + 0.5 * (HALVED - 1.0)
        # when each pixel is exposed after the stamp, s, (h·w,)
        self.delay_s: FloatArray = row_delay_s(full_rows, lens.image_size_px[1], station.readout_s)
        self._rolls = station.readout_s != 0.0

    def turned(
        self, rates_rad_s: FloatArray | tuple[float, float], pixels: IntArray | None = None
    ) -> FloatArray | None:
        """Return by how much the head turns in pan and tilt, (n, 2) rad, from the stamp to each pixel's exposure.

        ``pixels`` (n,) are some of the picture's; all by default. None where all pixels are exposed at the same angles.
        """
        if not self._rolls or not np.any(rates_rad_s):
            return None
        delay = self.delay_s if pixels is None else self.delay_s[pixels]
        return np.outer(delay, rates_rad_s)

    def directions(
        self, rows: FloatArray, pan_rad: float, tilt_rad: float, turned_rad: FloatArray | None = None
    ) -> FloatArray:
        """Return azimuth and height (n, 2), rad, in the base frame, of rows of head directions (n, 3).

        ``turned_rad`` (n, 2) is added to the angles of each row, see `turned`.
        """
        if turned_rad is None:
            own = rows @ (rotation_z(pan_rad) @ self._lean @ rotation_x(tilt_rad)).T
        else:
            c, s = np.cos(tilt_rad + turned_rad[:, 1]), np.sin(tilt_rad + turned_rad[:, 1])
            tilted = np.column_stack([rows[:, 0], c * rows[:, 1] - s * rows[:, 2], s * rows[:, 1] + c * rows[:, 2]])
            own = tilted @ (rotation_z(pan_rad) @ self._lean).T
        azimuth, height = np.arctan2(-own[:, 0], own[:, 1]), np.arcsin(np.clip(own[:, 2], -1.0, 1.0))
        # pan turns last, about the axis from which azimuths are counted
        return np.column_stack([azimuth if turned_rad is None else azimuth + turned_rad[:, 0], height])


def halved_grey(image: ImageArray) -> FloatArray:
    """Return the grey levels (h, w), halved, of a picture (h, w, 3) BGR or (h, w)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    h, w = grey.shape
    half = cv2.resize(grey, (w // HALVED, h // HALVED), interpolation=cv2.INTER_AREA)
    return np.asarray(half, dtype=np.float32)
