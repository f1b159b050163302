"""The stream to an autopilot: which message is sent when, of which state, and when nothing is.

A message tells the state at the time to which the vehicle will attribute it: the arrival, less the delay that its
parameters state. The state is predicted to that time, or interpolated between the last pictures. While there is no
track, or no camera has seen the target lately, nothing is sent: neither the last state again nor an extrapolated one.
What the link's delay varies by is an error of that time, and of the position along its velocity: the covariance has it.
"""

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.global_position_sensor import global_position_sensor
from groundstation.autopilot.gps_input import gps_input
from groundstation.autopilot.lever_arm import MovedState, moved_to_reference
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.navigation_state import NavigationState
from groundstation.autopilot.reset_detector import ResetDetector
from groundstation.autopilot.settings import MOST_DELAY_S, AutopilotMode, AutopilotSettings
from groundstation.autopilot.vehicle_delay import assumed_delay_s, ekf3_memory_s
from groundstation.autopilot.vehicle_state import ARDUPILOT, VehicleState
from groundstation.autopilot.vision_estimate import global_origin, odometry, vision_estimates
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.messages import Kinematics, StepReport, TrackStatus

# ArduPilot calls external navigation unhealthy after 0.3 s without a sample
_LATEST_FIX_S = 0.3
# The velocity of a track that has just been found is known to tens of m/s. EKF3 holds the largest accuracy that a
# receiver has told it, decaying in 5 s, and takes its height from below 1 m/s on: 5.5 s after this, 17 s after 30 m/s.
# Chosen
_FIRST_SPEED_SIGMA_M_S = 3.0
# a radio may not ask for a longer prediction
_MOST_PREDICTION_S = 0.5
_EVERY_S = 1.0
# half a metre at 25 m/s
_MUCH_S = 0.02
# of a vehicle that is heard, the clock is asked for more often: the fastest of few answers is late
_CLOCK_EVERY_S = 0.2
# ArduPilot's external navigation over a radio whose delay varies by more than the time between messages: in their queue
# few are fast, and it judges the fastest by its last hundred. At 20 Hz eight landings had 1.18 times the filter's error
# where 40 Hz had 1.44, at 10 Hz 1.12, with gaps of 0.4 s (benchmarks/autopilot_stream.py's radio)
_QUEUED_PERIOD_S = 0.05
# of the last minutes
_KEPT_AGES = 10_000
_ALL_STATIONS, _ONE_STATION = 100, 50


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamClock:
    """Session time on the link's clock and as Unix time: what is added to it, s."""

    link_s: float
    unix_s: float

    def link_us(self, t_s: float) -> int:
        """Return a session time on the link's clock, µs."""
        return round((t_s + self.link_s) * 1e6)


@dataclass(slots=True)
class StreamStatistics:
    """``sent`` states, ``withheld`` by reason, ``resets`` announced; ages of the newest picture when sent, s."""

    sent: int = 0
    resets: int = 0
    withheld: Counter[str] = field(default_factory=Counter)
    ages_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_AGES))


