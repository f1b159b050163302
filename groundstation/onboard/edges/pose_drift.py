"""What poses by the motion between pictures are wrong by besides the tuning of the tracker."""

import math
from dataclasses import dataclass, replace

from groundstation.onboard.edges.config import TrackerConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseDrift:
    """Errors of one picture's pose besides those of the tuning; sigmas in rad and m.

    Attributes
    ----------
    turn_rad, shift_m : of this picture's pose, which a later row of a log ends.
    new_turn_rad, new_shift_m : that came with this picture and last: the lines move in the poses' frame by as much.
    """

    turn_rad: float = 0.0
    shift_m: float = 0.0
    new_turn_rad: float = 0.0
    new_shift_m: float = 0.0


NO_DRIFT = PoseDrift()


def with_drift(config: TrackerConfig, drift: PoseDrift) -> TrackerConfig:
    """Return the tuning for a picture whose pose has drifted."""
    if drift == NO_DRIFT:
        return config
    x, y, z = (math.hypot(sigma, drift.shift_m) for sigma in config.position_sigma_m)
    return replace(
        config,
        attitude_sigma_rad=math.hypot(config.attitude_sigma_rad, drift.turn_rad),
        position_sigma_m=(x, y, z),
        turn_sigma_rad=math.hypot(config.turn_sigma_rad, drift.new_turn_rad),
        lasting_turn_rad=math.hypot(config.lasting_turn_rad, drift.new_turn_rad),
        shift_sigma_m=math.hypot(config.shift_sigma_m, drift.new_shift_m),
        lasting_rise_m=math.hypot(config.lasting_rise_m, drift.new_shift_m),
    )
