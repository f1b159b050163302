"""A take-off by JSBSim's C172: brakes, full throttle, the roll on its wheels, rotation, climb; an optional extra.

Its size is brought down to the aircraft's by Froude's law, as that of a dynamically similar model: lengths by the ratio
λ of the spans, times and speeds by √λ, so that accelerations, and with them angles, are the same. A span of 2.3 m
rotates at 14 m/s, and climbs at 16.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.angles import wrap_rad
from groundstation.simulation.jsbsim_model import FOOT_M, loaded_c172, start_turbulence
from groundstation.simulation.trajectory import SampledTrajectory

_SPAN_M = 36.0 * FOOT_M
_STEP_S = 1.0 / 120.0
# from the centre of gravity to the propeller, in c172x.xml: 78.7 in ahead, 9.9 in below; forward, right, down
_NOSE_M = (2.0, 0.0, 0.25)
_ON_ITS_WHEELS_FT = 4.3
# it settles, then the throttle is opened against the brakes, then they are released; s of the full-size aircraft
_SETTLE_S, _THROTTLE_S, _RELEASE_S = 2.0, 4.0, 6.0
_ROTATE_KT, _CLIMB_KT, _CLIMB_RAD = 55.0, 70.0, math.radians(8.0)
_MOST_S = 150.0
# gains: rudder and brakes by heading (1/rad) and its rate (s/rad), heading by metres and by speed off the line,
# aileron by bank, its rate and its sum (1/rad s)
_RUDDER, _BRAKE, _MOST_BRAKE, _BRAKES_TO_KT = (12.0, 4.0), (4.0, 4.0), 0.4, 30.0
_HEADING_BY_PLACE, _HEADING_BY_SPEED, _MOST_HEADING = 0.01, 0.006, 0.15
_AILERON, _BANK_BY_COURSE, _MOST_BANK = (1.5, 0.5, 0.8), 1.2, 0.3
_ELEVATOR, _PITCH_BY_KT, _PITCH = (2.5, 1.0), 0.01, (math.radians(3.0), math.radians(11.0))


@dataclass(slots=True)
class _TakeOffController:
    """Control law of the take-off; ``rotated`` is set above the rotation speed."""

    model: Any
    rotated: bool = False
    east_m: float = 0.0
    trim: float = 0.0

    def act(self, t_s: float) -> None:
        """Set the controls for the next step."""
        model = self.model
        speed_kt = float(model["velocities/vc-kts"])
        self.rotated = self.rotated or (t_s > _RELEASE_S and speed_kt > _ROTATE_KT)
        model["fcs/throttle-cmd-norm"] = float(t_s > _THROTTLE_S)
        airborne = not model["gear/unit[1]/WOW"]
        wanted, bank = self._heading_rad(), 0.0
        if airborne:
            course = math.atan2(model["velocities/v-east-fps"], model["velocities/v-north-fps"])
            bank = _limited(_BANK_BY_COURSE * (wanted - course), -_MOST_BANK, _MOST_BANK)
        self._steer(0.0 if airborne else wrap_rad(float(model["attitude/psi-rad"])) - wanted, t_s, speed_kt)
        leans = float(model["attitude/phi-rad"]) - bank
        if airborne:
            # at full throttle the engine turns it to the left
            self.trim += _AILERON[2] * leans * _STEP_S
        aileron = _AILERON[0] * leans + _AILERON[1] * model["velocities/p-rad_sec"] + self.trim
        model["fcs/aileron-cmd-norm"] = _limited(-aileron, -1.0, 1.0)
        elevator = 0.0
        if self.rotated:
            wanted = _limited(_CLIMB_RAD + _PITCH_BY_KT * (speed_kt - _CLIMB_KT), *_PITCH)
            elevator = _ELEVATOR[0] * (model["attitude/theta-rad"] - wanted)
            elevator += _ELEVATOR[1] * model["velocities/q-rad_sec"]
        model["fcs/elevator-cmd-norm"] = _limited(elevator, -1.0, 1.0)

    def _heading_rad(self) -> float:
        """Return the heading that brings it back onto the runway's line, to the north."""
        east_m_s = FOOT_M * float(self.model["velocities/v-east-fps"])
        back = -_HEADING_BY_PLACE * self.east_m - _HEADING_BY_SPEED * east_m_s
        return _limited(back, -_MOST_HEADING, _MOST_HEADING)

    def _steer(self, off_rad: float, t_s: float, speed_kt: float) -> None:
        """Keep the heading by rudder and, while that is slow to act, by the brakes: this nose wheel casters."""
        turning = float(self.model["velocities/r-rad_sec"])
        rudder = _RUDDER[0] * off_rad + _RUDDER[1] * turning
        self.model["fcs/rudder-cmd-norm"] = _limited(rudder, -1.0, 1.0)
        left = right = 1.0
        if t_s > _RELEASE_S:
            brake = _BRAKE[0] * off_rad + _BRAKE[1] * turning if speed_kt < _BRAKES_TO_KT else 0.0
            left, right = (min(max(side * brake, 0.0), _MOST_BRAKE) for side in (1.0, -1.0))
        self.model["fcs/left-brake-cmd-norm"], self.model["fcs/right-brake-cmd-norm"] = left, right


