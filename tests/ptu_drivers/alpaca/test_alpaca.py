"""An Alpaca mount's driver: accepted and refused HTTP replies, and the protocol over a real socket."""

import json
import math
import random
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from ptu_drivers import open_ptu
from ptu_drivers.alpaca.codec import angles_of, decode, finite
from ptu_drivers.alpaca.unit import AlpacaOptions, AlpacaUnit, connect_alpaca
from ptu_drivers.errors import LimitError, LineError, ProtocolError, RefusedError, UnsupportedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import Axis, Capability, NoReading, Reading
from ptu_drivers.settings import AxisSettings, UnitSettings
from ptu_drivers.simulated.alpaca import MountModel, SimulatedMount
from ptu_drivers.simulated.http_server import VirtualHttp


class Spoilt(VirtualHttp):
    """Replies of the mount, corrupted on a test's request."""

    spoil: Callable[[int, bytes], tuple[int, bytes]] | None = None

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        answer = super().transfer(method, path, query, until_s)
        return self.spoil(*answer) if self.spoil else answer


def rig(model: MountModel | None = None, settings: UnitSettings | None = None) -> tuple[Spoilt, AlpacaUnit]:
    line = Spoilt(SimulatedMount(model))
    options = AlpacaOptions(altitude_low_deg=-10.0)
    return line, connect_alpaca(line, settings or UnitSettings(), options, watch=False)


def changed(**parts: object) -> Callable[[int, bytes], tuple[int, bytes]]:
    return lambda status, body: (status, json.dumps(json.loads(body) | parts).encode())


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda status, body: (status, body[:20]), FailureReason.GARBAGE),
        (lambda status, body: (status, b"[1]"), FailureReason.GARBAGE),
        (lambda status, body: (status, b"\xff\xfe"), FailureReason.GARBAGE),
        (lambda status, body: (500, b"oops"), FailureReason.REFUSED),
        (changed(Value="12"), FailureReason.GARBAGE),
        (changed(Value=True), FailureReason.GARBAGE),
        (changed(Value=None), FailureReason.GARBAGE),
        (changed(Value=float("nan")), FailureReason.GARBAGE),
        (changed(Value=400.0), FailureReason.OUT_OF_RANGE),
        (changed(ClientTransactionID=3), FailureReason.ECHO_MISMATCH),
        (changed(ErrorNumber=1031, ErrorMessage="not connected"), FailureReason.REFUSED),
    ],
)
def test_a_doubtful_reply_gives_no_angle(
    spoil: Callable[[int, bytes], tuple[int, bytes]], reason: FailureReason
) -> None:
    line, unit = rig(MountModel(state=False))
    line.spoil = spoil
    got = unit.read()
    assert isinstance(got, NoReading)
    assert got.reason is reason
    line.spoil = None
    assert isinstance(unit.read(), Reading)


def test_azimuth_is_clockwise_and_pan_is_not() -> None:
    """A station along 250 degrees: its pan 0 is there, and 10 degrees to the left is azimuth 240."""
    settings = UnitSettings(pan=AxisSettings(zero_rad=math.radians(-250.0)))
    line, unit = rig(settings=settings)
    unit.move_to(pan_rad=math.radians(10.0), tilt_rad=math.radians(5.0))
    line.wait(30.0)
    assert line.mount.azimuth_deg(line.now()) == pytest.approx(240.0, abs=1e-3)
    got = unit.read()
    assert isinstance(got, Reading)
    assert math.degrees(got.pan.angle_rad) == pytest.approx(10.0, abs=1e-3)
    assert math.degrees(got.tilt.angle_rad) == pytest.approx(5.0, abs=1e-3)
    assert math.degrees(unit.describe().pan.low_rad) == pytest.approx(-180.0, abs=1e-3)


def test_one_axis_alone_leaves_the_other_its_goal() -> None:
    line, unit = rig()
    unit.move_to(pan_rad=1.0, tilt_rad=0.5)
    line.wait(0.1)
    unit.move_to(pan_rad=0.2)
    line.wait(20.0)
    assert line.mount.altitude_deg(line.now()) == pytest.approx(math.degrees(0.5), abs=1e-3)
    assert line.mount.azimuth_deg(line.now()) == pytest.approx(360 - math.degrees(0.2), abs=1e-3)


