"""Several lengthwise passes over a runway in one flight: in, along it, out, round and in again, for studies."""

from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z
from groundstation.onboard.pose.inertial_kernel import GRAVITY_M_S2
from groundstation.onboard.pose.simulated_approach import (
    RUNWAY_FROM_LEVEL_BODY,
    ApproachSetup,
    SimulatedApproach,
    motion_of,
    waves,
)

# rolling into a turn and out of it takes so long
_ROLL_S = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RacetrackPattern:
    """A race track of ``count`` rounds: legs of ``leg_m`` along the runway, turns of ``turn_rad_s`` at its ends.

    A round begins ``from_m`` before the threshold, ``high_m`` above it, descends to ``low_m`` at the end of its leg
    and climbs again on the way back.
    """

    count: int = 3
    from_m: float = 1500.0
    leg_m: float = 2400.0
    turn_rad_s: float = 0.1
    high_m: float = 100.0
    low_m: float = 25.0


def fly_passes(
    setup: ApproachSetup, passes: RacetrackPattern, rng: np.random.Generator
) -> tuple[SimulatedApproach, list[tuple[float, float]]]:
    """Return the flight, and the interval of each pass, s; gusts, biases and noise are drawn from ``rng``.

    The runway is visible wherever all its corners are in the picture, and nowhere else.
    """
    dt = 1.0 / setup.imu_hz
    heading, height, spans = _course(setup, passes)
    t: FloatArray = np.arange(len(heading), dtype=np.float64) * dt
    climb: FloatArray = np.asarray(np.gradient(height, dt), dtype=np.float64)
    turning: FloatArray = np.asarray(np.gradient(heading, dt), dtype=np.float64)
    gusts = np.stack([waves(t, (4.0, 10.0), size, rng) for size in (0.3, 0.3, 0.2)], axis=1)
    level = setup.speed_m_s * np.stack([-np.sin(heading), -np.cos(heading)], axis=1)
    velocity = np.column_stack([level, climb]) + gusts - gusts.mean(axis=0)
    acceleration = np.vstack([np.diff(velocity, axis=0) / dt, np.zeros(3)])
    bank = np.arctan(turning * setup.speed_m_s / GRAVITY_M_S2)
    yaw = heading + np.radians(waves(t, (4.0, 12.0), 1.0, rng))
    pitch = np.radians(1.0 + waves(t, (2.0, 8.0), 1.0, rng))
    roll = bank + np.radians(waves(t, (2.0, 8.0), 3.0, rng))
    turns = [rotation_z(y) @ rotation_y(p) @ rotation_x(r) for y, p, r in zip(yaw, pitch, roll, strict=True)]
    attitude = RUNWAY_FROM_LEVEL_BODY @ np.array(turns)
    start = np.array([0.0, passes.from_m, height[0]])
    unbroken = replace(setup, lost_s=(np.inf, np.inf))
    return motion_of(unbroken, t, start, velocity[0], acceleration, attitude, rng), spans


def _course(setup: ApproachSetup, passes: RacetrackPattern) -> tuple[FloatArray, FloatArray, list[tuple[float, float]]]:
    """Return heading (n,) to the right of −y, height (n,) m, and the time of each pass, s; ends with the last pass."""
    dt = 1.0 / setup.imu_hz
    leg = np.zeros(round(passes.leg_m / setup.speed_m_s / dt))
    turn = _turn(passes.turn_rad_s, dt)
    back = np.concatenate([turn, leg, turn])
    rates, heights, spans = [], [], []
    down = _eased(passes.high_m, passes.low_m, len(leg))
    up = _eased(passes.low_m, passes.high_m, len(back))
    begun = 0
    for number in range(passes.count):
        spans.append((begun * dt, (begun + len(leg)) * dt))
        last = number == passes.count - 1
        rates.append(leg if last else np.concatenate([leg, back]))
        heights.append(down if last else np.concatenate([down, up]))
        begun += len(rates[-1])
    rate = np.concatenate(rates)
    heading = np.concatenate([[0.0], np.cumsum(rate[:-1] * dt)])
    return heading, np.concatenate(heights), spans


def _turn(rate_rad_s: float, dt: float) -> FloatArray:
    """Return the rates (n,) of a half turn, rolled into and out of without a jerk; their sum is exactly π."""
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(round(_ROLL_S / dt)) + 0.5) * dt / _ROLL_S)
    steady = round((np.pi / rate_rad_s - _ROLL_S) / dt)
    rates = rate_rad_s * np.concatenate([ramp, np.ones(max(steady, 0)), ramp[::-1]])
    return np.asarray(rates * np.pi / (rates.sum() * dt))


def _eased(low: float, high: float, count: int) -> FloatArray:
    """Return a change of height (count,) m that begins and ends level."""
    s = np.arange(count) / count
    return np.asarray(low + (high - low) * (s - np.sin(2 * np.pi * s) / (2 * np.pi)))
