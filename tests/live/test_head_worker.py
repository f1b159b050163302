"""One PTU's thread on a scripted unit: its queries and commands, and that the unit is halted at any end."""

import math
import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from groundstation.live.head_worker import HeadWorker
from groundstation.live.input_queue import DeviceLogLine, InputQueue, Item
from groundstation.messages import PointingCommand, PtuSample, Purpose
from ptu_drivers.errors import LimitError, LineError
from ptu_drivers.health import FailureReason, Health, HealthCounter, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import (
    AngleSample,
    AngleSource,
    Axis,
    AxisDescription,
    Capability,
    NoReading,
    Reading,
    UnitDescription,
)

AXIS = AxisDescription(quantum_rad=1e-4, low_rad=-1.0, high_rad=1.0, max_rate_rad_s=1.0)
COMMAND = PointingCommand(
    t_s=0.0, station="left", pan_rad=0.3, tilt_rad=0.1, pan_rate_rad_s=0.2, tilt_rate_rad_s=-0.1, purpose=Purpose.TRACK
)


class ScriptedUnit(PanTiltUnit):
    """Executes commands, records each call, and fails where a test requests it."""

    def __init__(self, *, by_rate: bool = True, failing: dict[str, BaseException] | None = None) -> None:
        self.calls: list[str] = []
        self.turning = False
        self.answer: Callable[[float], Reading | NoReading] = whole
        self._failing = failing or {}
        self._by_rate = by_rate
        self._count = 0

    def describe(self) -> UnitDescription:
        kinds = {Capability.VELOCITY} if self._by_rate else {Capability.POSITION}
        names = {"protocol": "scripted", "url": "", "model": "", "firmware": "", "serial": ""}
        return UnitDescription(pan=AXIS, tilt=AXIS, capabilities=frozenset(kinds), reply_timeout_s=0.1, **names)

    def read(self) -> Reading | NoReading:
        self._note("read")
        self._count += 1
        return self.answer(0.01 * self._count)

    def move_to(
        self, *, pan_rad: float | None = None, tilt_rad: float | None = None, rate_rad_s: float | None = None
    ) -> None:
        self._note(f"move_to {pan_rad} {tilt_rad}")
        self.turning = True

    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        self._note(f"move_at {pan_rad_s} {tilt_rad_s}")
        self.turning = pan_rad_s != 0.0 or tilt_rad_s != 0.0

    def halt(self) -> None:
        self._note("halt")
        self.turning = False

    def home(self) -> None:
        self._note("home")

    def health(self) -> Health:
        return HealthCounter().snapshot()

    def close(self) -> None:
        self._note("close")
        self.turning = False

    def _note(self, call: str) -> None:
        self.calls.append(call)
        fault = self._failing.get(call.split()[0])
        if fault is not None:
            raise fault


def whole(t_s: float) -> Reading:
    def sample(axis: Axis) -> AngleSample:
        return AngleSample(
            axis=axis, t_s=t_s, sigma_t_s=1e-3, angle_rad=0.1, sigma_rad=1e-4, source=AngleSource.ROUND_TRIP
        )

    return Reading(pan=sample(Axis.PAN), tilt=sample(Axis.TILT), sent_s=t_s, answered_s=t_s)


def silent(t_s: float) -> NoReading:
    return NoReading(reason=FailureReason.TIMEOUT, state=UnitState.LINE_LOST, t_s=t_s)


class RefusingOutlet:
    """An input queue in another process that is gone: handing anything over fails."""

    def __init__(self) -> None:
        self.asked = threading.Event()

    def put(self, item: Item) -> None:
        self.asked.set()
        raise OSError("the other process is gone")


def worker(
    unit: ScriptedUnit, input_queue: InputQueue | RefusingOutlet, clock: Callable[[], float] = lambda: 0.0
) -> HeadWorker:
    return HeadWorker("left", unit, input_queue, session_from_unit_s=5.0, clock=clock)


def ended(head: HeadWorker) -> None:
    head._thread.join(20.0)
    assert not head._thread.is_alive()


def all_of(input_queue: InputQueue) -> list[Item]:
    found = []
    while (item := input_queue.get(0.0)) is not None:
        found.append(item)
    return found


@pytest.mark.parametrize("place", ["read", "move_at", "move_to", "halt"])
@pytest.mark.parametrize("fault", [RuntimeError("a bug"), ValueError("nonsense"), MemoryError()])
def test_a_thread_that_fails_leaves_its_head_halted(place: str, fault: Exception) -> None:
    """Expected: closed, which halts, by the thread itself before it is requested to stop; one line, level error."""
    unit, input_queue = ScriptedUnit(by_rate=place != "move_to", failing={place: fault}), InputQueue()
    unit.turning = True
    head = worker(unit, input_queue)
    head.set_command(replace(COMMAND, purpose=Purpose.HOLD) if place == "halt" else COMMAND)
    assert not head.ended
    head.start()
    ended(head)
    assert head.ended
    assert not unit.turning
    assert unit.calls[-1] == "close"
    (reported,) = [item for item in all_of(input_queue) if isinstance(item, DeviceLogLine)]
    assert (reported.level, reported.t_s) == ("error", 5.0)
    assert reported.text == f"left: PTU: {type(fault).__name__}: {fault}; it is halted"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_head_is_halted_even_without_a_listener() -> None:
    """Expected: what takes readings and lines fails, so that the line about it fails as well; the head stops."""
    unit, outlet = ScriptedUnit(), RefusingOutlet()
    head = worker(unit, outlet)
    head.set_command(COMMAND)
    head.start()
    ended(head)
    assert outlet.asked.is_set()
    assert unit.calls[:2] == ["move_at 0.2 -0.1", "read"]
    assert not unit.turning
    assert unit.calls[-1] == "close"