def test_a_rate_is_stopped_by_halt_and_by_the_watchdog() -> None:
    line, unit = rig()
    unit.move_at(pan_rad_s=0.1, tilt_rad_s=0.05)
    line.wait(0.3)
    unit.halt()
    line.wait(1.0)
    assert not any(axis.speed(line.now()) for axis in line.mount.axes.values())
    unit.move_at(pan_rad_s=-0.1, tilt_rad_s=0.0)
    line.wait(0.7)
    unit.read()
    line.wait(1.0)
    assert line.mount.axes[Axis.PAN].speed(line.now()) == 0
    assert unit.health().watchdog_stops == 1


def test_an_equatorial_mount_takes_no_rates() -> None:
    _, unit = rig(MountModel(alignment=1))
    assert Capability.VELOCITY not in unit.describe().capabilities
    with pytest.raises(UnsupportedError, match="rate"):
        unit.move_at(pan_rad_s=0.01, tilt_rad_s=0.0)


class Noted(VirtualHttp):
    """Notes what is set, and answers one question otherwise."""

    def __init__(self, mount: SimulatedMount, name: str = "", value: object = None) -> None:
        super().__init__(mount)
        self.put: list[str] = []
        self._name, self._value = name, value

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        name = path.split("?")[0].rsplit("/", 1)[-1]
        if method == "PUT":
            self.put.append(name)
        status, body = super().transfer(method, path, query, until_s)
        return changed(Value=self._value)(status, body) if name == self._name else (status, body)


def test_a_mount_that_does_not_slew_by_altitude_is_refused() -> None:
    line = Noted(SimulatedMount(), "canslewaltazasync", False)
    with pytest.raises(ProtocolError, match="got a mount without SlewToAltAzAsync; wanted one that slews by altitude"):
        connect_alpaca(line, UnitSettings(), AlpacaOptions(altitude_low_deg=-10.0), watch=False)


@pytest.mark.parametrize(("already", "put"), [(False, ["connected"]), (True, [])])
def test_a_mount_is_connected_only_if_it_is_not(already: bool, put: list[str]) -> None:
    line = Noted(SimulatedMount(), "connected", already)
    connect_alpaca(line, UnitSettings(), AlpacaOptions(altitude_low_deg=-10.0), watch=False)
    assert [name for name in line.put if name == "connected"] == put


def test_a_refusal_by_the_mount_is_reported() -> None:
    line, unit = rig()
    line.spoil = changed(ErrorNumber=1032, ErrorMessage="parked")
    with pytest.raises(RefusedError, match=r"slewtoaltazasync.*parked \(1032\)"):
        unit.move_to(pan_rad=0.1, tilt_rad=0.1)


