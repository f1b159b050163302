"""ArduPilot's MAVLink receiver (GPS1_TYPE = 14) and EKF3's intake of its samples: GPS_INPUT."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.message import MavlinkMessage
from groundstation.simulation.autopilot_receivers.least_lag import LeastLagClock
from groundstation.simulation.autopilot_receivers.receipt import (
    Receipt,
    ReceiptVerdict,
    ReceivedSample,
    finite,
    geodetic_position,
    number,
    numbers,
    refused,
)

_TYPE_MAVLINK = 14
_FIX_3D = 3
# the time between samples of a sensor; the driver's own lag; s
_LEAST_INTERVAL_S = 0.05
_DRIVER_LAG_S = 0.2
_MOST_LAG_S = 0.5
_WEEK_S = 604_800.0
# EKF3 keeps the largest accuracy stated, which decays with this time constant
_ENVELOPE_S = 5.0
# of a vehicle that measures its airspeed; the filter was tested with no longer memory than this
_AIRSPEED_S, _MOST_MEMORY_S = 0.1, 0.25
# the bits of ignore_flags: height, horizontal and vertical velocity
_NO_HEIGHT, _NO_VELOCITY = 1, 8 | 16


def ekf3_memory_s(*delays_s: float) -> float:
    """Return how far back EKF3 has inertial data: the longest delay of its sensors, airspeed and compass among them."""
    return min(max(_AIRSPEED_S, *delays_s), _MOST_MEMORY_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArdupilotGpsParameters:
    """GPS1_TYPE, instance, GPS1_DELAY_MS (0: the driver's own), EK3_BCN_DELAY, EK3_POSNE_M_NSE, EK3_VELNE_M_NSE."""

    gps_type: int = _TYPE_MAVLINK
    gps_id: int = 0
    delay_ms: float = 0.0
    beacon_delay_ms: float = 50.0
    position_noise_m: float = 0.5
    # of a plane; a copter has 0.3
    speed_noise_m_s: float = 0.5


class ArdupilotGpsReceiver:
    """GPS_INPUT as ArduPilot takes it."""

    def __init__(self, frame: LocalFrame, parameters: ArdupilotGpsParameters) -> None:
        self._frame, self._parameters = frame, parameters
        self._clock = LeastLagClock(_MOST_LAG_S)
        self._first_week: float | None = None
        self._taken_s = -math.inf
        # horizontal, vertical, speed
        self._accuracy = np.zeros(3)

    def receive(self, message: MavlinkMessage, now_s: float) -> Receipt:
        """Take a message that arrives at ``now_s`` on the vehicle's clock."""
        verdict = self._refusal(message)
        if verdict is not None:
            return refused(verdict)
        week = number(message, "time_week")
        self._first_week = week if self._first_week is None else self._first_week
        # the driver counts in ms
        stamp_s = (week - self._first_week) * _WEEK_S + 1e-3 * number(message, "time_week_ms")
        local_s = self._clock.local_s(stamp_s, now_s)
        if abs(local_s - self._taken_s) <= _LEAST_INTERVAL_S:
            return refused(ReceiptVerdict.TOO_SOON)
        decay = 1.0 - min((local_s - self._taken_s) / _ENVELOPE_S, 1.0)
        self._taken_s = local_s
        lag_s = 1e-3 * self._parameters.delay_ms or _DRIVER_LAG_S
        memory_s = ekf3_memory_s(lag_s, 1e-3 * self._parameters.beacon_delay_ms)
        t_s = local_s - lag_s
        held = t_s < now_s - memory_s
        stated = numbers(message, "horiz_accuracy", "vert_accuracy", "speed_accuracy")
        least_m = self._parameters.position_noise_m
        # one and a half times the horizontal noise is the height's floor
        least = np.array([least_m, 1.5 * least_m, self._parameters.speed_noise_m_s])
        self._accuracy = np.maximum(np.maximum(decay * self._accuracy, stated), least)
        horizontal, vertical, speed = (float(sigma) for sigma in self._accuracy)
        return Receipt(
            verdict=ReceiptVerdict.HELD if held else ReceiptVerdict.ACCEPTED,
            sample=ReceivedSample(
                t_s=max(t_s, now_s - memory_s),
                position_runway_m=geodetic_position(message, self._frame),
                velocity_ned_m_s=numbers(message, "vn", "ve", "vd"),
                sigma_horizontal_m=horizontal,
                sigma_vertical_m=vertical,
                sigma_speed_m_s=speed,
            ),
        )

    def _refusal(self, message: MavlinkMessage) -> ReceiptVerdict | None:
        """Return why a message is not taken; None if it is."""
        if message.name != "GPS_INPUT" or self._parameters.gps_type != _TYPE_MAVLINK:
            return ReceiptVerdict.NOT_SELECTED
        if number(message, "gps_id") != self._parameters.gps_id:
            return ReceiptVerdict.OTHER_INSTANCE
        if number(message, "fix_type") < _FIX_3D or not numbers(message, "lat", "lon").any():
            return ReceiptVerdict.NO_FIX
        if number(message, "time_week") <= 0:
            return ReceiptVerdict.NO_WEEK
        ignored = int(number(message, "ignore_flags"))
        if ignored & (_NO_HEIGHT | _NO_VELOCITY):
            return ReceiptVerdict.NO_FIX
        if not finite(numbers(message, "alt", "vn", "ve", "vd", "horiz_accuracy", "vert_accuracy", "speed_accuracy")):
            return ReceiptVerdict.NOT_FINITE
        return None
