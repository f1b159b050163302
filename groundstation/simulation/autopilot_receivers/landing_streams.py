"""One landing watched by a station and streamed to all receivers at once, with the errors of the samples."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.settings import AutopilotMode, AutopilotSettings
from groundstation.autopilot.vehicle_state import ARDUPILOT, PX4, VehicleState
from groundstation.messages import Kinematics, StepReport, TrackStatus
from groundstation.session.folder import GeoOrigin
from groundstation.simulation.autopilot_receivers.ardupilot_external_navigation import (
    ExternalNavigationParameters,
    ExternalNavigationReceiver,
)
from groundstation.simulation.autopilot_receivers.ardupilot_gps import ArdupilotGpsParameters, ArdupilotGpsReceiver
from groundstation.simulation.autopilot_receivers.px4_receivers import (
    Px4GlobalParameters,
    Px4GlobalReceiver,
    Px4VisionParameters,
    Px4VisionReceiver,
)
from groundstation.simulation.autopilot_receivers.radio_link import RadioLinkModel
from groundstation.simulation.autopilot_receivers.receipt import PositionReceiver, ReceiptVerdict
from groundstation.simulation.closed_loop import ClosedLoopConfig, ClosedLoopSimulation
from groundstation.simulation.flights import site_rig
from groundstation.simulation.stream_over_radio import TRUE_OFFSET_S, VEHICLE_CLOCK_S, StreamOverRadio
from groundstation.simulation.trajectory import Trajectory
from groundstation.tracking.config import Config

# EK3_BCN_DELAY as `groundstation autopilot check` recommends it
LONG_MEMORY_MS = 250.0
# EKF2_EV_DELAY, EKF2_AGP0_DELAY likewise
PX4_DELAY_MS = 50.0
SITE_FRAME = LocalFrame(GeoOrigin(lat_deg=47.3, lon_deg=8.5, height_m=460.0, y_axis_azimuth_deg=180.0), 47.5)
# the track has been found, and TIMESYNC has been answered three times
_SETTLED_S = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverSetup:
    """A receiver, the stream's mode for it, the parameters that the vehicle answers with, and its autopilot."""

    mode: AutopilotMode
    autopilot: int
    parameters: Mapping[str, float]
    receiver: Callable[[], PositionReceiver]


def _gps(delay_ms: float, beacon_delay_ms: float) -> ReceiverSetup:
    parameters = ArdupilotGpsParameters(delay_ms=delay_ms, beacon_delay_ms=beacon_delay_ms)
    return ReceiverSetup(
        mode=AutopilotMode.GPS_INPUT,
        autopilot=ARDUPILOT,
        parameters={"GPS1_DELAY_MS": delay_ms, "EK3_BCN_DELAY": beacon_delay_ms},
        receiver=lambda: ArdupilotGpsReceiver(SITE_FRAME, parameters),
    )


def _external(mode: AutopilotMode) -> ReceiverSetup:
    parameters = ExternalNavigationParameters(beacon_delay_ms=LONG_MEMORY_MS)
    return ReceiverSetup(
        mode=mode,
        autopilot=ARDUPILOT,
        parameters={"VISO_DELAY_MS": parameters.delay_ms, "EK3_BCN_DELAY": parameters.beacon_delay_ms},
        receiver=lambda: ExternalNavigationReceiver(SITE_FRAME, parameters),
    )


def _vision(mode: AutopilotMode, offset_s: float | None) -> ReceiverSetup:
    return ReceiverSetup(
        mode=mode,
        autopilot=PX4,
        parameters={"EKF2_EV_DELAY": PX4_DELAY_MS},
        receiver=lambda: Px4VisionReceiver(SITE_FRAME, Px4VisionParameters(delay_ms=PX4_DELAY_MS), offset_s),
    )


def _global(offset_s: float | None) -> ReceiverSetup:
    return ReceiverSetup(
        mode=AutopilotMode.GLOBAL_POSITION,
        autopilot=PX4,
        parameters={"EKF2_AGP0_DELAY": PX4_DELAY_MS},
        receiver=lambda: Px4GlobalReceiver(SITE_FRAME, Px4GlobalParameters(delay_ms=PX4_DELAY_MS), offset_s),
    )


