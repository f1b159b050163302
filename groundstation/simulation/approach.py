"""Approaches along a straight glide path, with and without a flare (docs/derivation.md, section 8)."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require, require_positive
from groundstation.simulation.trajectory import LateralWeave, SuperposedTrajectory, Trajectory

GLIDE_SLOPE_RAD = math.radians(3.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class Flare:
    """An exponential flare: z = max(floor, height · exp(−(start − y)/length)) where y is below ``start_y_m``.

    With the numbers of the predictors' track, height and slope differ slightly from the glide path's: at y = 110 m
    z jumps by 2 mm and the sink rate by 0.66 m/s (at 25 m/s). `meeting` gives one that does.
    """

    start_y_m: float = 110.0
    height_m: float = 3.06
    length_m: float = 35.0
    floor_m: float = 0.3

    def __post_init__(self) -> None:
        require_positive("Flare: height_m", self.height_m)
        require_positive("Flare: length_m", self.length_m)

    @staticmethod
    def meeting(start_y_m: float, aim_y_m: float, slope_rad: float, floor_m: float = 0.3) -> "Flare":
        """Return the flare that leaves a glide path towards ``aim_y_m`` at ``start_y_m`` without a kink."""
        height = math.tan(slope_rad) * (start_y_m - aim_y_m)
        return Flare(start_y_m=start_y_m, height_m=height, length_m=start_y_m - aim_y_m, floor_m=floor_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class GlideApproach:
    """A descent along x = 0 towards the stations at constant speed over ground.

    Attributes
    ----------
    start_y_m, end_y_m : y at time 0 and at the end of the span, runway frame.
    speed_m_s : along −y.
    slope_rad : z = tan(slope) · (y − aim_y_m) before the flare.
    aim_y_m : aim point, where the glide path intersects the runway.
    flare : None flies the glide path to the end.
    """

    start_y_m: float = 600.0
    end_y_m: float = 60.0
    speed_m_s: float = 25.0
    slope_rad: float = GLIDE_SLOPE_RAD
    aim_y_m: float = 60.0
    flare: Flare | None = None

    def __post_init__(self) -> None:
        require_positive("Glide: speed_m_s", self.speed_m_s)
        require(self.start_y_m > self.end_y_m, "Glide: end_y_m", got=self.end_y_m, wanted=f"below {self.start_y_m:g} m")
        require(0 <= self.slope_rad < math.pi / 2, "Glide: slope_rad", got=self.slope_rad, wanted="from 0 to below π/2")

    @property
    def span_s(self) -> tuple[float, float]:
        """From time 0 to ``end_y_m``, s."""
        return (0.0, (self.start_y_m - self.end_y_m) / self.speed_m_s)

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,)."""
        y = self.start_y_m - self.speed_m_s * np.asarray(t_s, dtype=np.float64)
        z = math.tan(self.slope_rad) * (y - self.aim_y_m)
        if self.flare is not None:
            z = np.where(y > self.flare.start_y_m, z, np.maximum(self.flare.floor_m, self._flared(self.flare, y)))
        return np.column_stack([np.zeros_like(y), y, z])

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""
        y = self.start_y_m - self.speed_m_s * np.asarray(t_s, dtype=np.float64)
        slope = np.full_like(y, math.tan(self.slope_rad))
        if self.flare is not None:
            z = self._flared(self.flare, y)
            slope = np.where(y > self.flare.start_y_m, slope, (z > self.flare.floor_m) * z / self.flare.length_m)
        return np.column_stack([np.zeros_like(y), np.full_like(y, -self.speed_m_s), -self.speed_m_s * slope])

    def _flared(self, flare: Flare, y: FloatArray) -> FloatArray:
        # before the flare the exponential is not used; held there so that it cannot overflow
        return np.asarray(flare.height_m * np.exp(np.minimum(y - flare.start_y_m, 0.0) / flare.length_m))


def bound_glide() -> Trajectory:
    """Return the straight approach of the posterior bounds: 25 m/s from y = 600 m, 3.5° down to y = 60 m."""
    return GlideApproach()


def weaving_approach(end_y_m: float = 40.0) -> Trajectory:
    """Return the predictors' track: 25 m/s from y = 450 m, glide, flare at y = 110 m, ±1.5 m across every 8 s."""
    return SuperposedTrajectory(
        nominal=GlideApproach(start_y_m=450.0, end_y_m=end_y_m, flare=Flare()), deviation=LateralWeave()
    )
