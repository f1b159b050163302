"""The stream to an autopilot over a radio to a model of its receiver, in virtual time."""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.received import answer_time_request, receive
from groundstation.autopilot.settings import AutopilotSettings
from groundstation.autopilot.stream import AutopilotStream, StreamClock, StreamStatistics
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.messages import Kinematics, StepReport
from groundstation.simulation.autopilot_receivers.radio_link import RadioLink, RadioLinkModel
from groundstation.simulation.autopilot_receivers.receipt import PositionReceiver, ReceiptVerdict, ReceivedSample

_POSITIONS = frozenset({"GPS_INPUT", "GLOBAL_POSITION_SENSOR", "VISION_POSITION_ESTIMATE", "ODOMETRY"})
# what the vehicle's clock shows when the session's shows zero
VEHICLE_CLOCK_S = 5000.0
_LINK_CLOCK_S, _UNIX_S = 1000.0, 1.8e9
# to be added to the link's stamps for the vehicle's time
TRUE_OFFSET_S = VEHICLE_CLOCK_S - _LINK_CLOCK_S


class StreamOverRadio:
    """One stream, its radio and its receiver.

    ``taken`` are the samples, ``misdated_s`` by how much later than the state in it the receiver takes each to be;
    ``lost`` positions did not arrive.

    Parameters
    ----------
    settings : of the stream.
    frame : the runway frame on Earth.
    vehicle : what the vehicle has told before: autopilot, parameters, origin.
    receiver : of the vehicle; its clock is ``VEHICLE_CLOCK_S`` ahead.
    radio : up and down.
    """

    def __init__(
        self,
        settings: AutopilotSettings,
        frame: LocalFrame,
        vehicle: VehicleState,
        receiver: PositionReceiver,
        radio: RadioLinkModel,
        seed: int,
    ) -> None:
        self.taken: list[ReceivedSample] = []
        self.misdated_s: list[float] = []
        self.verdicts: Counter[ReceiptVerdict] = Counter()
        self.lost = 0
        self._estimate_at: Callable[[float], Kinematics | None] = lambda _: None
        clock = StreamClock(link_s=_LINK_CLOCK_S, unix_s=_UNIX_S)
        self._stream = AutopilotStream(settings, frame, clock, self._estimate)
        self._vehicle, self._receiver = vehicle, receiver
        random = np.random.default_rng([seed, 311])
        # of the positions on their way, which keep their order
        self._states_s: deque[float] = deque()
        self._up, self._down = RadioLink(radio, random), RadioLink(radio, random)

    @property
    def statistics(self) -> StreamStatistics:
        """Of the stream."""
        return self._stream.statistics

    def _estimate(self, t_s: float) -> Kinematics | None:
        return self._estimate_at(t_s)

    def note(self, report: StepReport) -> None:
        """Note what the pipeline answered."""
        self._stream.note(report)

    def pass_time(self, now_s: float, estimate_at: Callable[[float], Kinematics | None]) -> None:
        """Send what is due, and let what has arrived be received."""
        self._estimate_at = estimate_at
        for message in self._stream.messages(now_s, self._vehicle):
            if message.name in _POSITIONS:
                if self._up.send(message, now_s):
                    self._states_s.append(self._stream.state_time_s(now_s, self._vehicle))
                else:
                    self.lost += 1
            elif message.name == "TIMESYNC":
                self._up.send(message, now_s)
        self.deliver(now_s)
        for received_s, answer in self._down.arrived(now_s):
            link_s = _LINK_CLOCK_S
            receive(
                self._vehicle, answer.name, answer.fields, (self._vehicle.system or 0, 1), received_s, link_s=link_s
            )

    def deliver(self, until_s: float) -> list[ReceivedSample]:
        """Let the receiver take what arrives until a session time; return the new samples, at the vehicle's times."""
        found = []
        for arrived_s, message in self._up.arrived(until_s):
            if message.name == "TIMESYNC":
                answer = answer_time_request(message.fields, round(1e9 * (arrived_s + VEHICLE_CLOCK_S)))
                if answer is not None:
                    self._down.send(answer, arrived_s)
                continue
            state_s = self._states_s.popleft()
            receipt = self._receiver.receive(message, arrived_s + VEHICLE_CLOCK_S)
            self.verdicts[receipt.verdict] += 1
            if receipt.sample is not None:
                found.append(receipt.sample)
                self.misdated_s.append(receipt.sample.t_s - VEHICLE_CLOCK_S - state_s)
        self.taken += found
        return found