RECEIVERS: Mapping[str, ReceiverSetup] = {
    "ArduPilot GPS_INPUT, as delivered (GPS1_DELAY_MS 0: 200 ms)": _gps(0.0, 50.0),
    "ArduPilot GPS_INPUT, GPS1_DELAY_MS 50": _gps(50.0, LONG_MEMORY_MS),
    "ArduPilot ODOMETRY": _external(AutopilotMode.ODOMETRY),
    "ArduPilot VISION_POSITION_ESTIMATE": _external(AutopilotMode.VISION),
    "PX4 VISION_POSITION_ESTIMATE, clocks synchronised": _vision(AutopilotMode.VISION, TRUE_OFFSET_S),
    "PX4 ODOMETRY, stamped on arrival": _vision(AutopilotMode.ODOMETRY, None),
    "PX4 GLOBAL_POSITION_SENSOR, clocks synchronised": _global(TRUE_OFFSET_S),
    "PX4 GLOBAL_POSITION_SENSOR, stamped on arrival": _global(None),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreamedLanding:
    """Tally and sums of squared errors (3,) across, along and up, m², of samples and of the pipeline's estimates.

    ``misdated_s`` are the sums over the samples, and of the squares, of how much later than the state in it a sample is
    taken to be, s and s²; ``longest_gap_s`` is the longest time between two samples. ``normalised`` are the sums over
    the samples of squared errors over the variances that the receiver takes, (2,): horizontal, the mean of its two
    axes, and vertical.
    """

    verdicts: Counter[ReceiptVerdict]
    lost: int
    squares_m2: FloatArray
    samples: int
    misdated_s: tuple[float, float]
    longest_gap_s: float
    normalised: FloatArray
    zero_delay_m2: FloatArray
    estimates: int


class _Listeners:
    """Several streams of one station."""

    def __init__(self, streams: Sequence[StreamOverRadio]) -> None:
        self._streams = streams

    def note(self, report: StepReport) -> None:
        for stream in self._streams:
            stream.note(report)

    def pass_time(self, now_s: float, estimate_at: Callable[[float], Kinematics | None]) -> None:
        for stream in self._streams:
            stream.pass_time(now_s, estimate_at)


def streamed_landing(
    flight: Trajectory,
    until_s: float,
    seed: int,
    *,
    names: Sequence[str] = tuple(RECEIVERS),
    radio: RadioLinkModel | None = None,
) -> dict[str, StreamedLanding]:
    """Stream a landing to the named receivers; errors are counted from 4 s after the start to ``until_s``."""
    model = RadioLinkModel() if radio is None else radio
    streams = {}
    for k, name in enumerate(names):
        setup = RECEIVERS[name]
        vehicle = VehicleState(system=1, autopilot=setup.autopilot, parameters=dict(setup.parameters))
        settings = AutopilotSettings(url="udpout:127.0.0.1:14550", mode=setup.mode)
        streams[name] = StreamOverRadio(settings, SITE_FRAME, vehicle, setup.receiver(), model, 1000 * seed + k)
    station = ClosedLoopSimulation(
        site_rig(),
        Config(),
        flight,
        hardware=ClosedLoopConfig(),
        seed=seed,
        listener=_Listeners(list(streams.values())),
    )
    result = station.run()
    from_s = flight.span_s[0] + _SETTLED_S
    known = [
        (e.kinematics.position_runway_m, truth)
        for e, truth in zip(result.estimates, result.truth_m, strict=True)
        if e.kinematics is not None and e.status is TrackStatus.TRACKING and from_s <= e.t_s <= until_s
    ]
    zero = np.array([(place - truth) ** 2 for place, truth in known]).reshape(-1, 3)
    return {
        name: _tally(stream, flight, from_s, until_s, np.asarray(zero.sum(axis=0)), len(zero))
        for name, stream in streams.items()
    }


def _tally(
    stream: StreamOverRadio,
    flight: Trajectory,
    from_s: float,
    until_s: float,
    zero_delay_m2: FloatArray,
    estimates: int,
) -> StreamedLanding:
    times = np.array([s.t_s - VEHICLE_CLOCK_S for s in stream.taken])
    counted = (times >= from_s) & (times <= until_s)
    places = np.array([s.position_runway_m for s in stream.taken]).reshape(-1, 3)[counted]
    off = places - flight.position(times[counted])
    sigmas = np.array([s.position_sigma_ned_m() for s in stream.taken]).reshape(-1, 3)[counted]
    misdated_s = np.array(stream.misdated_s)[counted]
    squares = (off @ SITE_FRAME.ned_from_runway.T / sigmas) ** 2
    return StreamedLanding(
        verdicts=stream.verdicts,
        lost=stream.lost,
        squares_m2=np.asarray((off**2).sum(axis=0)),
        samples=len(off),
        misdated_s=(float(misdated_s.sum()), float(misdated_s @ misdated_s)),
        longest_gap_s=float(np.max(np.diff(np.sort(times[counted])), initial=0.0)),
        normalised=np.array([0.5 * squares[:, :2].sum(), squares[:, 2].sum()]),
        zero_delay_m2=zero_delay_m2,
        estimates=estimates,
    )
