"""A straight approach as the pipeline would tell it, for tests of the stream."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.settings import AutopilotMode, AutopilotSettings
from groundstation.autopilot.stream import AutopilotStream, StreamClock
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.messages import Kinematics, StepReport, TrackEstimate, TrackStatus, TriangulationStatus
from groundstation.session.folder import GeoOrigin

ORIGIN = GeoOrigin(lat_deg=47.3, lon_deg=8.5, height_m=460.0, y_axis_azimuth_deg=30.0)
SEPARATION_M = 47.5
CLOCK = StreamClock(link_s=1000.0, unix_s=1.8e9)
COVARIANCE = np.diag([0.03, 0.4, 0.04, 0.05, 0.2, 0.05]) ** 2


class StraightFlight:
    """Constant velocity, runway frame; `estimate_at` is exact. ``offset_m`` (3,) moves it, as a restart would."""

    def __init__(self, velocity: tuple[float, float, float] = (0.0, -25.0, -1.5)) -> None:
        self.velocity: FloatArray = np.array(velocity)
        self.offset_m: FloatArray = np.zeros(3)
        self.covariance: FloatArray = COVARIANCE

    def position(self, t_s: float) -> FloatArray:
        """Return the nose (3,), runway frame."""
        return np.array([0.5, 400.0, 27.0]) + self.velocity * t_s + self.offset_m

    def estimate_at(self, t_s: float) -> Kinematics | None:
        """Return the state at a session time."""
        return Kinematics(
            position_runway_m=self.position(t_s), velocity_runway_m_s=self.velocity, covariance=self.covariance
        )


def answer(
    flight: StraightFlight,
    t_s: float,
    status: TrackStatus = TrackStatus.TRACKING,
    seen_by: tuple[str, ...] = ("left", "right"),
) -> StepReport:
    """Return the pipeline's answer to a pair."""
    with_estimate = status in (TrackStatus.TRACKING, TrackStatus.COASTING)
    estimate = TrackEstimate(
        t_s=t_s,
        epoch=0,
        status=status,
        kinematics=flight.estimate_at(t_s) if with_estimate else None,
        triangulation_status=TriangulationStatus.ONE_VIEW,
        triangulation=None,
        seen_by=frozenset(seen_by),
    )
    return StepReport(estimates=(estimate,))


def stream_of(
    flight: StraightFlight,
    mode: AutopilotMode,
    *,
    arm_m: tuple[float, float, float] | None = None,
    **more: float | None,
) -> AutopilotStream:
    """Return a stream of a flight, over a link that delays all messages alike unless ``more`` states how not."""
    more = {"link_delay_sigma_s": 0.0} | more
    settings = AutopilotSettings(url="udpout:127.0.0.1:14550", mode=mode, reference_in_body_m=arm_m, **more)  # type: ignore[arg-type]
    return AutopilotStream(settings, LocalFrame(ORIGIN, SEPARATION_M), CLOCK, flight.estimate_at)


def sent_states(messages: list[MavlinkMessage]) -> list[MavlinkMessage]:
    """Return the messages that carry a position."""
    names = {"GPS_INPUT", "GLOBAL_POSITION_SENSOR", "VISION_POSITION_ESTIMATE", "ODOMETRY"}
    return [m for m in messages if m.name in names]


def one_state(stream: AutopilotStream, flight: StraightFlight, t_s: float, vehicle: VehicleState) -> MavlinkMessage:
    """Return what is sent at a session time, at which a pair has just been answered."""
    stream.note(answer(flight, t_s))
    (message,) = sent_states(stream.messages(t_s, vehicle))
    return message


def values(message: MavlinkMessage, *names: str) -> FloatArray:
    """Return fields as numbers."""
    found = [message.fields[name] for name in names]
    assert all(isinstance(value, int | float) for value in found), found
    return np.array(found, dtype=np.float64)


def listed(message: MavlinkMessage, name: str) -> FloatArray:
    """Return a field that is a list of numbers."""
    value = message.fields[name]
    assert isinstance(value, list)
    return np.array(value, dtype=np.float64)


def symmetric(triangle: FloatArray) -> FloatArray:
    """Return the (6, 6) matrix of the 21 numbers of its upper right triangle."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = triangle
    return matrix + np.triu(matrix, 1).T
