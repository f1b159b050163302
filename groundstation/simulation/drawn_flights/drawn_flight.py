"""The trajectory of a drawn flight: the nose's path with the attitude that it has, on its wheels and in the air.

The wheels' path follows from speed, slope and rate of turn. The nose is ahead of and above the wheels by the attitude,
so that it rises where the aircraft rotates.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from groundstation.arrays import FloatArray
from groundstation.errors import ScenarioError
from groundstation.simulation.attitude import GRAVITY_M_S2, runway_from_body
from groundstation.simulation.drawn_flights.flight_spec import FlightKind, FlightSpec
from groundstation.simulation.drawn_flights.manoeuvre import TOWARDS_RAD, Manoeuvre, manoeuvre_of
from groundstation.simulation.drawn_flights.path_flight import path_motion
from groundstation.simulation.drawn_flights.profile import smooth_step
from groundstation.simulation.drawn_flights.wind import wind_effects
from groundstation.simulation.parameter_checks import require
from groundstation.simulation.trajectory import SampledTrajectory

_STEP_S = 0.01
# height of the wheels at which the lift is all the wings', so that banks are whole
_FLYING_M = 1.5
# a path that dips lower than this into the runway is refused; less is the steps' rounding
_ROUNDING_M = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnFlight:
    """A flight with its own attitude, from time 0 on.

    Attributes
    ----------
    spec : the specification.
    nose : the nose's trajectory, runway frame; acceleration is continuous.
    angles : yaw (clockwise from +y), pitch (nose up) and bank (right wing down), rad, over the span.
    """

    spec: FlightSpec
    nose: SampledTrajectory
    angles: CubicSpline

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time, s."""
        return self.nose.span_s

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of the nose in m at times (n,)."""
        return self.nose.position(t_s)

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) of the nose in m/s at times (n,)."""
        return self.nose.velocity(t_s)

    def attitude(self, t_s: float) -> FloatArray:
        """Return ``runway_from_body`` (3, 3) at a time, s; before the flight and after it, that of its ends."""
        yaw, pitch, bank = self.angles(min(max(t_s, self.span_s[0]), self.span_s[1])).tolist()
        return runway_from_body(np.array([math.sin(yaw), math.cos(yaw)]), pitch, bank)


def build_flight(spec: FlightSpec, seed: int) -> DrawnFlight:
    """Return the flight of a specification, with gusts drawn from a seed.

    Raises `ScenarioError` where the flight would lead under the runway.
    """
    require(seed >= 0, "build_flight: seed", got=seed, wanted="a whole number ≥ 0")
    t = np.linspace(0.0, spec.duration_s, math.ceil(spec.duration_s / _STEP_S) + 1)
    if spec.kind is FlightKind.PATH:
        return _along_path(spec, seed, t)
    plan = manoeuvre_of(spec)
    track = plan.heading_rad + _integral(plan.turn_rate.at(t), t)
    wheels = _wheels(spec, plan, t, track)
    wind = wind_effects(spec, seed, t, wheels[:, 2])
    flying = smooth_step(wheels[:, 2] / _FLYING_M)
    right = np.column_stack([np.cos(track), -np.sin(track), np.zeros_like(track)])
    sideways = plan.speed.at(t) * plan.turn_rate.at(t) + np.sum(wind.held_m_s2 * right, axis=1)
    # the crosswind blows across the runway: along it the crab is whole, across it there is none
    crab = plan.crab.at(t) * np.arcsin(math.sin(spec.crab_rad) * np.cos(track - _runway_rad(plan)))
    angles = np.column_stack(
        [
            track + crab + wind.turned_rad[:, 2],
            plan.slope.at(t) + plan.incidence.at(t) + wind.turned_rad[:, 1],
            flying * np.arctan2(sideways, GRAVITY_M_S2) + wind.turned_rad[:, 0],
        ]
    )
    return _flown(spec, t, wheels + wind.moved_m + _lever(spec, angles), angles)


def _along_path(spec: FlightSpec, seed: int, t_s: FloatArray) -> DrawnFlight:
    """Return the flight along way points, with the wobble and what gusts add to the path."""
    motion = path_motion(spec, t_s, _FLYING_M)
    wind = wind_effects(spec, seed, t_s, motion.nose_m[:, 2] - spec.rest_height_m)
    return _flown(spec, t_s, motion.nose_m + wind.moved_m, motion.angles_rad + wind.turned_rad[:, ::-1])


def _flown(spec: FlightSpec, t_s: FloatArray, nose_m: FloatArray, angles_rad: FloatArray) -> DrawnFlight:
    """Return a flight through noses (n, 3), which stay above the runway, with yaw, pitch and bank (n, 3)."""
    nose = nose_m.copy()
    nose[:, 2] = np.maximum(nose[:, 2], spec.rest_height_m)
    path = CubicSpline(t_s, nose, bc_type="natural")
    return DrawnFlight(
        spec=spec,
        nose=SampledTrajectory(t_s=t_s, position_m=nose, velocity_m_s=path(t_s, 1)),
        angles=CubicSpline(t_s, angles_rad, bc_type="natural"),
    )


def _runway_rad(plan: Manoeuvre) -> float:
    """Return the direction in which the runway is flown: that of the track, or, of a circuit, of its final."""
    return TOWARDS_RAD if plan.turn_rate.ramps else plan.heading_rad


def _wheels(spec: FlightSpec, plan: Manoeuvre, t_s: FloatArray, track_rad: FloatArray) -> FloatArray:
    """Return the wheels' path (n, 3), m, at times (n,); never below the runway."""
    speed, slope = plan.speed.at(t_s), plan.slope.at(t_s)
    velocity = np.column_stack(
        [
            speed * np.cos(slope) * np.sin(track_rad),
            speed * np.cos(slope) * np.cos(track_rad),
            speed * np.sin(slope),
        ]
    )
    path = _integral(velocity, t_s)
    where = [np.interp(plan.anchor_s, t_s, path[:, k]) for k in range(2)]
    path += np.array([spec.offset_x_m, plan.anchor_y_m, plan.height_m]) - [
        *where,
        np.interp(plan.height_s, t_s, path[:, 2]),
    ]
    lowest = float(path[:, 2].min())
    if lowest < -_ROUNDING_M:
        got = f"a {spec.kind} that leads {-lowest:.2f} m under the runway"
        raise ScenarioError("FlightSpec", got=got, wanted="more height, a flatter glide or a shorter flight")
    path[:, 2] = np.maximum(path[:, 2], 0.0)
    return path


def _integral(rate: FloatArray, t_s: FloatArray) -> FloatArray:
    """Return the integral (n, …) of a rate (n, …) over even times (n,) from 0, by trapezoids."""
    grown = np.zeros_like(rate)
    grown[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]), axis=0) * (t_s[1] - t_s[0])
    return grown


def _lever(spec: FlightSpec, angles_rad: FloatArray) -> FloatArray:
    """Return the way (n, 3) from the wheels to the nose, m, for yaw, pitch and bank (n, 3)."""
    yaw, pitch, bank = angles_rad.T
    sy, cy, sp, cp = np.sin(yaw), np.cos(yaw), np.sin(pitch), np.cos(pitch)
    forward = np.column_stack([cp * sy, cp * cy, sp])
    right_level = np.column_stack([cy, -sy, np.zeros_like(yaw)])
    up_level = np.cross(right_level, forward)
    up = np.cos(bank)[:, None] * up_level + np.sin(bank)[:, None] * right_level
    return np.asarray(spec.wheels_behind_nose_m * forward + spec.rest_height_m * up)
