"""A line's calls end in their time though pyserial, the system's resolver or the network do not."""

import os
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from ptu_drivers.emergency_halt import HaltLine, prepared
from ptu_drivers.errors import LineError
from ptu_drivers.transport import SerialTransport


class HangingPort:
    """A port as pyserial's, whose calls wait until they are let go."""

    def __init__(self) -> None:
        self.let_go = threading.Event()
        self.closed = threading.Event()

    def write(self, data: bytes) -> int:
        self.let_go.wait(60.0)
        return len(data)

    def close(self) -> None:
        self.closed.set()


@pytest.fixture
def port() -> Iterator[HangingPort]:
    hanging = HangingPort()
    yield hanging
    hanging.let_go.set()


def test_a_hanging_connection_is_abandoned_and_closed_when_established_late(
    port: HangingPort, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*_: object, **__: object) -> HangingPort:
        port.let_go.wait(60.0)
        return port

    monkeypatch.setattr("serial.serial_for_url", opened)
    with pytest.raises(LineError, match=r"no connection in 0\.1 s"):
        SerialTransport("socket://127.0.0.1:4000", 9600, open_within_s=0.1)
    assert not port.closed.is_set()
    port.let_go.set()
    assert port.closed.wait(10.0)


@pytest.mark.parametrize("url", ["/dev/ttyUSB0", "socket://127.0.0.1:4000"])
def test_without_memory_for_a_thread_it_is_opened_all_the_same(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a motion guard that is short of memory still halts (found by `benchmarks/live_kill.py`)."""
    opened = HangingPort()

    def no_thread(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("serial.serial_for_url", lambda *_, **__: opened)
    monkeypatch.setattr(threading.Thread, "start", no_thread)
    SerialTransport(url, 9600, open_within_s=0.1).close()
    assert opened.closed.is_set()


def test_an_error_while_it_connects_is_the_lines_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> HangingPort:
        raise ConnectionRefusedError("nothing listens")

    monkeypatch.setattr("serial.serial_for_url", refused)
    with pytest.raises(LineError, match="nothing listens"):
        SerialTransport("socket://127.0.0.1:4000", 9600, open_within_s=10.0)


def test_a_write_that_rfc2217_does_not_take_is_a_lost_line(port: HangingPort, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: LineError though the port itself never returns, and no second write waits behind the first."""
    monkeypatch.setattr("serial.serial_for_url", lambda *_, **__: port)
    line = SerialTransport("rfc2217://127.0.0.1:4000", 9600)
    with pytest.raises(LineError, match="no bytes taken"):
        line.write(b"H ")
    with pytest.raises(LineError, match="a closed line"):
        line.write(b"H ")
    assert not port.let_go.is_set()


@pytest.mark.parametrize(
    ("url", "found"),
    [
        ("socket://unit.lan:4000", "socket://192.0.2.7:4000"),
        ("rfc2217://unit.lan:4000?logging=debug", "rfc2217://192.0.2.7:4000?logging=debug"),
        ("http://unit.lan:11111", "http://192.0.2.7:11111"),
        ("http://unit.lan", "http://192.0.2.7"),
        ("/dev/ttyUSB0", "/dev/ttyUSB0"),
        ("socket://unit.lan:none", "socket://unit.lan:none"),
    ],
)
def test_a_hosts_name_is_resolved_ahead(url: str, found: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        socket, "getaddrinfo", lambda *_, **__: [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("192.0.2.7", 0))]
    )
    line = HaltLine(url=url, protocol="pelco-d", options={"address": 3}, baud=2400)
    assert prepared(line) == HaltLine(url=found, protocol="pelco-d", options={"address": 3}, baud=2400)


def test_an_address_of_ipv6_has_its_brackets_and_an_unknown_name_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    known: list[Any] = [(socket.AF_INET6, socket.SOCK_STREAM, 6, "", ("2001:db8::7", 0, 0, 0))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: known)
    assert prepared(HaltLine(url="http://unit.lan:11111")).url == "http://[2001:db8::7]:11111"

    def unknown(*_: object, **__: object) -> list[Any]:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    assert prepared(HaltLine(url="http://unit.lan:11111")).url == "http://unit.lan:11111"


def test_a_line_that_is_quick_is_open(monkeypatch: pytest.MonkeyPatch, port: HangingPort) -> None:
    monkeypatch.setattr("serial.serial_for_url", lambda *_, **__: port)
    line = SerialTransport("socket://127.0.0.1:4000", 9600, open_within_s=600.0)
    assert not port.closed.is_set()
    line.close()
    assert port.closed.is_set()


def test_bytes_that_another_program_took_are_no_closed_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: what comes after them is read; a line whose other end is gone, and a closed connection, are told."""
    master, slave = os.openpty()
    transport = SerialTransport(os.ttyname(slave), 9600, time.monotonic)
    read, taken = os.read, [b""]
    monkeypatch.setattr("ptu_drivers.transport.os.read", lambda fd, n: taken.pop() if taken else read(fd, n))
    os.write(master, b"PP * 7\r\n")
    assert transport.read(time.monotonic() + 5.0).data == b"PP * 7\r\n"
    os.close(master)
    with pytest.raises(LineError):
        transport.read(time.monotonic() + 5.0)
    transport.close()
    os.close(slave)
