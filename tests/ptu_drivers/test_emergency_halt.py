"""Halting a unit over a second connection, while the one that drives it still holds the line."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from ptu_drivers import PROTOCOLS, open_ptu
from ptu_drivers.emergency_halt import HALTS, HaltLine, halt_once
from ptu_drivers.errors import NoAnswerError, ProtocolError, PtuError
from ptu_drivers.messages import Axis
from ptu_drivers.simulated.alpaca import SimulatedMount
from ptu_drivers.simulated.axis import SimulatedAxis
from ptu_drivers.simulated.dynamixel import SimulatedDynamixel
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.peer import SimulatedPeer
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from ptu_drivers.simulated.server import SimulatedServer
from ptu_drivers.transport import SerialTransport

SPEEDS = {"speeds_deg_s": {8: 5.0, 63: 40.0}}


def flir(**model: object) -> tuple[SimulatedPeer, HaltLine, SimulatedAxis]:
    unit = SimulatedUnit(FlirModel(arcsec=22.5, min_rate=0), LineModel(baud=115200, **model))  # type: ignore[arg-type]
    now_s = time.monotonic()
    unit.flir.execute("CV", now_s)
    unit.flir.execute("PS500", now_s)
    return unit, HaltLine(url="", baud=115200), unit.flir.axes["P"]


def pelco() -> tuple[SimulatedPeer, HaltLine, SimulatedAxis]:
    unit = SimulatedPelco(PelcoModel(baud=9600))
    unit.axes[Axis.PAN].move_at(time.monotonic(), 500.0)
    return unit, HaltLine(url="", protocol="pelco-d", options=SPEEDS), unit.axes[Axis.PAN]


def dynamixel() -> tuple[SimulatedPeer, HaltLine, SimulatedAxis]:
    unit = SimulatedDynamixel()
    return unit, HaltLine(url="", protocol="dynamixel"), unit.servo(Axis.PAN).axis


@contextmanager
def served(unit: SimulatedPeer, link: Path) -> Iterator[SimulatedServer]:
    with SimulatedServer(VirtualLine(unit, unit.baud, start_s=time.monotonic()), link) as server:
        yield server


def speed(server: SimulatedServer, axis: SimulatedAxis) -> float:
    with server.lock:
        return axis.speed(time.monotonic())


def stands(server: SimulatedServer, axis: SimulatedAxis) -> bool:
    end_s = time.monotonic() + 10.0
    while time.monotonic() < end_s:
        if speed(server, axis) == 0.0:
            return True
        time.sleep(0.01)
    return False


def at(line: HaltLine, link: Path) -> HaltLine:
    return HaltLine(url=str(link), protocol=line.protocol, options=line.options, baud=line.baud)


def test_each_protocol_can_be_halted() -> None:
    assert set(HALTS) == set(PROTOCOLS)


@pytest.mark.parametrize("make", [flir, pelco])
def test_a_unit_whose_line_another_program_holds_is_halted(
    tmp_path: Path, make: Callable[[], tuple[SimulatedPeer, HaltLine, SimulatedAxis]]
) -> None:
    """Expected: though the line is open exclusively, as a stopped process leaves it, with half a command on it."""
    unit, line, axis = make()
    link = tmp_path / "ptu"
    with served(unit, link) as server:
        holder = SerialTransport(str(link), unit.baud)
        try:
            with pytest.raises(PtuError):
                SerialTransport(str(link), unit.baud)
            holder.write(b"PS12")
            assert speed(server, axis) > 0.0
            halted(at(line, link))
            assert stands(server, axis)
        finally:
            holder.close()


def halted(line: HaltLine) -> None:
    """Halt it repeatedly as the guard does: on a busy machine a reply may be late."""
    for attempt in range(20):
        try:
            return halt_once(line, attempt)
        except NoAnswerError as fault:
            last = fault
    raise last


def test_a_flir_in_velocity_mode_keeps_no_rate(tmp_path: Path) -> None:
    unit, line, axis = flir()
    with served(unit, tmp_path / "ptu") as server:
        halted(at(line, tmp_path / "ptu"))
        assert stands(server, axis)
        assert isinstance(unit, SimulatedUnit)
        assert unit.flir.wanted_rate == {"P": 0, "T": 0}


def test_a_flir_that_lost_its_settings_is_halted(tmp_path: Path) -> None:
    """Expected: 9600 baud and no echo, though the driver had raised the line: the tries alternate."""
    unit = SimulatedUnit(FlirModel(arcsec=22.5, min_rate=0), LineModel(baud=9600))
    now_s = time.monotonic()
    unit.flir.execute("CV", now_s)
    unit.flir.execute("PS500", now_s)
    unit.flir.echo = False
    axis = unit.flir.axes["P"]
    with served(unit, tmp_path / "ptu") as server:
        halted(HaltLine(url=str(tmp_path / "ptu"), baud=115200))
        assert stands(server, axis)


def test_a_dynamixel_is_halted_by_its_registers(tmp_path: Path) -> None:
    pytest.importorskip("dynamixel_sdk")
    unit, line, axis = dynamixel()
    link = tmp_path / "ptu"
    with served(unit, link) as server, open_ptu(str(link), "dynamixel", torque_off=False) as driven:
        driven.move_at(pan_rad_s=0.3, tilt_rad_s=0.0)
        assert speed(server, axis) != 0.0 or not stands(server, axis)
        halted(at(line, link))
        assert stands(server, axis)


def test_silence_is_no_acknowledgement(tmp_path: Path) -> None:
    """Expected: an error; whether the unit received it is unknown, and not reported."""
    unit, line, _ = flir()
    link = tmp_path / "ptu"
    with served(unit, link) as server:
        with server.lock:
            server.line.dead = True
        with pytest.raises(PtuError):
            halt_once(at(line, link))


def test_a_line_that_is_not_there_is_one_error(tmp_path: Path) -> None:
    for protocol in ("flir", "pelco-d"):
        with pytest.raises(PtuError, match="wanted"):
            halt_once(HaltLine(url=str(tmp_path / "nowhere"), protocol=protocol))
    with pytest.raises(ProtocolError, match="one of flir"):
        halt_once(HaltLine(url="x", protocol="carrier pigeon"))


@contextmanager
def mount(refused: set[str]) -> Iterator[tuple[str, SimulatedMount]]:
    """A mount behind a real HTTP server, which refuses some methods."""
    simulated = SimulatedMount()

    class Handler(BaseHTTPRequestHandler):
        def do_PUT(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"])).decode()
            path = urlsplit(self.path).path
            if path.rpartition("/")[2] in refused:
                status, data = 200, json.dumps({"ErrorNumber": 0x400, "ErrorMessage": "not implemented"}).encode()
            else:
                status, data = simulated.answer(time.monotonic(), "PUT", path, body)
            self.send_response(status)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_: object) -> None:
            """Write no log."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}", simulated
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@pytest.mark.parametrize("refused", [set(), {"abortslew"}, {"moveaxis"}])
def test_a_mount_is_halted_by_the_requests_it_supports(refused: set[str]) -> None:
    """Expected: one that supports only one of the two ways is halted by that."""
    with mount(refused) as (url, simulated):
        simulated.axes[Axis.PAN].move_at(time.monotonic(), 30_000.0)
        halted(HaltLine(url=url, protocol="alpaca"))
        assert simulated.axes[Axis.PAN].speed(time.monotonic() + 2.0) == 0.0


def test_a_mount_that_refuses_everything_is_not_called_halted() -> None:
    with mount({"moveaxis", "abortslew"}) as (url, _), pytest.raises(PtuError, match="not implemented"):
        halt_once(HaltLine(url=url, protocol="alpaca"))
