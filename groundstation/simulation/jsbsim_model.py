"""An aircraft's motion in wind and MIL-F-8785C turbulence by JSBSim's C172; an optional extra.

The C172 is no small UAV: it is an aircraft whose model in JSBSim's own package is known to be sound, and what it gives
is how an aircraft moves in turbulence.
"""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError

FOOT_M = 0.3048
_SPEED_KT = 65.0
_START_FT = 1500.0
# Milspec: the turbulence's probability of exceedance, and 20 ft wind for each m/s of wind
_SEVERITY = 4.0
_SETTLE_S = 4.0
# its generator takes 0 for 1
_SEEDS = 2**31 - 1
# of the autopilot: elevator and aileron by angle (1/rad) and by rate (s/rad), pitch by descent, bank by heading
_ELEVATOR, _AILERON = (2.5, 1.0), (1.2, 0.4)
_PITCH_BY_PATH, _BANK_BY_HEADING = 0.6, 0.5


class NoFlightModelError(InputError):
    """JSBSim is not installed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedMotion:
    """Velocity (n, 3) in m/s north, east, down, and roll, pitch and yaw (n, 3) in rad, landing to the north."""

    velocity_m_s: FloatArray
    attitude_rad: FloatArray


def fly_by_jsbsim(*, seed: int, samples: int, rate_hz: float, glide_rad: float, wind_m_s: float) -> SimulatedMotion:
    """Fly down a glide path through turbulence; the same for the same seed.

    Parameters
    ----------
    wind_m_s : sets the strength of the turbulence; the mean wind is calm.

    Raises `NoFlightModelError` where JSBSim is not installed.
    """
    model = _started(seed, rate_hz, glide_rad, wind_m_s)
    pitch_rad = float(model["attitude/theta-rad"])
    velocity, attitude = np.empty((samples, 3)), np.empty((samples, 3))
    settle = round(_SETTLE_S * rate_hz)
    for k in range(settle + samples):
        _hold(model, pitch_rad, glide_rad)
        model.run()
        if k >= settle:
            velocity[k - settle] = [model[f"velocities/v-{axis}-fps"] * FOOT_M for axis in ("north", "east", "down")]
            attitude[k - settle] = [model[f"attitude/{name}-rad"] for name in ("phi", "theta", "psi")]
    return SimulatedMotion(velocity_m_s=velocity, attitude_rad=attitude)


def _started(seed: int, rate_hz: float, glide_rad: float, wind_m_s: float) -> Any:
    """Return the model, trimmed by its own initial conditions, with the engine running and turbulence on."""
    model = loaded_c172(rate_hz)
    for name, value in (
        ("ic/h-sl-ft", _START_FT), ("ic/vc-kts", _SPEED_KT), ("ic/gamma-deg", -float(np.degrees(glide_rad))),
        ("ic/psi-true-deg", 0.0),
    ):  # fmt: skip
        model[name] = value
    model.run_ic()
    start_turbulence(model, seed, wind_m_s)
    for name, value in (
        ("propulsion/set-running", -1.0), ("fcs/throttle-cmd-norm", 0.25), ("fcs/mixture-cmd-norm", 0.9),
    ):  # fmt: skip
        model[name] = value
    return model


def loaded_c172(rate_hz: float) -> Any:
    """Return JSBSim's C172 before its initial conditions, in steps of 1 / ``rate_hz``; raises `NoFlightModelError`."""
    try:
        jsbsim = import_module("jsbsim")
    except ImportError as fault:
        raise NoFlightModelError("jsbsim", got="not installed", wanted="pip install 'groundstation[jsbsim]'") from fault
    jsbsim.FGJSBBase().debug_lvl = 0
    model = jsbsim.FGFDMExec(None)
    model.load_model("c172x")
    # its own table would go into the folder that it is run from; the file is made though nothing is written
    model.set_output_filename(0, "/dev/null")
    model.disable_output()
    model.set_dt(1.0 / rate_hz)
    return model


def start_turbulence(model: Any, seed: int, wind_m_s: float) -> None:
    """Start turbulence of a wind's strength, the same for the same seed."""
    # turbulence of type 3 is MIL-F-8785C
    for name, value in (
        ("simulation/randomseed", float(seed % _SEEDS or _SEEDS - 1)), ("atmosphere/turb-type", 3.0),
        ("atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps", 2.5 * wind_m_s / FOOT_M),
        ("atmosphere/turbulence/milspec/severity", _SEVERITY),
    ):  # fmt: skip
        model[name] = value


def _hold(model: Any, pitch_rad: float, glide_rad: float) -> None:
    """Hold the descent and the heading with elevator and aileron."""
    speed = max(float(model["velocities/vt-fps"]), 1.0)
    path = float(model["velocities/v-down-fps"]) / speed - float(np.sin(glide_rad))
    off = model["attitude/theta-rad"] - pitch_rad - _PITCH_BY_PATH * path
    elevator = _ELEVATOR[0] * off + _ELEVATOR[1] * model["velocities/q-rad_sec"]
    yaw = (float(model["attitude/psi-rad"]) + np.pi) % (2.0 * np.pi) - np.pi
    bank = model["attitude/phi-rad"] + _BANK_BY_HEADING * yaw
    aileron = _AILERON[0] * bank + _AILERON[1] * model["velocities/p-rad_sec"]
    model["fcs/elevator-cmd-norm"] = float(min(max(elevator, -1.0), 1.0))
    model["fcs/aileron-cmd-norm"] = float(min(max(-aileron, -1.0), 1.0))
