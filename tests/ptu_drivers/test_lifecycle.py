"""On every way out of a program the unit is halted: tried on a pty, by ending a program in each way."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from ptu_drivers import LineError, ProtocolError, Reading, RefusedError, UnitSettings, open_ptu
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.setup import connect
from ptu_drivers.health import FailureReason, HealthCounter, UnitState
from ptu_drivers.line_lock import LineLock
from ptu_drivers.messages import Axis, AxisDescription, Capability, UnitDescription
from ptu_drivers.polled_unit import PolledUnit
from ptu_drivers.simulated.flir import FlirModel, LineEffect
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer

CHILD = Path(__file__).with_name("lifecycle_child.py")
ROOT = Path(__file__).resolve().parents[2]
WAYS = [
    ("position", signal.SIGINT),
    ("position", signal.SIGTERM),
    ("position", signal.SIGHUP),
    ("rate", signal.SIGTERM),
    ("position", "exception"),
    ("rate", "exception"),
    ("position", "with"),
    ("position", "return"),
    ("rate", "silence"),
]

Running = dict[str, tuple[SimulatedServer, "subprocess.Popen[str]"]]


def serve(stack: ExitStack, link: Path | int) -> SimulatedServer:
    model = FlirModel(combined=False, device_clock=False)
    # no character times: what is tested here is the way out
    unit = SimulatedUnit(model, LineModel(baud=0, latency_s=(0.0, 0.001)))
    return stack.enter_context(SimulatedServer(VirtualLine(unit, 0, start_s=time.monotonic()), link))


def moves(server: SimulatedServer) -> bool:
    return server.line.unit.flir.axes["P"].speed(time.monotonic()) != 0.0


@pytest.fixture(scope="module")
def children(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """All programs at once: each takes its time to start."""
    folder = tmp_path_factory.mktemp("units")
    with ExitStack() as stack:
        running = {}
        for k, (motion, end) in enumerate(WAYS):
            server = serve(stack, folder / f"unit{k}")
            command = [sys.executable, str(CHILD), server.url, motion, str(end)]
            pipe = subprocess.PIPE
            child = subprocess.Popen(
                command, cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, stdin=pipe, stdout=pipe, stderr=pipe, text=True
            )
            running[f"{motion} {end}"] = (server, child)
        yield running
        for _, child in running.values():
            child.kill()
            child.communicate()


@pytest.mark.parametrize(("motion", "end"), WAYS)
def test_it_is_halted(motion: str, end: str | signal.Signals, children: Running) -> None:
    server, child = children[f"{motion} {end}"]
    assert child.stdin is not None
    assert child.stdout is not None
    assert child.stdout.readline() == "open\n", child.communicate()[1]
    child.stdin.write("go\n")
    child.stdin.flush()
    assert child.stdout.readline() == "moving\n", child.communicate()[1]
    if isinstance(end, signal.Signals):
        assert moves(server)
        child.send_signal(end)
    if end != "silence":
        child.communicate(timeout=120)
        expected = {"exception": 1, "with": 0, "return": 0, signal.SIGINT: -2, signal.SIGTERM: 143, signal.SIGHUP: 129}
        assert child.returncode in (expected[end], 130 if end == signal.SIGINT else expected[end])
    # braking takes 0.3 s, the watchdog waits for 0.5 s
    deadline = time.monotonic() + 30.0
    while moves(server) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not moves(server)
    axis = server.line.unit.flir.axes["P"]
    # it was halted on its way, and did not just arrive
    assert axis.motor(time.monotonic()) < axis.high - 1000


def test_sockets_and_urls_that_are_not_lines(tmp_path: Path) -> None:
    with ExitStack() as stack:
        server = serve(stack, 0)
        with open_ptu(server.url) as unit:
            assert isinstance(unit.read(), Reading)
            assert unit.describe().details["baud"] == "network"
            server.line.gone = True
            assert not isinstance(unit.read(), Reading)
            server.line.gone = False
            deadline = time.monotonic() + 30.0
            while not isinstance(unit.read(), Reading):
                assert time.monotonic() < deadline
            assert unit.health().reconnects >= 1
    for url in (str(tmp_path / "nothing"), "/dev/null", "socket://127.0.0.1:1", "nonsense://x"):
        with pytest.raises(LineError, match=r"wanted a line that is there"):
            open_ptu(url)
    with pytest.raises(ProtocolError, match="got telepathy; wanted one of flir"):
        open_ptu("x", "telepathy")
    with pytest.raises(ProtocolError, match="got colour; wanted what flir has"):
        open_ptu("x", colour="red")


def test_a_pty_that_is_removed_and_returns(tmp_path: Path) -> None:
    with ExitStack() as stack:
        server = serve(stack, tmp_path / "unit")
        with open_ptu(server.url) as unit:
            assert isinstance(unit.read(), Reading)
            server.line.gone = True
            deadline = time.monotonic() + 30.0
            while not (lost := unit.health().state == "line lost") and time.monotonic() < deadline:
                unit.read()
            assert lost
            server.line.gone = False
            deadline = time.monotonic() + 30.0
            while not isinstance(unit.read(), Reading):
                assert time.monotonic() < deadline


def test_an_axis_whose_neighbour_refused_does_not_continue(tmp_path: Path) -> None:
    with ExitStack() as stack:
        server = serve(stack, tmp_path / "unit")
        flir = server.line.unit.flir
        carry_out = flir.execute

        def refusing(command: str, t_s: float) -> LineEffect:
            refused = command.upper().startswith("TS") and command.upper() not in ("TS", "TS0")
            return carry_out("NONSENSE" if refused else command, t_s)

        flir.execute = refusing  # type: ignore[method-assign]
        with open_ptu(server.url) as unit:
            with pytest.raises(RefusedError):
                unit.move_at(pan_rad_s=0.3, tilt_rad_s=0.3)
            deadline = time.monotonic() + 30.0
            while moves(server) and time.monotonic() < deadline:
                time.sleep(0.05)
            assert not moves(server)
            # and it executes commands again
            unit.move_at(pan_rad_s=0.3, tilt_rad_s=0.0)


class DeafLine:
    """A line in real time that can be opened at any time."""

    url = "deaf"

    def __init__(self) -> None:
        self.lock = LineLock()

    def now(self) -> float:
        return time.monotonic()

    def wait(self, duration_s: float) -> None:
        time.sleep(max(duration_s, 0.0))

    def reopen(self) -> None:
        return None

    def close(self) -> None:
        return None


class DeafUnit(PolledUnit):
    """A unit that turns, and receives nothing while it is deaf."""

    deaf = False
    turning = False

    def _heard(self) -> None:
        if self.deaf:
            raise ExchangeFailed(FailureReason.TIMEOUT, "nothing")

    def _query(self) -> Reading:
        self._heard()
        raise ExchangeFailed(FailureReason.GARBAGE, "no angles in this test")

    def _resynchronise(self) -> None:
        self._heard()

    def _set_up(self) -> None:
        self._heard()

    def _send_position(self, targets: dict[Axis, float], rate_rad_s: float | None) -> None:
        self._heard()

    def _send_rates(self, rates: dict[Axis, float]) -> None:
        self._heard()
        self.turning = True

    def _send_halt(self) -> None:
        self._heard()
        self.turning = False


AXIS = AxisDescription(quantum_rad=1e-4, low_rad=-1.0, high_rad=1.0, max_rate_rad_s=1.0)
DEAF = UnitDescription(
    protocol="test",
    url="deaf",
    model="",
    firmware="",
    serial="",
    pan=AXIS,
    tilt=AXIS,
    capabilities=frozenset({Capability.VELOCITY}),
    reply_timeout_s=0.05,
)


def test_an_unacknowledged_halt_is_repeated() -> None:
    unit = DeafUnit(DeafLine(), UnitSettings(watchdog_s=0.2), DEAF, HealthCounter(), watch=True)
    unit.move_at(pan_rad_s=0.1, tilt_rad_s=0.0)
    unit.deaf = True
    # no reads, no commands: the watchdog's halt is not received, and it must continue
    time.sleep(1.0)
    assert unit.turning
    unit.deaf = False
    deadline = time.monotonic() + 30.0
    while unit.turning and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not unit.turning
    unit.close()


@pytest.mark.parametrize("deaf", [True, False])
def test_a_closed_unit_reports_whether_its_halt_was_acknowledged(deaf: bool) -> None:
    """Expected: `close` never raises; what came of it is in the health."""
    unit = DeafUnit(DeafLine(), UnitSettings(), DEAF, HealthCounter(), watch=False)
    unit.move_at(pan_rad_s=0.1, tilt_rad_s=0.0)
    assert not unit.health().halt_owed
    unit.deaf = deaf
    unit.close()
    assert unit.health().state is UnitState.CLOSED
    assert unit.health().halt_owed is deaf
    assert unit.turning is deaf


@pytest.mark.parametrize("dead", [True, False])
def test_a_closed_flir_reports_whether_its_halt_was_acknowledged(dead: bool) -> None:
    virtual = VirtualLine(SimulatedUnit(FlirModel(), LineModel()))
    unit = connect(virtual, UnitSettings())
    unit.move_at(pan_rad_s=0.05, tilt_rad_s=0.0)
    assert not unit.health().halt_owed
    virtual.dead = dead
    unit.close()
    assert unit.health().halt_owed is dead
