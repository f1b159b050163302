"""JSBSim's C172 as a dynamically similar model of another span, flown step by step.

Brought down to size by Froude's law, as in `jsbsim_take_off`: with λ the ratio of the spans, lengths by λ, times and
speeds by √λ; accelerations and angles stay. All values here are those of the small aircraft.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z
from groundstation.simulation.jsbsim_model import FOOT_M, loaded_c172

_SPAN_M = 36.0 * FOOT_M
# JSBSim's own steps in one of ours: 183 a second of the full-size aircraft for a span of 2.3 m and steps of 5 ms
_SUBSTEPS = 2
# from the centre of gravity to the propeller, in c172x.xml: forward, right, down
_NOSE_M = np.array([2.0, 0.0, 0.25])
_GRAVITY_NED = np.array([0.0, 0.0, 9.81])
# height of the centre of gravity when a main wheel first touches at 3° of pitch, wings level, by JSBSim
_WHEELS_BELOW_M = 1.4
_FLAPS = 0.0
_AXES = ("north", "east", "down")


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlSurfaces:
    """Elevator (positive: nose down), aileron (positive: right wing down), rudder (positive: nose left), throttle.

    Deflections from −1 to 1, the throttle from 0 to 1; what is beyond is cut off.
    """

    elevator: float
    aileron: float
    rudder: float
    throttle: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftMotion:
    """Motion of the centre of gravity.

    Attributes
    ----------
    position_ned_m : (3,) from the start, down positive below the runway's height.
    velocity_ned_m_s : (3,) over ground.
    ned_from_body : (3, 3), body: forward, right, down.
    rates_rad_s : (3,) about the body's axes.
    specific_force_m_s2 : (3,) mean over the last step, body axes: what accelerometers measure.
    airspeed_m_s : true airspeed.
    on_wheels : whether a main wheel touches the ground.
    """

    position_ned_m: FloatArray
    velocity_ned_m_s: FloatArray
    ned_from_body: FloatArray
    rates_rad_s: FloatArray
    specific_force_m_s2: FloatArray
    airspeed_m_s: float
    on_wheels: bool


class ScaledAircraft:
    """The aircraft, from a steady descent to the north on.

    Parameters
    ----------
    span_m : to which it is scaled.
    step_s : of `step`, time of the small aircraft.
    height_m : of its centre of gravity over the runway.
    speed_m_s, glide_rad : over ground at the start; the wind begins with `blow`.

    Raises `NoFlightModelError` where JSBSim is not installed.
    """

    def __init__(
        self,
        *,
        span_m: float,
        step_s: float,
        height_m: float,
        speed_m_s: float,
        glide_rad: float,
    ) -> None:
        self._scale = span_m / _SPAN_M
        self._root = math.sqrt(self._scale)
        self._step_s = step_s
        self.nose_in_body_m: FloatArray = self._scale * _NOSE_M
        self.wheels_below_m = self._scale * _WHEELS_BELOW_M
        self._model: Any = loaded_c172(_SUBSTEPS * self._root / step_s)
        model = self._model
        for name, value in (
            ("ic/h-agl-ft", height_m / self._scale / FOOT_M), ("ic/psi-true-deg", 0.0),
            ("ic/vt-fps", speed_m_s / self._root / FOOT_M), ("ic/gamma-deg", -math.degrees(glide_rad)),
        ):  # fmt: skip
            model[name] = value
        model.run_ic()
        for name, value in (
            ("propulsion/set-running", -1.0), ("fcs/mixture-cmd-norm", 0.9), ("fcs/flap-cmd-norm", _FLAPS),
        ):  # fmt: skip
            model[name] = value
        self._velocity = self._seen_velocity()
        self._way: FloatArray = np.zeros(3)
        self.motion = self._seen(np.zeros(3))

    def blow(self, wind_ned_m_s: FloatArray) -> None:
        """Set the wind (3,): where the air moves to, north, east, down."""
        for axis, speed in zip(_AXES, wind_ned_m_s, strict=True):
            self._model[f"atmosphere/wind-{axis}-fps"] = float(speed) / self._root / FOOT_M

    def step(self, controls: ControlSurfaces) -> AircraftMotion:
        """Fly one step with these controls and return the motion after it."""
        model = self._model
        for name in ("elevator", "aileron", "rudder"):
            model[f"fcs/{name}-cmd-norm"] = min(max(getattr(controls, name), -1.0), 1.0)
        model["fcs/throttle-cmd-norm"] = min(max(controls.throttle, 0.0), 1.0)
        for _ in range(_SUBSTEPS):
            model.run()
        velocity = self._seen_velocity()
        acceleration = (velocity - self._velocity) / self._step_s
        # JSBSim tells distances from the start without their sign
        self._way = self._way + 0.5 * self._step_s * (velocity + self._velocity)
        self._velocity = velocity
        self.motion = self._seen(acceleration)
        return self.motion

    def _seen_velocity(self) -> FloatArray:
        return self._root * FOOT_M * np.array([self._model[f"velocities/v-{axis}-fps"] for axis in _AXES])

    def _seen(self, acceleration_ned: FloatArray) -> AircraftMotion:
        model = self._model
        roll, pitch, yaw = (float(model[f"attitude/{name}-rad"]) for name in ("phi", "theta", "psi"))
        ned_from_body = rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)
        height_m = self._scale * FOOT_M * float(model["position/h-agl-ft"])
        return AircraftMotion(
            position_ned_m=np.array([self._way[0], self._way[1], -height_m]),
            velocity_ned_m_s=self._velocity,
            ned_from_body=ned_from_body,
            rates_rad_s=np.array([model[f"velocities/{name}-rad_sec"] for name in "pqr"]) / self._root,
            specific_force_m_s2=ned_from_body.T @ (acceleration_ned - _GRAVITY_NED),
            airspeed_m_s=self._root * FOOT_M * float(model["velocities/vt-fps"]),
            on_wheels=any(bool(model[f"gear/unit[{k}]/WOW"]) for k in range(3)),
        )
