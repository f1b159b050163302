"""PX4's EKF2: external vision (VISION_POSITION_ESTIMATE, ODOMETRY) and auxiliary global position (AGP).

PX4 sets its clock against the sender's by TIMESYNC, but only where the round trip is below 10 ms. Over a slower link
each message's stamp is its arrival.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.message import MavlinkMessage
from groundstation.simulation.autopilot_receivers.receipt import (
    Receipt,
    ReceiptVerdict,
    ReceivedSample,
    finite,
    geodetic_position,
    listed,
    local_position,
    number,
    numbers,
    refused,
)

# EKF2's memory; vision is fused once two samples are this close, until none has come for so long; s
MEMORY_S = 0.175
_START_S, _STOP_S = 0.2, 0.4
_STOP_GLOBAL_S = 5.0
# a ring buffer for the memory, one place for each update of the filter: closer samples are dropped
_LEAST_INTERVAL_S = 0.008
_LEAST_GLOBAL_NOISE_M = 0.01
_LOCAL_NED, _LOCAL_FRD = 1, 20
_VARIANCES = [0, 6, 11]


@dataclass(frozen=True, slots=True, kw_only=True)
class Px4VisionParameters:
    """EKF2_EV_DELAY, EKF2_EVP_NOISE, EKF2_EV_QMIN."""

    delay_ms: float = 0.0
    position_noise_m: float = 0.1
    least_quality: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Px4GlobalParameters:
    """EKF2_AGP0_ID, EKF2_AGP0_DELAY, EKF2_AGP0_NOISE."""

    sensor_id: int = 1
    delay_ms: float = 0.0
    noise_m: float = 1.0


class SampleSeries:
    """Which samples EKF2 takes, by their times.

    Parameters
    ----------
    stop_s : after such a gap fusion has stopped, and has to start with a pair of samples within 0.2 s.
    """

    def __init__(self, stop_s: float) -> None:
        self._stop_s = stop_s
        self._last_s = -math.inf
        self._fusing = False

    def verdict(self, t_s: float, now_s: float) -> ReceiptVerdict:
        """Return what becomes of a sample of ``t_s`` that arrives at ``now_s``."""
        if t_s < now_s - MEMORY_S:
            return ReceiptVerdict.TOO_OLD
        gap_s = t_s - self._last_s
        if gap_s < _LEAST_INTERVAL_S:
            return ReceiptVerdict.TOO_SOON
        self._last_s = t_s
        self._fusing = gap_s <= _START_S or (self._fusing and gap_s <= self._stop_s)
        return ReceiptVerdict.ACCEPTED if self._fusing else ReceiptVerdict.STARTING


class Px4VisionReceiver:
    """External vision; ``clock_offset_s`` to be added to the sender's stamps, None where TIMESYNC found none."""

    def __init__(self, frame: LocalFrame, parameters: Px4VisionParameters, clock_offset_s: float | None) -> None:
        self._frame, self._parameters, self._offset_s = frame, parameters, clock_offset_s
        self._series = SampleSeries(_STOP_S)
        self._counter: float | None = None

    def receive(self, message: MavlinkMessage, now_s: float) -> Receipt:
        """Take a message that arrives at ``now_s`` on the vehicle's clock."""
        if message.name not in ("ODOMETRY", "VISION_POSITION_ESTIMATE"):
            return refused(ReceiptVerdict.NOT_SELECTED)
        odometry = message.name == "ODOMETRY"
        if odometry and number(message, "frame_id") not in (_LOCAL_NED, _LOCAL_FRD):
            return refused(ReceiptVerdict.WRONG_FRAMES)
        if odometry and number(message, "quality") < self._parameters.least_quality:
            return refused(ReceiptVerdict.LOW_QUALITY)
        if not finite(numbers(message, "x", "y", "z")):
            return refused(ReceiptVerdict.NOT_FINITE)
        stamp_s = 1e-6 * number(message, "time_usec" if odometry else "usec")
        t_s = (now_s if self._offset_s is None else stamp_s + self._offset_s) - 1e-3 * self._parameters.delay_ms
        verdict = self._series.verdict(t_s, now_s)
        if verdict is not ReceiptVerdict.ACCEPTED:
            return refused(verdict)
        counter, last = number(message, "reset_counter"), self._counter
        self._counter = counter
        variances = listed(message, "pose_covariance" if odometry else "covariance")[_VARIANCES]
        # only the diagonal is used, each with a lower bound
        sigma = np.maximum(np.sqrt(np.where(np.isfinite(variances), variances, 0.0)), self._parameters.position_noise_m)
        return Receipt(
            verdict=verdict,
            sample=ReceivedSample(
                t_s=t_s,
                position_runway_m=local_position(message, self._frame),
                velocity_ned_m_s=None,
                sigma_horizontal_m=float(np.max(sigma[:2])),
                sigma_vertical_m=float(sigma[2]),
                sigma_speed_m_s=math.inf,
                sigma_north_east_m=(float(sigma[0]), float(sigma[1])),
                reset=last is not None and counter != last,
            ),
        )


class Px4GlobalReceiver:
    """GLOBAL_POSITION_SENSOR; ``clock_offset_s`` as of `Px4VisionReceiver`."""

    def __init__(self, frame: LocalFrame, parameters: Px4GlobalParameters, clock_offset_s: float | None) -> None:
        self._frame, self._parameters, self._offset_s = frame, parameters, clock_offset_s
        self._series = SampleSeries(_STOP_GLOBAL_S)

    def receive(self, message: MavlinkMessage, now_s: float) -> Receipt:
        """Take a message that arrives at ``now_s`` on the vehicle's clock."""
        if message.name != "GLOBAL_POSITION_SENSOR":
            return refused(ReceiptVerdict.NOT_SELECTED)
        if number(message, "id") != self._parameters.sensor_id:
            return refused(ReceiptVerdict.OTHER_INSTANCE)
        if not finite(numbers(message, "lat", "lon", "alt", "eph", "epv")):
            return refused(ReceiptVerdict.NOT_FINITE)
        sent_s = now_s if self._offset_s is None else 1e-6 * number(message, "time_usec") + self._offset_s
        t_s = sent_s - 1e-6 * number(message, "processing_time") - 1e-3 * self._parameters.delay_ms
        verdict = self._series.verdict(t_s, now_s)
        if verdict is not ReceiptVerdict.ACCEPTED:
            return refused(verdict)
        least_m = max(self._parameters.noise_m, _LEAST_GLOBAL_NOISE_M)
        return Receipt(
            verdict=verdict,
            sample=ReceivedSample(
                t_s=t_s,
                position_runway_m=geodetic_position(message, self._frame),
                velocity_ned_m_s=None,
                sigma_horizontal_m=max(number(message, "eph"), least_m),
                sigma_vertical_m=max(number(message, "epv"), least_m),
                sigma_speed_m_s=math.inf,
            ),
        )
