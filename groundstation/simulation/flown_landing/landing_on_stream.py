"""A landing on the stream alone: the station follows the aircraft that flies on what the station tells it.

The cameras are at the level of pixels and angles (`closed_loop`); the stated rig is off by what its covariance states.
Position and velocity reach the vehicle by the messages of the stream, over a radio, through its receiver's rules, and
by no other way; at the start it has a position that is off by metres, as if it had come on a poor source.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.received import receive
from groundstation.autopilot.settings import AutopilotSettings
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.messages import Kinematics, StepReport, TrackStatus
from groundstation.rig.rig import Rig
from groundstation.simulation.autopilot_receivers.landing_streams import RECEIVERS, SITE_FRAME
from groundstation.simulation.autopilot_receivers.radio_link import RadioLink, RadioLinkModel
from groundstation.simulation.autopilot_receivers.receipt import ReceivedSample
from groundstation.simulation.closed_loop import ClosedLoopFault, ClosedLoopResult, ClosedLoopSimulation
from groundstation.simulation.flights import site_rig
from groundstation.simulation.flown_landing.inertial_navigation import (
    InertialNavigation,
    PositionSample,
    VehiclePosition,
)
from groundstation.simulation.flown_landing.landing_flight import STEP_S, FlownLanding, LandingFlight, LandingSetup
from groundstation.simulation.rig_errors import StationErrors, drawn_errors, perturbed
from groundstation.simulation.stream_over_radio import VEHICLE_CLOCK_S, StreamOverRadio
from groundstation.tracking.config import Config

DEFAULT_RECEIVER = "ArduPilot GPS_INPUT, GPS1_DELAY_MS 50"
# errors are of this part of the approach: the nose below it, and above the wheels' touchdown
BELOW_M = 20.0
MOUNT_SIGMA_RAD = math.radians(0.01)
# the vehicle has come on a poor source, and has it for so long into the approach
_START_SIGMA_M, _START_SIGMA_M_S, _START_S = 3.0, 1.0, 2.0
_ATTITUDE_PERIOD_S = 0.1
_SYSTEM = 1
_START, _RIG, _TELEMETRY = 411, 412, 413


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandingOnStream:
    """A landing on the stream.

    Attributes
    ----------
    landing : how it ended.
    station_errors_m : (n, 3) right-handed runway frame: errors of the station's estimates of the nose below 20 m, at
        the times of the pictures.
    vehicle_errors_m : (m, 3) errors of the position on which the vehicle flew, in the same part, at each step.
    samples, late : positions that the vehicle took, and that came too late for its filter.
    longest_gap_s : longest time without a position.
    """

    landing: FlownLanding
    station_errors_m: FloatArray
    vehicle_errors_m: FloatArray
    samples: int
    late: int
    longest_gap_s: float


def land_on_stream(
    setup: LandingSetup,
    seed: int,
    *,
    receiver: str = DEFAULT_RECEIVER,
    radio: RadioLinkModel | None = None,
    faults: Sequence[ClosedLoopFault] = (),
) -> LandingOnStream:
    """Fly a landing on the stream to the named receiver; the same for the same seed."""
    flight = LandingFlight(setup, seed)
    vehicle = _StreamedVehicle(flight, receiver, RadioLinkModel() if radio is None else radio, seed)
    stated = _stated_rig()
    sigma = StationErrors(mount_rad=np.array([MOUNT_SIGMA_RAD, 0.0, MOUNT_SIGMA_RAD]))
    station = ClosedLoopSimulation(
        stated,
        Config(),
        flight,
        faults=faults,
        seed=seed,
        listener=vehicle,
        true_rig=perturbed(stated, drawn_errors(np.random.default_rng([seed, _RIG]), stated.names, sigma)),
    )
    vehicle.at_end = station.stop
    result = station.run()
    if flight.end is None:
        raise RuntimeError("a flight ends before its station does")
    return LandingOnStream(
        landing=flight.end,
        station_errors_m=_station_errors(result),
        vehicle_errors_m=np.array(vehicle.errors_m).reshape(-1, 3),
        samples=vehicle.samples,
        late=vehicle.navigation.late,
        longest_gap_s=vehicle.longest_gap_s,
    )


class _StreamedVehicle:
    """The vehicle's end: what it receives, knows and flies; a `StationListener`."""

    def __init__(self, flight: LandingFlight, receiver: str, radio: RadioLinkModel, seed: int) -> None:
        self.errors_m: list[FloatArray] = []
        self.samples = 0
        self.longest_gap_s = 0.0
        self.at_end: Callable[[], None] = lambda: None
        self._flight = flight
        setup = RECEIVERS[receiver]
        self._vehicle = VehicleState(system=_SYSTEM, autopilot=setup.autopilot, parameters=dict(setup.parameters))
        forward, right, down = (-float(v) for v in flight.aircraft.nose_in_body_m)
        settings = AutopilotSettings(
            url="udpout:127.0.0.1:14550", mode=setup.mode, reference_in_body_m=(forward, right, down)
        )
        self._radio = StreamOverRadio(settings, SITE_FRAME, self._vehicle, setup.receiver(), radio, seed)
        self._down = RadioLink(radio, np.random.default_rng([seed, _TELEMETRY]))
        self._attitude_due_s = 0.0
        self._heard_s = _START_S
        off = np.random.default_rng([seed, _START]).normal(size=(2, 3))
        true = flight.true_position()
        variances = [_START_SIGMA_M**2] * 3 + [_START_SIGMA_M_S**2] * 3
        start = VehiclePosition(
            position_runway_m=true.position_runway_m + _START_SIGMA_M * off[0],
            velocity_runway_m_s=true.velocity_runway_m_s + _START_SIGMA_M_S * off[1],
            covariance=np.diag(variances),
        )
        self.navigation = InertialNavigation(0.0, start)

    def note(self, report: StepReport) -> None:
        self._radio.note(report)

    def pass_time(self, now_s: float, estimate_at: Callable[[float], Kinematics | None]) -> None:
        while self._flight.t_s < now_s - 0.5 * STEP_S and self._flight.end is None:
            self._step()
        if self._flight.end is not None:
            self.at_end()
            return
        self._tell_attitude(now_s)
        taken = len(self._radio.taken)
        self._radio.pass_time(now_s, estimate_at)
        for sample in self._radio.taken[taken:]:
            if self.navigation.take(self._position_sample(sample)):
                self.samples += 1
                self._heard_s = max(now_s, _START_S)

    def _step(self) -> None:
        flight, known = self._flight, self.navigation.now()
        gap_s = max(flight.t_s - self._heard_s, 0.0)
        self.longest_gap_s = max(self.longest_gap_s, gap_s)
        true = flight.true_position().position_runway_m
        if true[2] < BELOW_M:
            self.errors_m.append(known.position_runway_m - true)
        flight.step(known, gap_s)
        self.navigation.accelerate(flight.t_s, flight.runway_from_ned @ flight.sensed.acceleration_ned_m_s2)

    def _position_sample(self, sample: ReceivedSample) -> PositionSample:
        velocity, runway_from_ned = sample.velocity_ned_m_s, SITE_FRAME.ned_from_runway.T
        return PositionSample(
            t_s=min(sample.t_s - VEHICLE_CLOCK_S, self._flight.t_s),
            position_runway_m=sample.position_runway_m,
            position_sigma_m=np.sqrt(runway_from_ned**2 @ sample.position_sigma_ned_m() ** 2),
            velocity_runway_m_s=None if velocity is None else runway_from_ned @ velocity,
            velocity_sigma_m_s=np.full(3, sample.sigma_speed_m_s),
        )

    def _tell_attitude(self, now_s: float) -> None:
        """Send the vehicle's own attitude down, and let the station have what has arrived."""
        for arrived_s, message in self._down.arrived(now_s):
            receive(
                self._vehicle,
                message.name,
                message.fields,
                source=(_SYSTEM, 1),
                received_s=arrived_s,
                link_s=0.0,
                target_system=_SYSTEM,
            )
        if now_s < self._attitude_due_s:
            return
        self._attitude_due_s += _ATTITUDE_PERIOD_S
        body, rates = self._flight.sensed.ned_from_body, self._flight.sensed.rates_rad_s
        self._down.send(
            MavlinkMessage(
                name="ATTITUDE",
                fields={
                    "roll": math.atan2(body[2, 1], body[2, 2]),
                    "pitch": -math.asin(min(max(float(body[2, 0]), -1.0), 1.0)),
                    "yaw": math.atan2(body[1, 0], body[0, 0]),
                    "rollspeed": float(rates[0]),
                    "pitchspeed": float(rates[1]),
                    "yawspeed": float(rates[2]),
                },
            ),
            now_s,
        )


def _stated_rig() -> Rig:
    """Return the standard site with the stated uncertainty of each station's pan and tilt."""
    names = ("runway_from_base.x", "runway_from_base.z")
    covariance = MOUNT_SIGMA_RAD**2 * np.eye(2)
    plain = site_rig().stations
    return Rig(stations=tuple(replace(s, covariance_parameters=names, covariance=covariance) for s in plain))


def _station_errors(result: ClosedLoopResult) -> FloatArray:
    known = (TrackStatus.TRACKING, TrackStatus.COASTING)
    return np.array(
        [
            estimate.kinematics.position_runway_m - truth
            for estimate, truth in zip(result.estimates, result.truth_m, strict=True)
            if estimate.kinematics is not None and estimate.status in known and truth[2] < BELOW_M
        ]
    ).reshape(-1, 3)