def _limited(value: float, least: float, most: float) -> float:
    """Return a number within limits: numpy's function for it takes longer than the model's step."""
    return float(min(max(value, least), most))


def take_off_by_jsbsim(
    *, seed: int, wind_m_s: float, span_m: float, start_y_m: float, end_y_m: float, rest_m: float
) -> SampledTrajectory:
    """Fly a take-off along −y from standing still at ``start_y_m``, until ``end_y_m``; the same for the same seed.

    Parameters
    ----------
    wind_m_s : sets the strength of the turbulence, for the full-size aircraft.
    span_m : of the aircraft to which the flight is scaled.
    rest_m : the nose's height at rest.

    Returns the nose in the runway frame. Raises `NoFlightModelError` where JSBSim is not installed.
    """
    scale = span_m / _SPAN_M
    model = loaded_c172(1.0 / _STEP_S)
    model["ic/h-agl-ft"], model["ic/vc-kts"], model["ic/psi-true-deg"] = _ON_ITS_WHEELS_FT, 0.0, 0.0
    model.run_ic()
    start_turbulence(model, seed, wind_m_s)
    model["propulsion/set-running"], model["fcs/mixture-cmd-norm"] = -1.0, 0.9
    controller, rows = _TakeOffController(model), []
    moved_m = np.zeros(2)
    far_m = (start_y_m - end_y_m) / scale
    for k in range(round(_MOST_S / _STEP_S)):
        t_s = k * _STEP_S
        controller.act(t_s)
        model.run()
        moved_m += _STEP_S * FOOT_M * np.array([model["velocities/v-north-fps"], model["velocities/v-east-fps"]])
        place = _nose(model, moved_m)
        controller.east_m = float(place[1])
        if t_s >= _SETTLE_S:
            rows.append(place)
            if place[0] - rows[0][0] > far_m:
                break
    flown = np.array(rows)
    north, east, up = (flown - flown[0]).T
    t = np.asarray(np.arange(len(flown)) * _STEP_S * math.sqrt(scale), dtype=np.float64)
    position = np.column_stack([-scale * east, start_y_m - scale * north, rest_m + scale * up])
    return SampledTrajectory(t_s=t, position_m=position, velocity_m_s=np.gradient(position, t, axis=0))


def _nose(model: Any, moved_m: FloatArray) -> FloatArray:
    """Return where the nose is: north, east, up, m from the start; ``moved_m`` (2,) is how far the aircraft moved.

    JSBSim's own distances from the start have no sign.
    """
    roll, pitch, yaw = (float(model[f"attitude/{name}-rad"]) for name in ("phi", "theta", "psi"))
    # rolled, then pitched, then turned to its heading, as plain numbers: it is computed for each step of 8 ms
    ahead, right, below = _NOSE_M
    right, below = (
        right * math.cos(roll) - below * math.sin(roll),
        right * math.sin(roll) + below * math.cos(roll),
    )
    ahead, down = (
        ahead * math.cos(pitch) + below * math.sin(pitch),
        below * math.cos(pitch) - ahead * math.sin(pitch),
    )
    north = ahead * math.cos(yaw) - right * math.sin(yaw)
    east = ahead * math.sin(yaw) + right * math.cos(yaw)
    return np.array([moved_m[0] + north, moved_m[1] + east, model["position/h-agl-ft"] * FOOT_M - down])