class AutopilotStream:
    """Messages for one vehicle.

    Parameters
    ----------
    settings : of the stream.
    frame : the runway frame on Earth.
    clock : of the link.
    estimate_at : the target at a session time, as `Pipeline.estimate_at` returns it.
    """

    def __init__(
        self,
        settings: AutopilotSettings,
        frame: LocalFrame,
        clock: StreamClock,
        estimate_at: Callable[[float], Kinematics | None],
    ) -> None:
        self.statistics = StreamStatistics()
        self.silent_because = "no track yet"
        self._settings, self._frame, self._clock = settings, frame, clock
        self._estimate_at = estimate_at
        self._arm = np.array(settings.reference_in_body_m or (0.0, 0.0, 0.0))
        self._rotation = np.kron(np.eye(2), frame.ned_from_runway)
        self._resets = ResetDetector()
        self._status, self._has_begun = TrackStatus.SEARCHING, False
        self._fix_s, self._stations = -math.inf, 0
        self._due_s: float | None = None
        self._is_queued = False
        self._service_s = -math.inf
        self._clock_asked_s = -math.inf
        self._last_stamp_us = -1
        # of stamps before their sending, for ArduPilot, and the delay that was known when that was chosen
        self._stamp_lead_s: float | None = None
        self._stamped_delay_s = 0.0

    def note(self, report: StepReport) -> None:
        """Note what the pipeline answered; before the `messages` of that time."""
        for estimate in report.estimates:
            self._note_status(estimate.status)
            if estimate.kinematics is not None and estimate.seen_by:
                self._fix_s, self._stations = estimate.t_s, len(estimate.seen_by)
        for state in report.states:
            self._note_status(state.status)

    def _note_status(self, status: TrackStatus) -> None:
        if status in (TrackStatus.LOST, TrackStatus.SEARCHING) and status is not self._status:
            self._resets.lost()
        if status not in (TrackStatus.TRACKING, TrackStatus.COASTING):
            self._has_begun = False
        self._status = status

    def messages(self, now_s: float, vehicle: VehicleState) -> list[MavlinkMessage]:
        """Return what is to be sent at a session time; to be called often, at least at the stream's rate."""
        messages = [*self._service(now_s, vehicle), *self._clock_request(now_s, vehicle)]
        period_s = self._period_s(vehicle)
        if self._due_s is None:
            self._due_s = now_s
        # a little early is on time: the grid is kept, not the distance to the last message
        if now_s < self._due_s - 0.01 * period_s:
            return messages
        self._due_s += period_s * (math.floor((now_s - self._due_s) / period_s + 0.01) + 1)
        state = self._state(now_s, vehicle)
        if isinstance(state, str):
            self.silent_because = state
            self.statistics.withheld[state] += 1
            return messages
        return messages + self._encoded(state, now_s, vehicle)

    def _period_s(self, vehicle: VehicleState) -> float:
        """Return the time between messages, s: that of the settings, longer where they would queue in the radio."""
        settings = self._settings
        external = settings.mode in (AutopilotMode.VISION, AutopilotMode.ODOMETRY) and vehicle.autopilot == ARDUPILOT
        if settings.rate_hz is not None or not external:
            return settings.period_s
        # not back again: the spacing is to be steady, and without a queue the delay varies less
        self._is_queued = self._is_queued or vehicle.link_delay.one_way_sigma_s > settings.period_s
        return _QUEUED_PERIOD_S if self._is_queued else settings.period_s

    # ---------------------------------------------------------------------------------- which state
    def delay_s(self, vehicle: VehicleState) -> float:
        """Return how long before its arrival the vehicle takes a measurement to be, s."""
        return assumed_delay_s(self._settings, vehicle)

    def state_time_s(self, now_s: float, vehicle: VehicleState) -> float:
        """Return the time for which the vehicle takes what is sent at ``now_s``; both session time."""
        return now_s + self.link_delay_s(vehicle) - self.delay_s(vehicle)

    def link_delay_s(self, vehicle: VehicleState) -> float:
        """Return the delay of the link, one way, s, as the vehicle takes it.

        ArduPilot attributes every message as if it had been as fast as the fastest, PX4 by its own arrival.
        """
        if self._settings.link_delay_s is not None:
            return self._settings.link_delay_s
        link = vehicle.link_delay
        return (link.least_one_way_s if self._by_the_fastest(vehicle) else link.one_way_s) or 0.0

    def link_delay_sigma_s(self, vehicle: VehicleState) -> float:
        """Return one sigma of the time for which the vehicle takes a message, s.

        Of PX4 it is that of the arrivals: one whose clock follows the sender's by TIMESYNC is wrong by less, but from
        outside it is not seen which it is. ArduPilot takes the fastest message for all: it is wrong by what is not
        known of that, and by what a message is later than its filter's memory holds.
        """
        told_s = self._settings.link_delay_sigma_s
        if told_s is not None:
            return told_s
        link = vehicle.link_delay
        if not self._by_the_fastest(vehicle):
            return link.one_way_sigma_s
        left_s = ekf3_memory_s(self._settings, vehicle) - self.delay_s(vehicle)
        return math.hypot(link.least_sigma_s, link.beyond_sigma_s(left_s))

    def doubt(self, vehicle: VehicleState) -> str:
        """Return what is to be said of the link's varying delay; "" where it is little or not known."""
        sigma_s = self.link_delay_sigma_s(vehicle)
        if vehicle.link_delay.one_way_s is None or sigma_s < _MUCH_S:
            return ""
        words = f"the link's delay varies: positions are misdated by {1e3 * sigma_s:.0f} ms (1 σ)"
        if not self._by_the_fastest(vehicle):
            return words
        return f"{words}, EKF3 remembers {1e3 * ekf3_memory_s(self._settings, vehicle):.0f} ms (EK3_BCN_DELAY)"

    def _by_the_fastest(self, vehicle: VehicleState) -> bool:
        return self._settings.mode is AutopilotMode.GPS_INPUT or vehicle.autopilot == ARDUPILOT

    def _state(self, now_s: float, vehicle: VehicleState) -> NavigationState | str:
        """Return the state to be sent, or why there is none."""
        if self._status not in (TrackStatus.TRACKING, TrackStatus.COASTING):
            return f"no track: {self._status.value}"
        if now_s - self._fix_s > _LATEST_FIX_S:
            return f"no camera has seen it for {_LATEST_FIX_S:g} s"
        delay_s = self.delay_s(vehicle)
        if delay_s > MOST_DELAY_S[self._settings.mode]:
            return f"the vehicle states a delay of {1e3 * delay_s:.0f} ms, which its filter does not take"
        t_s = self.state_time_s(now_s, vehicle)
        if t_s - self._fix_s > _MOST_PREDICTION_S:
            return f"the link is slower than {_MOST_PREDICTION_S:g} s"
        kinematics = self._estimate_at(t_s)
        if kinematics is None or not _usable(kinematics):
            return "no estimate of that time"
        state = self._at_reference(t_s, kinematics, vehicle)
        sent = state.attributed_within(self.link_delay_sigma_s(vehicle))
        if max(sent.worst_horizontal_sigma_m, sent.vertical_sigma_m) > self._settings.most_sigma_m:
            return f"one sigma is more than {self._settings.most_sigma_m:g} m"
        # the other messages have a sigma for each axis, or no velocity
        if self._settings.mode is AutopilotMode.GPS_INPUT and not self._has_begun:
            if sent.speed_sigma_m_s > _FIRST_SPEED_SIGMA_M_S:
                return f"a new track's velocity is not known to {_FIRST_SPEED_SIGMA_M_S:g} m/s yet (1 σ)"
            self._has_begun = True
        return state

    def _at_reference(self, t_s: float, kinematics: Kinematics, vehicle: VehicleState) -> NavigationState:
        attitude = None if vehicle.attitude is None else vehicle.attitude.at(t_s)
        nose = MovedState(
            position_m=self._frame.ned_from_runway @ kinematics.position_runway_m,
            velocity_m_s=self._frame.ned_from_runway @ kinematics.velocity_runway_m_s,
            covariance=self._rotation @ kinematics.covariance @ self._rotation.T,
        )
        moved = moved_to_reference(nose, self._arm, attitude)
        geodetic = self._frame.geodetic(moved.position_m)
        position = moved.position_m
        if self._settings.mode in (AutopilotMode.VISION, AutopilotMode.ODOMETRY) and vehicle.global_origin is not None:
            position = self._frame.about(geodetic, vehicle.global_origin)
        return NavigationState(
            t_s=t_s,
            position_ned_m=position,
            velocity_ned_m_s=moved.velocity_m_s,
            covariance=moved.covariance,
            geodetic=geodetic,
            attitude_wxyz=None if attitude is None else wxyz_from_matrix(attitude.ned_from_body),
            stations=self._stations,
        )

    # ------------------------------------------------------------------------------------- encoding
    def _stamp_s(self, state: NavigationState, now_s: float, vehicle: VehicleState) -> float:
        """Return the session time that a message is stamped with.

        The vehicle subtracts its delay from the stamp, or from the arrival where clocks are not synchronised. ArduPilot
        compares stamps with arrivals over many messages: they keep their distance from the sending, whatever is learnt
        of the link meanwhile.
        """
        if not self._by_the_fastest(vehicle):
            return state.t_s + self.delay_s(vehicle)
        if self._stamp_lead_s is None:
            self._stamp_lead_s, self._stamped_delay_s = self.link_delay_s(vehicle), self.delay_s(vehicle)
        return now_s + self._stamp_lead_s

    def _encoded(self, state: NavigationState, now_s: float, vehicle: VehicleState) -> list[MavlinkMessage]:
        stamp_s = self._stamp_s(state, now_s, vehicle)
        stamp_us = self._clock.link_us(stamp_s)
        if stamp_us <= self._last_stamp_us or stamp_us < 0:
            self.silent_because = "a state of that time was sent"
            self.statistics.withheld[self.silent_because] += 1
            return []
        self._last_stamp_us, self.silent_because = stamp_us, ""
        # whether the track has jumped does not depend on the link
        counter = self._resets.counter_of(state)
        state = state.attributed_within(self.link_delay_sigma_s(vehicle))
        self.statistics.sent += 1
        self.statistics.resets = self._resets.resets
        self.statistics.ages_s.append(now_s - self._fix_s)
        mode = self._settings.mode
        if mode is AutopilotMode.GPS_INPUT:
            unix_s = stamp_s - self._stamped_delay_s + self._clock.unix_s
            return [gps_input(state, stamp_us=stamp_us, unix_s=unix_s, gps_id=self._settings.gps_id)]
        if mode is AutopilotMode.GLOBAL_POSITION:
            # a state ahead of its sending, over a slow link, has no age: it is sent as if later
            sent_us = max(self._clock.link_us(now_s), stamp_us)
            target = (vehicle.system or self._settings.target_system, 0)
            age_us = sent_us - stamp_us
            return [
                global_position_sensor(
                    state, sent_us=sent_us, age_us=age_us, sensor_id=self._settings.sensor_id, target=target
                )
            ]
        if mode is AutopilotMode.VISION:
            return list(vision_estimates(state, stamp_us=stamp_us, reset_counter=counter))
        quality = _ALL_STATIONS if state.stations > 1 else _ONE_STATION
        return [odometry(state, stamp_us=stamp_us, reset_counter=counter, quality=quality)]

    def _service(self, now_s: float, vehicle: VehicleState) -> list[MavlinkMessage]:
        """Return the messages of each second: heartbeat, origin of the local frame."""
        if now_s < self._service_s + _EVERY_S:
            return []
        self._service_s = now_s
        stamp_us = self._clock.link_us(now_s)
        messages = [HEARTBEAT]
        if self._settings.mode in (AutopilotMode.VISION, AutopilotMode.ODOMETRY) and vehicle.global_origin is None:
            place, system = self._frame.origin, vehicle.system or self._settings.target_system
            messages.append(
                global_origin(place.lat_deg, place.lon_deg, place.height_amsl_m, system=system, stamp_us=stamp_us)
            )
        return messages

    def _clock_request(self, now_s: float, vehicle: VehicleState) -> list[MavlinkMessage]:
        every_s = _EVERY_S if vehicle.system is None else _CLOCK_EVERY_S
        if now_s < self._clock_asked_s + every_s:
            return []
        self._clock_asked_s = now_s
        return [MavlinkMessage(name="TIMESYNC", fields={"tc1": 0, "ts1": self._clock.link_us(now_s) * 1000})]


# MAV_TYPE_ONBOARD_CONTROLLER, MAV_AUTOPILOT_INVALID, MAV_STATE_ACTIVE
HEARTBEAT = MavlinkMessage(
    name="HEARTBEAT",
    fields={
        "type": 18,
        "autopilot": 8,
        "base_mode": 0,
        "custom_mode": 0,
        "system_status": 4,
        "mavlink_version": 3,
    },
)


def _usable(kinematics: Kinematics) -> bool:
    values: tuple[FloatArray, ...] = (
        kinematics.position_runway_m,
        kinematics.velocity_runway_m_s,
        kinematics.covariance,
    )
    return all(bool(np.all(np.isfinite(v))) for v in values) and bool(np.all(np.diag(kinematics.covariance) > 0.0))
