"""An approach flown by JSBSim's C172 through wind and MIL-F-8785C turbulence; an optional extra.

JSBSim moves the aircraft; its attitude and velocity, sample by sample, are the flight, and positions and inertial
samples are made from them, so that they fit each other exactly. The C172 is no small UAV: it is the aircraft in the
wheel whose model is known to be sound, and what it gives is motion in turbulence.
"""

from importlib import import_module
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z
from groundstation.onboard.pose.simulated_approach import RUNWAY_FROM_LEVEL_BODY, ApproachSetup, motion_of
from groundstation.onboard.scenes.nose_flight import AIM_M, NoseFlight
from groundstation.onboard.scenes.sequences import Sequence

_FOOT_M = 0.3048
_KNOTS_M_S = 0.514444
_SPEED_KT = 65.0
# Milspec: severity of 20 ft wind, ft/s, and the exceedance curve
_WIND_20_FT_S = 35.0
_SEVERITY = 4.0
_SETTLE_S = 4.0
_END_M = 45.0
# of the autopilot that holds attitude: elevator and aileron by angle (1/rad) and by rate (s/rad)
_ELEVATOR, _AILERON = (2.5, 1.0), (1.2, 0.4)


class NoFlightModelError(InputError):
    """JSBSim is not installed."""


def jsbsim_nose_flight(sequence: Sequence, setup: ApproachSetup, wind_m_s: float = 4.0) -> NoseFlight:
    """Return a flight in turbulence drawn from the sequence's seed, over its airfield.

    Parameters
    ----------
    wind_m_s : across, from the right.

    Raises `NoFlightModelError` where JSBSim is not installed.
    """
    n = round(setup.duration_s * setup.imu_hz)
    velocity, runway_from_body = _flown(sequence.seed, n, setup, wind_m_s)
    track = velocity.sum(axis=0)
    level = rotation_z(np.arctan2(-track[0], -track[1]))
    velocity, runway_from_body = velocity @ level.T, level @ runway_from_body
    t = np.asarray(np.arange(n) / setup.imu_hz, dtype=np.float64)
    acceleration = np.diff(velocity, axis=0, append=velocity[-1:]) * setup.imu_hz
    # the runway lies where the flight leads, and the flight ends a little before its threshold
    moved = velocity.sum(axis=0) / setup.imu_hz
    start = np.array([-moved[0], _END_M - moved[1], (_END_M + AIM_M) * np.tan(np.radians(setup.glide_deg)) - moved[2]])
    rng = np.random.default_rng([sequence.seed, 78])
    motion = motion_of(setup, t, start, velocity[0], acceleration, runway_from_body, rng)
    return NoseFlight(sequence=sequence, setup=setup, motion=motion)


def _model() -> Any:
    try:
        jsbsim = import_module("jsbsim")
    except ImportError as fault:
        raise NoFlightModelError("jsbsim", got="not installed", wanted="pip install 'groundstation[jsbsim]'") from fault
    jsbsim.FGJSBBase().debug_lvl = 0
    model = jsbsim.FGFDMExec(None)
    model.load_model("c172x")
    return model


def _flown(seed: int, n: int, setup: ApproachSetup, wind_m_s: float) -> tuple[FloatArray, FloatArray]:
    """Return velocities (n, 3) in the runway frame and attitudes (n, 3, 3), after some seconds to settle.

    The runway's landing direction is JSBSim's north.
    """
    model = _model()
    model.set_dt(1.0 / setup.imu_hz)
    for name, value in (
        ("ic/h-sl-ft", 1500.0), ("ic/vc-kts", _SPEED_KT), ("ic/gamma-deg", -setup.glide_deg), ("ic/psi-true-deg", 0.0),
        ("ic/vw-east-fps", -wind_m_s / _FOOT_M),
    ):  # fmt: skip
        model[name] = value
    model.run_ic()
    # 3: MIL-F-8785C
    for name, value in (
        ("simulation/randomseed", float(seed % 2**31)), ("atmosphere/turb-type", 3.0),
        ("atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps", _WIND_20_FT_S),
        ("atmosphere/turbulence/milspec/severity", _SEVERITY), ("propulsion/set-running", -1.0),
        ("fcs/throttle-cmd-norm", 0.25), ("fcs/mixture-cmd-norm", 0.9),
    ):  # fmt: skip
        model[name] = value
    pitch_held = model["attitude/theta-rad"]
    velocity, attitude = np.empty((n, 3)), np.empty((n, 3, 3))
    settle = round(_SETTLE_S * setup.imu_hz)
    for k in range(settle + n):
        _hold(model, pitch_held, setup.glide_deg)
        model.run()
        if k >= settle:
            north, east, down = (model[f"velocities/v-{axis}-fps"] * _FOOT_M for axis in ("north", "east", "down"))
            # on approach y is back along the landing direction and x to its left
            velocity[k - settle] = [-east, -north, -down]
            roll, pitch, yaw = (model[f"attitude/{name}-rad"] for name in ("phi", "theta", "psi"))
            attitude[k - settle] = RUNWAY_FROM_LEVEL_BODY @ rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)
    return velocity, attitude


def _hold(model: Any, pitch_rad: float, glide_deg: float) -> None:
    """Hold the glide path's descent and level wings with elevator and aileron."""
    speed = max(float(model["velocities/vt-fps"]), 1.0)
    path = float(model["velocities/v-down-fps"]) / speed - np.sin(np.radians(glide_deg))
    wanted = pitch_rad + 0.6 * path
    elevator = _ELEVATOR[0] * (model["attitude/theta-rad"] - wanted) + _ELEVATOR[1] * model["velocities/q-rad_sec"]
    yaw = (float(model["attitude/psi-rad"]) + np.pi) % (2.0 * np.pi) - np.pi
    aileron = _AILERON[0] * (model["attitude/phi-rad"] + 0.5 * yaw) + _AILERON[1] * model["velocities/p-rad_sec"]
    model["fcs/elevator-cmd-norm"] = float(np.clip(elevator, -1.0, 1.0))
    model["fcs/aileron-cmd-norm"] = float(np.clip(-aileron, -1.0, 1.0))
