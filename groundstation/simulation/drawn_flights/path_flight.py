"""A flight along way points: the nose's path as a cubic curve, and the attitude that belongs to it."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from groundstation.arrays import FloatArray
from groundstation.simulation.attitude import GRAVITY_M_S2
from groundstation.simulation.drawn_flights.flight_spec import MAX_BANK_RAD, FlightSpec
from groundstation.simulation.drawn_flights.profile import smooth_step
from groundstation.simulation.drawn_flights.way_point import WayPoint

# slower than this, the track has no direction of its own
_SLOW_M_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PathMotion:
    """At n times: ``nose_m`` (n, 3), runway frame, and ``angles_rad`` (n, 3), yaw clockwise from +y, pitch, bank."""

    nose_m: FloatArray
    angles_rad: FloatArray


def path_motion(spec: FlightSpec, t_s: FloatArray, flying_m: float) -> PathMotion:
    """Return the motion along a flight's way points at times (n,), s.

    Crab, incidence and bank reach their full values within ``flying_m`` above the nose's height at rest.
    """
    points = spec.way_points
    times = np.array([p.t_s for p in points])
    curve = CubicSpline(times, np.array([[p.x_m, p.y_m, p.z_m] for p in points]), bc_type="natural")
    nose, velocity, acceleration = curve(t_s), curve(t_s, 1), curve(t_s, 2)
    flying = smooth_step((nose[:, 2] - spec.rest_height_m) / flying_m)
    level = np.hypot(velocity[:, 0], velocity[:, 1])
    track = _track(velocity, level)
    lateral = acceleration[:, 0] * np.cos(track) - acceleration[:, 1] * np.sin(track)
    bank = np.clip(np.arctan2(lateral, GRAVITY_M_S2), -MAX_BANK_RAD, MAX_BANK_RAD)
    slope = np.where(level > _SLOW_M_S, np.arctan2(velocity[:, 2], np.maximum(level, _SLOW_M_S)), 0.0)
    derived = {
        "yaw_rad": track + flying * spec.crab_rad,
        "pitch_rad": flying * (slope + spec.incidence_rad),
        "bank_rad": flying * bank,
    }
    angles = [_given(points, times, name, t_s, otherwise) for name, otherwise in derived.items()]
    return PathMotion(nose_m=nose, angles_rad=np.column_stack(angles))


def _track(velocity_m_s: FloatArray, level_m_s: FloatArray) -> FloatArray:
    """Return the track's direction (n,), clockwise from +y; where it is slow, that of the nearest times it is not."""
    moving = np.flatnonzero(level_m_s > min(_SLOW_M_S, 0.5 * float(level_m_s.max())))
    heading = np.unwrap(np.arctan2(velocity_m_s[moving, 0], velocity_m_s[moving, 1]))
    return np.interp(np.arange(level_m_s.size), moving, heading)


def _given(
    points: tuple[WayPoint, ...], times: FloatArray, name: str, t_s: FloatArray, otherwise: FloatArray
) -> FloatArray:
    """Return an angle of the way points over time, or what holds where they have none."""
    if getattr(points[0], name) is None:
        return otherwise
    angle = np.unwrap([getattr(p, name) for p in points])
    return np.asarray(CubicSpline(times, angle, bc_type="natural")(t_s))
