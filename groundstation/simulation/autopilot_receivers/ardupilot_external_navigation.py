"""ArduPilot's external navigation (VISO_TYPE = 1): ODOMETRY and VISION_POSITION_ESTIMATE, as EKF3 takes them.

Positions only: VISION_SPEED_ESTIMATE goes into another buffer of the filter.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.message import MavlinkMessage
from groundstation.simulation.autopilot_receivers.ardupilot_gps import ekf3_memory_s
from groundstation.simulation.autopilot_receivers.least_lag import LeastLagClock
from groundstation.simulation.autopilot_receivers.receipt import (
    Receipt,
    ReceiptVerdict,
    ReceivedSample,
    finite,
    listed,
    local_position,
    number,
    numbers,
    refused,
)

# MAV_FRAME_LOCAL_FRD and MAV_FRAME_BODY_FRD
_FRAMES = [20, 12]
_MOST_LAG_S = 0.5
# stamps are whole ms; a sample that follows sooner is dropped
_LEAST_INTERVAL_MS = 20
_HEALTHY_S = 0.3
# of the pose covariance's upper triangle: the variances of x, y and z
_VARIANCES = [0, 6, 11]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalNavigationParameters:
    """VISO_TYPE, VISO_DELAY_MS, EK3_BCN_DELAY, VISO_POS_M_NSE, VISO_QUAL_MIN."""

    viso_type: int = 1
    delay_ms: float = 10.0
    beacon_delay_ms: float = 50.0
    position_noise_m: float = 0.2
    least_quality: int = 0


class ExternalNavigationReceiver:
    """ODOMETRY and VISION_POSITION_ESTIMATE as ArduPilot takes them."""

    def __init__(self, frame: LocalFrame, parameters: ExternalNavigationParameters) -> None:
        self._frame, self._parameters = frame, parameters
        self._clock = LeastLagClock(_MOST_LAG_S)
        self._taken_ms: int | None = None
        self._heard_s = -math.inf
        self._counter: float | None = None

    def healthy(self, now_s: float) -> bool:
        """Return whether a sample came within 0.3 s: else the vehicle refuses to arm."""
        return now_s - self._heard_s < _HEALTHY_S

    def receive(self, message: MavlinkMessage, now_s: float) -> Receipt:
        """Take a message that arrives at ``now_s`` on the vehicle's clock."""
        verdict = self._refusal(message)
        if verdict is not None:
            return refused(verdict)
        self._heard_s = now_s
        odometry = message.name == "ODOMETRY"
        stamp_s = 1e-6 * number(message, "time_usec" if odometry else "usec")
        local_ms = math.floor(1e3 * self._clock.local_s(stamp_s, now_s))
        # unsigned: one that goes back is no interval below 20 ms
        if self._taken_ms is not None and 0 <= local_ms - self._taken_ms < _LEAST_INTERVAL_MS:
            return refused(ReceiptVerdict.TOO_SOON)
        self._taken_ms = local_ms
        t_s = 1e-3 * (local_ms - self._parameters.delay_ms)
        oldest_s = now_s - ekf3_memory_s(
            *(1e-3 * ms for ms in (self._parameters.delay_ms, self._parameters.beacon_delay_ms))
        )
        counter, last = number(message, "reset_counter"), self._counter
        self._counter = counter
        sigma_m = max(_stated_sigma_m(message), self._parameters.position_noise_m)
        return Receipt(
            verdict=ReceiptVerdict.HELD if t_s < oldest_s else ReceiptVerdict.ACCEPTED,
            sample=ReceivedSample(
                t_s=max(t_s, oldest_s),
                position_runway_m=local_position(message, self._frame),
                velocity_ned_m_s=None,
                sigma_horizontal_m=sigma_m,
                sigma_vertical_m=sigma_m,
                sigma_speed_m_s=math.inf,
                reset=last is not None and counter != last,
            ),
        )

    def _refusal(self, message: MavlinkMessage) -> ReceiptVerdict | None:
        if message.name not in ("ODOMETRY", "VISION_POSITION_ESTIMATE") or self._parameters.viso_type not in (1, 3):
            return ReceiptVerdict.NOT_SELECTED
        quality = 0.0
        if message.name == "ODOMETRY":
            if numbers(message, "frame_id", "child_frame_id").tolist() != _FRAMES:
                return ReceiptVerdict.WRONG_FRAMES
            quality = number(message, "quality")
        # -1 is a failure; the position estimate has no such field, and counts as 0
        if quality < 0 or quality < self._parameters.least_quality:
            return ReceiptVerdict.LOW_QUALITY
        if not finite(numbers(message, "x", "y", "z")):
            return ReceiptVerdict.NOT_FINITE
        return None


def _stated_sigma_m(message: MavlinkMessage) -> float:
    """Return the error that ArduPilot reads from a covariance: the cube root of the sum of squared variances."""
    name = "pose_covariance" if message.name == "ODOMETRY" else "covariance"
    variances = listed(message, name)[_VARIANCES]
    if not math.isfinite(variances[0]):
        return 0.0
    return float(np.cbrt(np.sum(variances**2)))
