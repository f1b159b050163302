"""A planned site: rig with the expected calibration covariance, aircraft, and required accuracy."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.rig.rig import Rig


@dataclass(frozen=True, slots=True, kw_only=True)
class Aircraft:
    """The approaching aircraft: its span and a straight glide along x = ``x_m`` to the touchdown.

    ``acceleration_psd_m2_s3`` is how much it manoeuvres, x, y, z: the motion model of a filter that follows it.
    """

    span_m: float
    speed_m_s: float
    glide_rad: float
    touchdown_y_m: float
    x_m: float
    nose_height_m: float
    acceleration_psd_m2_s3: tuple[float, float, float]

    def position_m(self, y_m: float, x_m: float | None = None) -> FloatArray:
        """Return the nose (3,), runway frame, at a range ``y_m``; on its wheels beyond the touchdown."""
        z_m = max(self.nose_height_m, math.tan(self.glide_rad) * (y_m - self.touchdown_y_m))
        return np.array([self.x_m if x_m is None else x_m, y_m, z_m])

    def velocity_m_s(self, y_m: float) -> FloatArray:
        """Return the velocity (3,), runway frame: towards the stations, down the glide until it rolls."""
        rolling = math.tan(self.glide_rad) * (y_m - self.touchdown_y_m) <= self.nose_height_m
        angle = 0.0 if rolling else self.glide_rad
        return self.speed_m_s * np.array([0.0, -math.cos(angle), -math.sin(angle)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement:
    """An accuracy that something needs: its ``name`` and 1 sigma of x, y, z in m."""

    name: str
    sigma_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Site:
    """Everything that the forecast needs.

    Attributes
    ----------
    rig : stations, lenses, encoders, and the covariance of their calibration; the sigmas of its clocks are used.
    station_clock_sigma_s : 1 sigma of one station's clock, camera and PTU together, against the session's.
    pixel_sigma_px : 1 sigma of the detected pixel, u and v.
    min_silhouette_px : a narrower aircraft is taken as not found.
    frame_rate_hz : of every camera.
    from_m, to_m, step_m : the ranges y that are looked at; the track begins at ``to_m``.
    """

    name: str
    rig: Rig
    station_clock_sigma_s: float
    pixel_sigma_px: float
    min_silhouette_px: float
    frame_rate_hz: float
    aircraft: Aircraft
    from_m: float
    to_m: float
    step_m: float
    required: tuple[Requirement, ...]

    def ranges_m(self) -> FloatArray:
        """Return the ranges y (n,) that are looked at, rising, both ends among them."""
        inner = np.arange(self.from_m, self.to_m - 1e-6 * self.step_m, self.step_m)
        return np.append(inner, self.to_m)
