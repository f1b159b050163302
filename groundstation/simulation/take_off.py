"""A take-off towards the cameras: rest, brake release, roll, rotation, climb."""

import math
from dataclasses import dataclass, fields

import numpy as np

from groundstation.simulation.parameter_checks import require, require_not_negative, require_positive
from groundstation.simulation.trajectory import SampledTrajectory

_STEP_S = 0.005
_MAX_FLIGHT_S = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeOff:
    """Parameters of `take_off`; lengths in m of the runway frame, times in s.

    Attributes
    ----------
    start_y_m, start_z_m : position of the nose at rest, at x = 0.
    stand_s : time before the brakes are released, where the acceleration steps from 0.
    acceleration_m_s2 : until ``climb_speed_m_s``, constant thereafter.
    rotate_speed_m_s : at this speed the path begins to bend upwards …
    rotate_s : … and reaches ``climb_rad`` so much later, by a smooth step.
    end_y_m : where the span ends.
    """

    start_y_m: float = 300.0
    start_z_m: float = 0.4
    stand_s: float = 2.0
    acceleration_m_s2: float = 4.0
    rotate_speed_m_s: float = 14.0
    rotate_s: float = 1.5
    climb_speed_m_s: float = 20.0
    climb_rad: float = math.radians(10.0)
    end_y_m: float = 40.0

    def __post_init__(self) -> None:
        for item in fields(self):
            if item.name not in ("start_y_m", "start_z_m", "stand_s", "end_y_m"):
                require_positive(f"TakeOff: {item.name}", getattr(self, item.name))
        require_not_negative("TakeOff: stand_s", self.stand_s)
        require(self.end_y_m < self.start_y_m, "TakeOff: end_y_m", got=self.end_y_m, wanted="below start_y_m")
        require(self.climb_rad < math.pi / 2, "TakeOff: climb_rad", got=self.climb_rad, wanted="below π/2")
        wanted = f"at least rotate_speed_m_s = {self.rotate_speed_m_s:g}"
        slow = self.climb_speed_m_s >= self.rotate_speed_m_s
        require(slow, "TakeOff: climb_speed_m_s", got=self.climb_speed_m_s, wanted=wanted)


def take_off(plan: TakeOff | None = None) -> SampledTrajectory:
    """Fly a take-off along −y from time 0; returns a trajectory in the runway frame."""
    p = TakeOff() if plan is None else plan
    slowest = p.rotate_speed_m_s * math.cos(p.climb_rad)
    longest = p.stand_s + p.rotate_speed_m_s / p.acceleration_m_s2 + p.rotate_s + (p.start_y_m - p.end_y_m) / slowest
    require(longest <= _MAX_FLIGHT_S, "take_off", got=f"a flight of up to {longest:g} s", wanted=f"{_MAX_FLIGHT_S:g} s")
    t = np.arange(0.0, longest + _STEP_S, _STEP_S)
    speed = np.minimum(p.acceleration_m_s2 * np.maximum(t - p.stand_s, 0.0), p.climb_speed_m_s)
    rotated_s = p.stand_s + p.rotate_speed_m_s / p.acceleration_m_s2
    share = np.clip((t - rotated_s) / p.rotate_s, 0.0, 1.0)
    path_rad = p.climb_rad * share**2 * (3.0 - 2.0 * share)
    velocity = np.column_stack([np.zeros_like(t), -speed * np.cos(path_rad), speed * np.sin(path_rad)])
    travelled = np.vstack([np.zeros(3), np.cumsum(0.5 * _STEP_S * (velocity[1:] + velocity[:-1]), axis=0)])
    position = np.array([0.0, p.start_y_m, p.start_z_m]) + travelled
    flown = int(np.searchsorted(-position[:, 1], -p.end_y_m)) + 1
    return SampledTrajectory(t_s=t[:flown], position_m=position[:flown], velocity_m_s=velocity[:flown])
