"""A runway's corners in its near-threshold frame, and which corner of a picture is which."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, IntArray
from groundstation.geometry.geodesy import enu_from_geodetic

# the four corners in the order in which an aircraft on approach meets them, clockwise in its picture
CORNERS = ("near left", "far left", "far right", "near right")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Runway:
    """Corners (4, 3) in m in the near-threshold frame, ordered as `CORNERS`.

    The frame: origin in the middle of the near threshold, y level, along the runway towards the approaching aircraft,
    z up, x completing it; so x points to the approaching aircraft's left.
    """

    corners_m: FloatArray

    @property
    def length_m(self) -> float:
        """Return the distance between the middles of the thresholds."""
        near, far = self.corners_m[[0, 3]].mean(axis=0), self.corners_m[[1, 2]].mean(axis=0)
        return float(np.linalg.norm(far - near))

    @property
    def width_m(self) -> float:
        """Return the width at the near threshold."""
        return float(np.linalg.norm(self.corners_m[0] - self.corners_m[3]))


def rectangle(length_m: float, width_m: float) -> Runway:
    """Return a level rectangular runway."""
    half = 0.5 * width_m
    return Runway(
        corners_m=np.array([[half, 0.0, 0.0], [half, -length_m, 0.0], [-half, -length_m, 0.0], [-half, 0.0, 0.0]])
    )


def runway_from_geodetic(near_deg_m: FloatArray, far_deg_m: FloatArray) -> Runway:
    """Return the runway from the two corners of each threshold, (2, 3) each: deg, deg and m."""
    places = np.vstack([near_deg_m, far_deg_m])
    origin = near_deg_m.mean(axis=0)
    enu = enu_from_geodetic(places[:, 0], places[:, 1], places[:, 2], (origin[0], origin[1], origin[2]))
    enu = enu - enu[:2].mean(axis=0)
    towards = -enu[2:].mean(axis=0)
    azimuth = np.arctan2(towards[0], towards[1])
    s, c = np.sin(azimuth), np.cos(azimuth)
    # rows: x = y × z to the right of the level direction y, then y, then up
    frame_from_enu = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    local = enu @ frame_from_enu.T
    near, far = local[:2], local[2:]
    near, far = near[np.argsort(-near[:, 0])], far[np.argsort(-far[:, 0])]
    return Runway(corners_m=np.vstack([near[0], far[0], far[1], near[1]]))


def orders_by_row(pixels: FloatArray) -> IntArray:
    """Return the orders (4, 4) in which four pixels may be `CORNERS`, the most likely first.

    A runway is seen from above, so its corners are clockwise in the picture; the first of them is then one of
    four. The near threshold is assumed to be the two lowest corners; then the runway turned by half; then across.
    """
    middle = pixels.mean(axis=0)
    bearing = np.arctan2(pixels[:, 1] - middle[1], pixels[:, 0] - middle[0])
    # v runs down, so a growing angle is clockwise to the eye
    clockwise = np.argsort(bearing)
    rows = pixels[clockwise, 1]
    # the lowest pair (near right, near left) of neighbours
    first = int(np.argmax(rows + np.roll(rows, -1)))
    near_left = (first + 1) % 4
    turns = [near_left, (near_left + 2) % 4, (near_left + 1) % 4, (near_left + 3) % 4]
    return np.array([np.roll(clockwise, -k) for k in turns])
