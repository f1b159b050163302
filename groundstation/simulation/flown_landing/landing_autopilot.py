"""A plain autopilot for a landing: path loop, attitude loops, airspeed by throttle, a flare by height, a go-around.

It is like what a small fixed wing's autopilot does, and no more: no gain schedule, no observer of the wind, no turn out
of the crab before the touchdown. The gains were chosen on the true state, in wind and gusts of other seeds than the
study's (1000 to 1007), before any landing on the stream was flown.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.flown_landing.inertial_sensors import SensedMotion
from groundstation.simulation.flown_landing.scaled_aircraft import ControlSurfaces

_GRAVITY_M_S2 = 9.81
# path: climb by height off it (1/s), at most so much about the planned sink (m/s); pitch by angle of climb and its sum
_CLIMB_BY_HEIGHT, _MOST_CLIMB_M_S, _PITCH_BY_CLIMB, _PITCH_BY_CLIMB_SUM = 0.6, 1.5, 2.0, 0.8
_PITCH_RAD = (math.radians(-8.0), math.radians(14.0))
# to the side: ω and damping of the hold, and of its sum (1/s³); largest bank on the path and in the flare
_HOLD_RAD_S, _DAMPING, _HOLD_SUM = 0.5, 0.9, 0.03
_MOST_BANK_RAD, _FLARE_BANK_RAD = math.radians(25.0), math.radians(8.0)
# elevator and aileron by angle (1/rad), its rate (s/rad) and its sum (1/rad s), rudder by the rate of turn (s/rad)
_ELEVATOR, _AILERON, _RUDDER = (6.0, 0.8, 2.0), (1.5, 0.25, 0.8), 1.0
_THROTTLE, _THROTTLE_SUM, _THROTTLE_START = 0.10, 0.04, 0.35
_FLARE_CLOSES_S = 2.0
_GO_AROUND_PITCH_RAD = math.radians(9.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingPlan:
    """What is to be flown.

    Attributes
    ----------
    glide_rad, aim_m : descent of the wheels to a point so far past the threshold, m.
    airspeed_m_s : 1.3 times the stalling speed, and half of the largest gust.
    flare_height_m, touchdown_sink_m_s : of the wheels, as the foretold touchdown supposes them.
    longest_gap_s : so long without a position, the vehicle goes around.
    """

    glide_rad: float = math.radians(3.5)
    aim_m: float = 30.0
    airspeed_m_s: float = 18.0
    flare_height_m: float = 2.0
    touchdown_sink_m_s: float = 0.4
    longest_gap_s: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandingState:
    """Where the wheels are for the autopilot: (3,) past the threshold, right of the centre line, up; m and m/s."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    gap_s: float


class LandingPhase(StrEnum):
    """Of an approach."""

    GLIDE = "glide"
    FLARE = "flare"
    GO_AROUND = "go-around"


