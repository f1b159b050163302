"""The runway's threshold and landing direction, and positions along and across it."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingRunway:
    """The runway in use, in the `runway` frame of the rig (FORMAT: y towards the approaching aircraft, z up).

    Attributes
    ----------
    threshold_m : (x, y, z) the centre of the landing threshold, on the surface.
    direction_rad : the landing direction, from −y, counter-clockwise as seen from above; 0 lands towards the stations.
    width_m : edge to edge.
    length_m : from the threshold on, None if unknown.
    """

    threshold_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction_rad: float = 0.0
    width_m: float = 15.0
    length_m: float | None = None

    def axes(self) -> FloatArray:
        """Return (3, 3) unit vectors as rows, runway frame: along the landing direction, right of it, up."""
        sine, cosine = math.sin(self.direction_rad), math.cos(self.direction_rad)
        return np.array([[sine, -cosine, 0.0], [-cosine, -sine, 0.0], [0.0, 0.0, 1.0]])

    def threshold_coordinates(self, position_runway_m: FloatArray) -> FloatArray:
        """Return (…, 3) m along the landing direction past the threshold, right of the centre line, above it.

        ``position_runway_m`` (…, 3), runway frame.
        """
        return np.asarray((np.asarray(position_runway_m) - np.array(self.threshold_m)) @ self.axes().T)

    def runway_position(self, coordinates_m: FloatArray) -> FloatArray:
        """Return (…, 3) positions in the runway frame; the inverse of `threshold_coordinates`."""
        return np.asarray(np.asarray(coordinates_m) @ self.axes() + np.array(self.threshold_m))