@pytest.fixture
def server() -> Iterator[tuple[str, SimulatedMount]]:
    """The mount behind a real socket; `dawdle` sleeps longer than any wait, `trickles` a byte at a time."""
    mount = SimulatedMount(MountModel(max_rate_deg_s=100.0, acceleration_deg_s2=2000.0))

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def reply(self, query: str) -> None:
            status, body = mount.answer(time.monotonic(), self.command, self.path.partition("?")[0], query)
            if server.dawdle:
                time.sleep(0.3)
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if server.trickles and self.command == "GET":
                for byte in body:
                    self.wfile.write(bytes((byte,)))
                    time.sleep(0.15)
                return
            self.wfile.write(body)

        def do_GET(self) -> None:
            self.reply(self.path.partition("?")[2])

        def do_PUT(self) -> None:
            self.reply(self.rfile.read(int(self.headers["Content-Length"])).decode())

        def log_message(self, *_: object) -> None:
            pass

    class Server(ThreadingHTTPServer):
        dawdle = False
        trickles = False
        daemon_threads = True

        def handle_error(self, request: object, client_address: object) -> None:
            """A client that did not wait for its answer is what one test is about."""

    server = Server(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    mount.server = server  # type: ignore[attr-defined]
    yield f"http://127.0.0.1:{server.server_port}", mount
    server.shutdown()
    server.server_close()
    thread.join()


def test_over_a_socket(server: tuple[str, SimulatedMount]) -> None:
    url, mount = server
    with open_ptu(url, "alpaca", UnitSettings(reply_timeout_s=2.0)) as unit:
        assert unit.describe().model == "Simulated mount"
        unit.move_to(pan_rad=0.3, tilt_rad=0.2)
        time.sleep(0.6)
        got = unit.read()
        assert isinstance(got, Reading)
        assert (got.pan.angle_rad, got.tilt.angle_rad) == (pytest.approx(0.3, abs=1e-4), pytest.approx(0.2, abs=1e-4))
        with pytest.raises(LimitError, match="tilt"):
            unit.move_to(tilt_rad=-0.1)
        unit.move_at(pan_rad_s=0.5, tilt_rad_s=0.0)
        time.sleep(0.1)
    time.sleep(0.1)
    assert mount.axes[Axis.PAN].speed(time.monotonic()) == 0


def test_a_slow_server_gives_no_angle_and_its_late_reply_is_never_read(server: tuple[str, SimulatedMount]) -> None:
    url, mount = server
    with open_ptu(url, "alpaca", UnitSettings(reply_timeout_s=0.1)) as unit:
        mount.server.dawdle = True  # type: ignore[attr-defined]
        began = time.monotonic()
        got = unit.read()
        assert isinstance(got, NoReading)
        assert got.reason is FailureReason.TIMEOUT
        assert time.monotonic() - began < 0.29
        mount.server.dawdle = False  # type: ignore[attr-defined]
        end = time.monotonic() + 5.0
        while not isinstance(got := unit.read(), Reading):
            assert time.monotonic() < end
        assert FailureReason.ECHO_MISMATCH not in unit.health().failures


def test_a_trickling_reply_delays_neither_read_nor_halt(server: tuple[str, SimulatedMount]) -> None:
    """An angle's answer would take half a minute, while the mount turns."""
    url, mount = server
    with open_ptu(url, "alpaca", UnitSettings(reply_timeout_s=10.0, watchdog_s=0.0)) as unit:
        assert isinstance(unit.read(), Reading)
        unit.move_at(pan_rad_s=0.3, tilt_rad_s=0.0)
        mount.server.trickles = True  # type: ignore[attr-defined]
        answered: list[Reading | NoReading] = []
        reading = threading.Thread(target=lambda: answered.append(unit.read()))
        reading.start()
        time.sleep(0.3)
        asked = time.monotonic()
        unit.halt()
        # one exchange may take 20 s here: it was not waited for
        assert time.monotonic() - asked < 8.0
        reading.join(60.0)
        assert isinstance(answered[0], NoReading)
        assert answered[0].reason is FailureReason.PREEMPTED
        mount.server.trickles = False  # type: ignore[attr-defined]
    assert mount.axes[Axis.PAN].speed(time.monotonic()) == 0


def test_nobody_there_is_named() -> None:
    with pytest.raises(LineError, match=r"http://127.0.0.1:9: got .*refused.*wanted an Alpaca server"):
        open_ptu("http://127.0.0.1:9", "alpaca")


@pytest.mark.parametrize("url", ["/dev/ttyUSB0", "https://host", "http://", "http://host:port"])
def test_a_wrong_address_is_named(url: str) -> None:
    with pytest.raises(ProtocolError, match=r"Alpaca address: got .*wanted http://host:port"):
        open_ptu(url, "alpaca")


def test_another_telescope_number_is_refused(server: tuple[str, SimulatedMount]) -> None:
    with pytest.raises(ProtocolError, match=r"HTTP 400.*wanted telescope 3"):
        open_ptu(server[0], "alpaca", device=3)


def test_wrong_options_are_named() -> None:
    with pytest.raises(ProtocolError, match="altitude_low_deg: got -91"):
        AlpacaOptions(altitude_low_deg=-91.0)
    with pytest.raises(ProtocolError, match="got number; wanted device"):
        open_ptu("http://127.0.0.1:9", "alpaca", number=1)


@pytest.mark.parametrize(
    "value",
    ["1e400", "1" + "0" * 400, "9" * 5000, "NaN", "true", '"12"', "[" * 3000, "null"],
)
def test_numbers_that_are_none(value: str) -> None:
    """JSON allows integers beyond all numbers, and brackets beyond all stacks."""
    with pytest.raises(ExchangeFailed):
        finite("azimuth", decode("azimuth", 200, b'{"Value":' + value.encode() + b"}", 1)["Value"])


@pytest.mark.parametrize(
    "state", [None, {}, [3], [{"Name": ["Azimuth"], "Value": 1}], [{"Name": "Azimuth", "Value": 1}]]
)
def test_states_that_are_none(state: object) -> None:
    with pytest.raises(ExchangeFailed):
        angles_of(state)


def test_fuzz_short() -> None:
    """The first of what `benchmarks/ptu_fuzz.py` does a million times."""
    import ptu_fuzz

    found = ptu_fuzz.fuzz_alpaca(5_000, random.Random(5))
    assert found["answers"] > 500
    assert found["numbers"] > 50
