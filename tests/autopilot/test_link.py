"""The link on the wire: its bytes by pymavlink, by MAVSDK and by node-mavlink, signing, clock, and where it listens."""

import json
import math
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from groundstation.autopilot.link_url import parse_link_url
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.mavlink_link import MavlinkLink
from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.received import receive
from groundstation.autopilot.settings import AutopilotMode, AutopilotSettings
from groundstation.autopilot.signing_key import read_signing_key
from groundstation.autopilot.status_text import status_texts
from groundstation.autopilot.stream import HEARTBEAT, AutopilotStream, StreamClock
from groundstation.autopilot.vehicle_attitude import VehicleAttitude
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.errors import ConfigError
from tests.autopilot.flights import ORIGIN, SEPARATION_M, StraightFlight, answer, stream_of
from tests.peers import absent, peer_module

_HERE = Path(__file__).parent
_NODE_PEERS = _HERE.parent.parent / ".venv-peers" / "node"
_KEY, _OTHER_KEY = bytes(range(32)), bytes(32)
_XML = str(Path(common.__file__).with_suffix(".xml"))
_SESSION_S, _LINK_NS = 12.5, 1_012_500_000_000


class Vehicle:
    """A UDP socket in the vehicle's place, with pymavlink's codec."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(5.0)
        self.mav = common.MAVLink(self, srcSystem=1, srcComponent=1)
        self.mav.robust_parsing = True
        self.peer: tuple[str, int] | None = None

    @property
    def url(self) -> str:
        """Where the link sends to."""
        return f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"

    def write(self, data: bytes) -> None:
        """Send bytes to the link."""
        assert self.peer is not None
        self.socket.sendto(data, self.peer)

    def datagram(self) -> bytes:
        """Return the next datagram."""
        data, self.peer = self.socket.recvfrom(4096)
        return data

    def parsed(self, data: bytes) -> list[Any]:
        """Return the messages of a datagram."""
        return list(self.mav.parse_buffer(data) or ())

    def message(self, name: str) -> Any:
        """Return the next message of a name."""
        for _ in range(100):
            for message in self.parsed(self.datagram()):
                if message.get_type() == name:
                    return message
        raise AssertionError(f"no {name} came")


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    """A vehicle that listens."""
    found = Vehicle()
    yield found
    found.socket.close()


def _link(url: str, key: bytes | None = None) -> MavlinkLink:
    return MavlinkLink(parse_link_url(url), (245, 197), lambda: _SESSION_S, lambda: _LINK_NS, key)


def _all_messages() -> list[MavlinkMessage]:
    """Return what each mode sends of one state, and what each second brings."""
    flight, messages = StraightFlight(), list(status_texts(2, "WAVE-OFF: the stations do not agree, by 4 sigma", 3))
    attitude = VehicleAttitude.from_euler(2.0, 0.1, 0.05, -2.6, np.zeros(3))
    for mode in AutopilotMode:
        stream = stream_of(flight, mode)
        stream.note(answer(flight, 2.0))
        # for all systems: MAVSDK passes on no message that is for another one
        messages += stream.messages(2.0, VehicleState(attitude=attitude))
    return messages


def _same(wanted: object, found: object) -> bool:
    """Return whether a value came as it was sent, as a float of 32 bits where it is one."""
    if isinstance(wanted, bytes):
        return str(found).rstrip("\0") == wanted.decode()
    if isinstance(wanted, list):
        return isinstance(found, list | tuple) and len(found) == len(wanted) and all(map(_same, wanted, found))
    if isinstance(wanted, float) and math.isnan(wanted):
        return found is None or found == "NaN" or (isinstance(found, float) and math.isnan(found))
    assert isinstance(wanted, int | float)
    return found is not None and math.isclose(float(str(found)), wanted, rel_tol=1e-6, abs_tol=1e-6)


def test_bytes_are_mavlink_2_with_running_sequence_and_source(vehicle: Vehicle) -> None:
    link = _link(vehicle.url)
    sent = _all_messages()[:12]
    link.send(sent)
    for k, wanted in enumerate(sent):
        data = vehicle.datagram()
        assert data[0] == 0xFD
        (message,) = vehicle.parsed(data)
        assert message.get_type() == wanted.name
        assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (245, 197, k)
        assert all(_same(value, getattr(message, key)) for key, value in wanted.fields.items()), wanted.name
    link.close()


def test_a_message_that_cannot_be_encoded_stops_no_other(vehicle: Vehicle) -> None:
    """Expected: the next one arrives, and the link says which could not be sent."""
    link = _link(vehicle.url)
    good = _all_messages()[0]
    link.send([MavlinkMessage(name="HEARTBEAT", fields={**HEARTBEAT.fields, "custom_mode": -1}), good])
    (message,) = vehicle.parsed(vehicle.datagram())
    assert message.get_type() == good.name
    assert link.fault.startswith("HEARTBEAT could not be sent")
    link.close()


def test_a_computer_without_the_date_still_sends_positions(vehicle: Vehicle) -> None:
    """Unix time of 100 s, as of a board without a battery. Expected: GPS_INPUT with a week that ArduPilot takes."""
    flight = StraightFlight()
    settings = AutopilotSettings(url="udpout:127.0.0.1:1", mode=AutopilotMode.GPS_INPUT, link_delay_sigma_s=0.0)
    clock = StreamClock(link_s=1000.0, unix_s=100.0)
    stream = AutopilotStream(settings, LocalFrame(ORIGIN, SEPARATION_M), clock, flight.estimate_at)
    stream.note(answer(flight, 2.0))
    link = _link(vehicle.url)
    link.send(stream.messages(2.0, VehicleState()))
    assert vehicle.message("GPS_INPUT").time_week > 0
    link.close()


def test_a_vehicle_that_begins_with_mavlink_1_still_gets_mavlink_2(vehicle: Vehicle) -> None:
    from pymavlink.dialects.v10 import common as v10

    link = _link(vehicle.url)
    link.send([_all_messages()[0]])
    vehicle.datagram()
    heartbeat = v10.MAVLink(None, srcSystem=1, srcComponent=1).heartbeat_encode(2, 12, 0, 0, 4)
    vehicle.write(heartbeat.pack(v10.MAVLink(None, srcSystem=1, srcComponent=1)))
    state = VehicleState()
    for _ in range(500):
        for message in link.received():
            receive(state, message.name, message.fields, message.source, message.received_s, link_s=1000.0)
        if state.system:
            break
        time.sleep(0.01)
    assert (state.system, state.autopilot) == (1, 12)
    link.send([_all_messages()[0]])
    assert vehicle.datagram()[0] == 0xFD
    link.close()


def test_a_request_of_the_time_is_answered_with_the_links_clock(vehicle: Vehicle) -> None:
    link = _link(vehicle.url)
    link.send([_all_messages()[0]])
    vehicle.datagram()
    vehicle.mav.timesync_send(0, 77_000)
    found = vehicle.message("TIMESYNC")
    assert (found.tc1, found.ts1) == (_LINK_NS, 77_000)
    link.close()


def test_a_signed_link_signs_and_takes_its_own_key_alone(vehicle: Vehicle) -> None:
    link = _link(vehicle.url, _KEY)
    heartbeat = [_all_messages()[0]]
    vehicle.mav.signing.secret_key = _KEY
    vehicle.mav.signing.allow_unsigned_callback = None
    link.send(heartbeat)
    (message,) = vehicle.parsed(vehicle.datagram())
    assert message.get_signed()
    # expected: of three heartbeats only the one signed with the link's key arrives
    for key, mode in ((None, 1), (_OTHER_KEY, 2), (_KEY, 3)):
        sender = common.MAVLink(vehicle, srcSystem=1, srcComponent=mode)
        if key is not None:
            sender.signing.secret_key, sender.signing.sign_outgoing = key, True
            sender.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
        sender.heartbeat_send(1, 3, 0, mode, 4)
    arrived: list[object] = []
    for _ in range(500):
        arrived += [m.fields["custom_mode"] for m in link.received()]
        if arrived:
            break
        time.sleep(0.01)
    assert arrived == [3]
    assert link.refused == 2
    link.close()


def test_a_receiver_with_another_key_refuses(vehicle: Vehicle) -> None:
    link = _link(vehicle.url, _KEY)
    vehicle.mav.signing.secret_key = _OTHER_KEY
    link.send([_all_messages()[0]])
    (message,) = vehicle.parsed(vehicle.datagram())
    assert message.get_type() == "BAD_DATA"
    link.close()


def test_what_does_not_fit_the_line_is_dropped_the_oldest_first_and_counted() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    link = _link(f"tcp:127.0.0.1:{server.getsockname()[1]}")
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.ODOMETRY)
    stream.note(answer(flight, 2.0))
    batch = stream.messages(2.0, VehicleState()) * 8
    for _ in range(20_000):
        link.send(batch)
        if link.dropped:
            break
    assert link.dropped > 0
    link.close()
    server.close()


@pytest.mark.parametrize(
    ("url", "device", "baud"),
    [
        ("udpout:10.1.2.3:14550", "udpout:10.1.2.3:14550", 57_600),
        ("udpin:14550", "udpin:127.0.0.1:14550", 57_600),
        ("udp::14550", "udpin:127.0.0.1:14550", 57_600),
        ("udpin:0.0.0.0:14550", "udpin:0.0.0.0:14550", 57_600),
        ("udpout://localhost:14550", "udpout:localhost:14550", 57_600),
        ("tcp:127.0.0.1:5760", "tcp:127.0.0.1:5760", 57_600),
        ("/dev/ttyUSB0", "/dev/ttyUSB0", 57_600),
        ("serial:/dev/ttyUSB0:921600", "/dev/ttyUSB0", 921_600),
    ],
)
def test_urls_and_a_listener_of_its_own_machine_unless_told_otherwise(url: str, device: str, baud: int) -> None:
    found = parse_link_url(url)
    assert (found.device, found.baud) == (device, baud)


@pytest.mark.parametrize("url", ["", "14550", "udpout:14550", "udpin:70000", "http://x:1", "udpout:a b:1", "log.bin"])
def test_what_is_no_url_is_refused(url: str) -> None:
    with pytest.raises(ConfigError, match="autopilot URL"):
        parse_link_url(url)


@pytest.mark.parametrize("link", ["udpout:192.168.0.256:14550", "tcp:10.1.2:5760", "udpin:1.2.3.4.5:14550"])
def test_a_host_of_numbers_that_is_none_is_refused(link: str) -> None:
    """Expected: not a vehicle that keeps silent."""
    with pytest.raises(ConfigError, match="wanted four numbers from 0 to 255, or a name"):
        parse_link_url(link)


def test_a_serial_port_that_is_not_there_is_a_clear_error() -> None:
    with pytest.raises(ConfigError, match="ttyNONE"):
        _link("/dev/ttyNONE")
    # no class of a library, no number of the operating system
    with pytest.raises(ConfigError, match=r"URL /dev/null: got a device that is no serial line; wanted a line that"):
        _link("/dev/null")


def test_keys(tmp_path: Path) -> None:
    path = tmp_path / "key"
    for content, wanted in ((_KEY.hex(), _KEY), ("correct horse", None)):
        path.write_text(content + "\n")
        path.chmod(0o600)
        found = read_signing_key(path)
        assert len(found) == 32
        assert wanted is None or found == wanted
    path.write_text("short")
    with pytest.raises(ConfigError, match="hexadecimal"):
        read_signing_key(path)
    path.write_text("long enough")
    path.chmod(0o644)
    with pytest.raises(ConfigError, match="others may read"):
        read_signing_key(path)


def _wait_until(holds: Callable[[], bool]) -> None:
    """Wait for up to half a minute."""
    for _ in range(1500):
        if holds():
            return
        time.sleep(0.02)
    raise AssertionError("it did not come within 30 s")


def test_mavsdk_decodes_every_mode_with_the_values_sent(tmp_path: Path) -> None:
    peer_module("mavsdk", "mavsdk")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, str(_HERE / "mavsdk_receiver.py"), f"udpin://127.0.0.1:{port}", "4", _XML, "296"]
    printed = tmp_path / "printed"  # a file takes any amount, a pipe that is read at the end 64 KiB
    with printed.open("w") as out, subprocess.Popen(command, stdout=out) as receiver:
        try:
            _wait_until(lambda: "READY" in printed.read_text())
            link = _link(f"udpout:127.0.0.1:{port}")
            sent = _all_messages()
            for _ in range(200):
                for message in sent:
                    link.send([message])
                    time.sleep(0.005)
                if receiver.poll() is not None:
                    break
                time.sleep(0.2)
            link.close()
            assert receiver.wait(30) == 0
        finally:
            receiver.kill()
    lines = [json.loads(line) for line in printed.read_text().splitlines() if line.startswith("{")]
    for wanted in sent:
        if wanted.name in ("TIMESYNC", "HEARTBEAT"):
            continue
        found = [line["fields"] for line in lines if line["name"] == wanted.name]
        assert found, f"MAVSDK has seen no {wanted.name}"
        assert any(all(_same(v, f.get(k)) for k, v in wanted.fields.items()) for f in found), (wanted, found[0])


def test_node_mavlink_decodes_every_mode_with_the_values_sent(vehicle: Vehicle, tmp_path: Path) -> None:
    """Expected: each message that it knows; GLOBAL_POSITION_SENSOR is newer than its definitions.

    It is not given that one: after a message that it does not know it looks for the next start byte, which is in one
    signature of some twenty by chance, and leaves out what follows.
    """
    if shutil.which("node") is None or not (_NODE_PEERS / "node_modules" / "node-mavlink").is_dir():
        absent("node-mavlink", "make peers-node (needs node and npm)")
    link = _link(vehicle.url, _KEY)
    sent, data = _all_messages(), b""
    for message in sent:
        link.send([message])
        datagram = vehicle.datagram()
        data += b"" if message.name == "GLOBAL_POSITION_SENSOR" else datagram
    link.close()
    (tmp_path / "bytes").write_bytes(data)
    run = subprocess.run(
        ["node", str(_HERE / "node_receiver.mjs"), str(tmp_path / "bytes"), _KEY.hex()],
        env=os.environ | {"NODE_PEERS": str(_NODE_PEERS)},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    lines = [json.loads(line) for line in run.stdout.splitlines()]
    known = [(k, message) for k, message in enumerate(sent) if message.name != "GLOBAL_POSITION_SENSOR"]
    assert [line["seq"] for line in lines] == [k for k, _ in known]
    for (_, wanted), found in zip(known, lines, strict=True):
        assert found["source"] == [245, 197]
        assert found["signed"] is True
        assert found["name"] == wanted.name
        named = {key.lower().replace("_", ""): value for key, value in found["fields"].items()}
        for key, value in wanted.fields.items():
            assert _same(value, named[key.lower().replace("_", "")]), (wanted.name, key)
