"""A head at the middle of an exposure, and how it turns."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadMotion:
    """State of a head at mid-exposure: pan and tilt in rad, their rates in rad/s."""

    pan_rad: float
    tilt_rad: float
    pan_rate_rad_s: float = 0.0
    tilt_rate_rad_s: float = 0.0

    def after(self, dt_s: float) -> "HeadMotion":
        """Return the state so much later, s, at constant rates."""
        pan, tilt = self.pan_rad + dt_s * self.pan_rate_rad_s, self.tilt_rad + dt_s * self.tilt_rate_rad_s
        return HeadMotion(
            pan_rad=pan, tilt_rad=tilt, pan_rate_rad_s=self.pan_rate_rad_s, tilt_rate_rad_s=self.tilt_rate_rad_s
        )
