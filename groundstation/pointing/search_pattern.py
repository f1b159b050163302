"""The aim of all stations without a target: a point in the air that sweeps the search volume.

All cameras observe one place at a time, because detection needs two of them. After a loss that is the predicted
position of the target, swept over its uncertainty; without one, the sector in which aircraft arrive.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Kinematics

# steps of a quarter of a view's dwell in which a sweep is evaluated ahead
_SKIPPED = 120
# the pattern is of points on a plane across the runway
_MOST_DEG = 80.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchConfig:
    """The searched volume, and the speed of the search.

    Attributes
    ----------
    azimuth_deg, elevation_deg : (low, high) of the sector, seen from the runway's origin; azimuth to the right of +y.
    range_m : range at which the cameras' views meet.
    dwell_s : least time for which a place stays in view.
    lost_s : duration of the search at the predicted position after a loss.
    sigmas : extent of that search.
    acceleration_psd_m2_s3 : manoeuvres of a lost aircraft, per axis.
    """

    azimuth_deg: tuple[float, float] = (-5.0, 5.0)
    elevation_deg: tuple[float, float] = (0.5, 8.0)
    range_m: float = 500.0
    dwell_s: float = 3.0
    lost_s: float = 15.0
    sigmas: float = 3.0
    acceleration_psd_m2_s3: float = 10.0

    def __post_init__(self) -> None:
        if not (self.azimuth_deg[0] < self.azimuth_deg[1] and self.elevation_deg[0] < self.elevation_deg[1]):
            raise ValueError("azimuth_deg and elevation_deg must be low, high")
        if max(map(abs, (*self.azimuth_deg, *self.elevation_deg))) > _MOST_DEG:
            raise ValueError(f"azimuth_deg and elevation_deg must be from -{_MOST_DEG:g} to {_MOST_DEG:g}")
        if min(self.range_m, self.dwell_s, self.sigmas) <= 0 or min(self.lost_s, self.acceleration_psd_m2_s3) < 0:
            raise ValueError("range_m, dwell_s and sigmas must be > 0, lost_s and acceleration_psd_m2_s3 ≥ 0")


class SearchPattern:
    """The common aim of all stations, as a function of time."""

    def __init__(self, stations: Mapping[str, StationGeometry], config: SearchConfig) -> None:
        self._config = config
        # half of the narrowest camera's field of view, as tangents
        self._view = np.min([_half_view(g) for g in stations.values()], axis=0)
        self._lost: tuple[float, Kinematics] | None = None

    def seen(self, t_s: float, kinematics: Kinematics) -> None:
        """Remember where the target is, for when it is lost."""
        self._lost = (t_s, kinematics)

    def after_loss(self, t_s: float) -> bool:
        """Return whether a target was there so recently that it is searched for where it must have gone."""
        return self._lost is not None and 0.0 <= t_s - self._lost[0] <= self._config.lost_s

    def ahead_s(self, t_s: float, allowed: Callable[[FloatArray], bool]) -> float:
        """Return the time by which the sweep is advanced to reach a permitted point (3,); 0 if there is none.

        A closed region thus costs no time: all stations continue where it ends.
        """
        step_s = 0.25 * self._config.dwell_s
        return next((k * step_s for k in range(_SKIPPED) if allowed(self.point(t_s + k * step_s))), 0.0)

    def point(self, t_s: float) -> FloatArray:
        """Return the aim (3,), runway frame."""
        if self._lost is not None and self.after_loss(t_s):
            return self._around(t_s, *self._lost)
        config = self._config
        azimuth, elevation = np.radians(config.azimuth_deg), np.radians(config.elevation_deg)
        middle = np.array([math.tan(azimuth.mean()), 1.0, math.tan(elevation.mean())]) * config.range_m
        half = 0.5 * config.range_m * np.array([np.ptp(np.tan(azimuth)), np.ptp(np.tan(elevation))])
        return self._swept(t_s, middle, half)

    def _around(self, t_s: float, lost_s: float, kinematics: Kinematics) -> FloatArray:
        """Return the aim ``t_s`` after a loss, by the motion at the loss."""
        dt = t_s - lost_s
        P, psd = kinematics.covariance, self._config.acceleration_psd_m2_s3
        middle = kinematics.position_runway_m + dt * kinematics.velocity_runway_m_s
        variance = np.diag(P[:3, :3] + dt * (P[:3, 3:] + P[3:, :3]) + dt**2 * P[3:, 3:]) + psd * dt**3 / 3.0
        half = self._config.sigmas * np.sqrt(np.maximum(variance[[0, 2]], 0.0))
        # an aircraft is not below the runway
        low, high = max(middle[2] - half[1], 0.0), max(middle[2] + half[1], 0.0)
        middle[2], half[1] = 0.5 * (low + high), 0.5 * (high - low)
        return self._swept(t_s, middle, half)

    def _swept(self, t_s: float, middle: FloatArray, half: FloatArray) -> FloatArray:
        """Return a point that sweeps x and z about ``middle`` by ``half`` (2,), less what one view holds anyway."""
        seen = self._view * max(float(middle[1]), 1.0)
        reach = np.maximum(half - 0.9 * seen, 0.0)
        speed = 2.0 * seen / self._config.dwell_s
        across, up = _serpentine(t_s, reach, speed, rows=math.ceil(reach[1] / seen[1]) + 1)
        return middle + np.array([across, 0.0, up])


def _half_view(station: StationGeometry) -> FloatArray:
    """Return half of a camera's field of view to the side and up, as tangents (2,), however it is mounted.

    It is how far the picture reaches from its middle along the horizon and the vertical: of a camera on its side the
    picture's height is what it sees to the side.
    """
    half = 0.5 * np.array(station.image_size_px) / station.lens.focal_px
    # how far u and v point to the side (first row) and up (second row)
    axes = np.abs(station.camera_pose(0.0, 0.0).runway_from_camera[[0, 2], :2])
    axes /= np.maximum(np.hypot(axes[:, 0], axes[:, 1]), 1e-9)[:, None]
    return np.asarray((half / np.maximum(axes, 1e-9)).min(axis=1), np.float64)


def _serpentine(t_s: float, reach: FloatArray, speed: FloatArray, rows: int) -> tuple[float, float]:
    """Return the point of a sweep of ±``reach`` (2,) at a time: along one row, up to the next, back along that, …

    The rows are one view's height apart; from the top the sweep returns downwards in the same way.
    """
    along_s, up_s = 2.0 * reach[0] / speed[0], 2.0 * reach[1] / speed[1] / max(rows - 1, 1)
    lap_s = along_s + up_s
    if lap_s == 0.0:
        return 0.0, 0.0
    # rows up, rows down: 0 … rows − 1 and back, the ends twice
    lap, within_s = divmod(t_s, lap_s)
    row = int(lap) % (2 * rows)
    level = row if row < rows else 2 * rows - 1 - row
    further = 0 if row in (rows - 1, 2 * rows - 1) else (1 if row < rows else -1)
    share = min(within_s / along_s, 1.0) if along_s > 0 else 1.0
    climbed = max(within_s - along_s, 0.0) / up_s * further if up_s > 0 else 0.0
    across = (2.0 * share - 1.0) * reach[0] * (1 if row % 2 == 0 else -1)
    up = ((level + climbed) / max(rows - 1, 1) * 2.0 - 1.0) * reach[1] if rows > 1 else 0.0
    return float(across), float(up)
