"""On every way out of a program the unit is halted: tried on a pty, by ending a program in each way."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from ptu_drivers import LineError, ProtocolError, Reading, open_ptu
from ptu_drivers.simulated_flir import FlirModel
from ptu_drivers.simulated_line import VirtualLine
from ptu_drivers.simulated_server import SimulatedServer
from ptu_drivers.simulated_unit import LineModel, SimulatedUnit

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


def test_sockets_and_what_is_no_line(tmp_path: Path) -> None:
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


def test_a_pty_that_is_pulled_out_and_comes_back(tmp_path: Path) -> None:
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
