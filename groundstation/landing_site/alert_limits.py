"""Alert limits: errors of the position beyond which a landing is not to be continued."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class AlertLimits:
    """Limits of the position error, m; the defaults are for a runway of 15 m and a span of 2.3 m.

    Attributes
    ----------
    lateral_m, along_m : across and along the landing direction.
    vertical_m : above ``low_height_m`` over the threshold.
    vertical_low_m : at or below it.
    time_to_alert_s : from the moment an error exceeds its limit to the alert.
    """

    lateral_m: float = 3.0
    vertical_m: float = 1.5
    vertical_low_m: float = 0.6
    low_height_m: float = 5.0
    along_m: float = 15.0
    time_to_alert_s: float = 0.5

    def vertical_at(self, height_m: float) -> float:
        """Return the vertical limit at a height over the threshold, m."""
        return self.vertical_m if height_m > self.low_height_m else self.vertical_low_m