class LandingAutopilot:
    """The control law; ``phase`` is what it does.

    Parameters
    ----------
    step_s : between calls of `act`.
    """

    def __init__(self, plan: LandingPlan, step_s: float) -> None:
        self.phase = LandingPhase.GLIDE
        self._plan, self._step_s = plan, step_s
        self._flare_s = 0.0
        self._flare_sink_m_s = 0.0
        self._climb_sum = self._side_sum = self._pitch_sum = self._bank_sum = self._speed_sum = 0.0

    def act(self, state: LandingState, sensed: SensedMotion) -> ControlSurfaces:
        """Return the controls for the next step."""
        self._judge(state)
        body = sensed.ned_from_body
        pitch = -math.asin(min(max(float(body[2, 0]), -1.0), 1.0))
        roll = math.atan2(body[2, 1], body[2, 2])
        going_around = self.phase is LandingPhase.GO_AROUND
        wanted_pitch = _GO_AROUND_PITCH_RAD if going_around else self._pitch_rad(state, sensed.airspeed_m_s)
        bank = 0.0 if going_around else self._bank_rad(state)
        p, q, r = (float(rate) for rate in sensed.rates_rad_s)
        turn = _GRAVITY_M_S2 / max(sensed.airspeed_m_s, 5.0) * math.tan(bank)
        off_pitch, off_bank = pitch - wanted_pitch, roll - bank
        self._pitch_sum = _limited(self._pitch_sum + self._step_s * _ELEVATOR[2] * off_pitch, 0.6)
        self._bank_sum = _limited(self._bank_sum + self._step_s * _AILERON[2] * off_bank, 0.4)
        return ControlSurfaces(
            elevator=_ELEVATOR[0] * off_pitch + _ELEVATOR[1] * q + self._pitch_sum,
            aileron=-(_AILERON[0] * off_bank + _AILERON[1] * p + self._bank_sum),
            rudder=_RUDDER * (r - turn),
            throttle=1.0 if going_around else self._throttle(sensed.airspeed_m_s),
        )

    def _judge(self, state: LandingState) -> None:
        """Begin the flare at its height, and the go-around where the position has been silent for too long."""
        if state.gap_s > self._plan.longest_gap_s:
            self.phase = LandingPhase.GO_AROUND
        elif self.phase is LandingPhase.GLIDE and state.position_m[2] <= self._plan.flare_height_m:
            self.phase = LandingPhase.FLARE
            self._flare_sink_m_s = max(-float(state.velocity_m_s[2]), 2.0 * self._plan.touchdown_sink_m_s)
        if self.phase is LandingPhase.FLARE:
            self._flare_s += self._step_s

    def _pitch_rad(self, state: LandingState, airspeed_m_s: float) -> float:
        plan, height = self._plan, float(state.position_m[2])
        if self.phase is LandingPhase.FLARE:
            # ḣ = −h/τ − w, with τ such that the sink does not jump
            time_constant_s = plan.flare_height_m / (self._flare_sink_m_s - plan.touchdown_sink_m_s)
            wanted = -max(height, 0.0) / time_constant_s - plan.touchdown_sink_m_s
        else:
            slope = math.tan(plan.glide_rad)
            off = slope * (plan.aim_m - float(state.position_m[0])) - height
            back = _limited(_CLIMB_BY_HEIGHT * off, _MOST_CLIMB_M_S)
            wanted = back - slope * float(state.velocity_m_s[0])
        off_climb = (wanted - float(state.velocity_m_s[2])) / max(airspeed_m_s, 5.0)
        self._climb_sum = _limited(self._climb_sum + self._step_s * _PITCH_BY_CLIMB_SUM * off_climb, 0.25)
        return float(np.clip(_PITCH_BY_CLIMB * off_climb + self._climb_sum, *_PITCH_RAD))

    def _bank_rad(self, state: LandingState) -> float:
        right, speed = float(state.position_m[1]), float(state.velocity_m_s[1])
        self._side_sum = _limited(self._side_sum + self._step_s * _HOLD_SUM * right, 0.7)
        wanted = -(_HOLD_RAD_S**2) * right - 2.0 * _DAMPING * _HOLD_RAD_S * speed - self._side_sum
        most = _FLARE_BANK_RAD if self.phase is LandingPhase.FLARE else _MOST_BANK_RAD
        return _limited(math.atan(wanted / _GRAVITY_M_S2), most)

    def _throttle(self, airspeed_m_s: float) -> float:
        slow = self._plan.airspeed_m_s - airspeed_m_s
        if self.phase is LandingPhase.GLIDE:
            self._speed_sum = float(np.clip(self._speed_sum + self._step_s * _THROTTLE_SUM * slow, -0.35, 0.65))
        held = _THROTTLE_START + self._speed_sum + _THROTTLE * slow
        return held * max(1.0 - self._flare_s / _FLARE_CLOSES_S, 0.0)


def _limited(value: float, most: float) -> float:
    return min(max(value, -most), most)