def test_a_head_that_is_stopped_is_halted_whether_it_ran_or_not() -> None:
    started, never = ScriptedUnit(), ScriptedUnit()
    for unit in (started, never):
        unit.turning = True
        head = worker(unit, InputQueue())
        if unit is started:
            head.start()
        head.stop()
        assert not unit.turning
        assert unit.calls[-1] == "close"
        assert not head._thread.is_alive()


def obeyed(unit: ScriptedUnit, *commands: PointingCommand) -> HeadWorker:
    """Have commands obeyed one after the other, without the thread."""
    head = worker(unit, InputQueue())
    for command in commands:
        head.set_command(command)
        head._execute()
    return head


def test_commands_are_executed_in_the_terms_of_the_unit() -> None:
    """Expected: rates where it turns by rate, places where it does not, a halt for a hold; each once."""
    by_rate, by_place = ScriptedUnit(), ScriptedUnit(by_rate=False)
    head = obeyed(by_rate, COMMAND)
    head._execute()
    assert by_rate.calls == ["move_at 0.2 -0.1"]
    obeyed(by_place, COMMAND)._execute()
    assert by_place.calls == ["move_to 0.3 0.1"]
    hold = replace(COMMAND, t_s=0.01, purpose=Purpose.HOLD)
    for unit in (ScriptedUnit(), ScriptedUnit(by_rate=False)):
        obeyed(unit, COMMAND, hold)
        assert unit.calls[1:] == ["halt"]


def test_the_newest_command_counts() -> None:
    unit = ScriptedUnit()
    head = worker(unit, InputQueue())
    head.set_command(COMMAND)
    head.set_command(replace(COMMAND, pan_rate_rad_s=0.5))
    head._execute()
    assert unit.calls == ["move_at 0.5 -0.1"]


@pytest.mark.parametrize(
    ("change", "sent"),
    [
        ({}, False),
        ({"pan_rate_rad_s": 0.2 + math.radians(0.009)}, False),
        ({"pan_rate_rad_s": 0.2 + math.radians(0.011)}, True),
        ({"tilt_rate_rad_s": -0.1 - math.radians(0.011)}, True),
        ({"purpose": Purpose.SEARCH}, True),
        ({"purpose": Purpose.HOLD}, True),
        ({"t_s": 0.14}, False),
        # the unit's watchdog needs the same rate again
        ({"t_s": 0.16}, True),
    ],
)
def test_the_same_rate_is_repeated_only_for_the_watchdog(change: dict[str, object], sent: bool) -> None:
    unit = ScriptedUnit()
    obeyed(unit, COMMAND, replace(COMMAND, **change))  # type: ignore[arg-type]
    assert len(unit.calls) == 1 + sent


def test_a_position_is_commanded_each_time() -> None:
    unit = ScriptedUnit(by_rate=False)
    obeyed(unit, COMMAND, COMMAND)
    assert unit.calls == ["move_to 0.3 0.1"] * 2


@pytest.mark.parametrize(
    ("fault", "lines"),
    [
        (LimitError("pan", "maximum speed", got=3.0, bound=1.0, origin="unit"), 2),
        (LineError("line", got="gone", wanted="a line"), 1),
    ],
)
def test_a_refused_command_is_counted_and_reported(fault: Exception, lines: int) -> None:
    """Expected: each beyond a limit; of a line in trouble the first, because readings report the rest."""
    unit, input_queue = ScriptedUnit(failing={"move_at": fault}), InputQueue()
    head = worker(unit, input_queue)
    for k in range(2):
        head.set_command(replace(COMMAND, t_s=float(k)))
        head._execute()
    assert head.refused == 2
    reported = [item for item in all_of(input_queue) if isinstance(item, DeviceLogLine)]
    assert [s.level for s in reported] == ["warning"] * lines
    assert reported[0].text == f"left: PTU: {fault}"


def test_readings_are_handed_over_in_session_time() -> None:
    unit, input_queue = ScriptedUnit(), InputQueue()
    head = worker(unit, input_queue)
    assert head._poll()
    assert all_of(input_queue) == [PtuSample(t_s=5.01, station="left", pan_rad=0.1, tilt_rad=0.1)]
    assert (head.readings, head.newest_s) == (1, 5.01)


def test_a_unit_without_angles_is_reported_once_and_so_is_its_return() -> None:
    """Expected: not before a second of silence; the same reason not again."""
    now = [0.0]
    unit, input_queue = ScriptedUnit(), InputQueue()
    head = worker(unit, input_queue, lambda: now[0])
    unit.answer = silent
    for t in (0.0, 0.9):
        now[0] = t
        assert not head._poll()
    assert all_of(input_queue) == []
    for t in (1.1, 1.2):
        now[0] = t
        assert not head._poll()
    (reported,) = all_of(input_queue)
    assert isinstance(reported, DeviceLogLine)
    assert (reported.level, reported.t_s) == ("warning", 6.1)
    unit.answer = whole
    assert head._poll()
    back = [item for item in all_of(input_queue) if isinstance(item, DeviceLogLine)]
    assert [(s.level, s.text) for s in back] == [("info", "left: PTU gives angles again")]
