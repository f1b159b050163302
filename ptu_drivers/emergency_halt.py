"""Halting a unit whose driver has ended or hangs: open its line even if another program holds it, halt, and no more.

Nothing is probed, homed or set. The halt is sent before any query: where a line works in one direction only, the unit
still stops. Then the unit is queried in its own protocol, to report whether it received the halt.
"""

import contextlib
import importlib
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any
from urllib.parse import urlsplit

from ptu_drivers.alpaca.http_connection import HttpConnection
from ptu_drivers.alpaca.telescope import AlpacaTelescope
from ptu_drivers.alpaca.unit import AlpacaOptions
from ptu_drivers.dynamixel.unit import DynamixelOptions
from ptu_drivers.errors import NoAnswerError, ProtocolError, PtuError, RefusedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import encode as flir_encode
from ptu_drivers.flir.line import FlirLine
from ptu_drivers.flir.setup import BAUDS
from ptu_drivers.health import HealthCounter
from ptu_drivers.pelco.codec import Opcode, PelcoFraming, PelcoMessage
from ptu_drivers.pelco.exchange import PelcoExchange
from ptu_drivers.pelco.unit import PelcoOptions
from ptu_drivers.protocol_options import parse_options
from ptu_drivers.transport import SerialTransport

# time to wait for a reply; a unit replies within 10 ms, over a loaded network within 100
_REPLY_S = 0.15
# a connection to a unit's network line is waited for so long in one try
_OPEN_S = 0.5
# modules otherwise imported at the first use: by a line's scheme and by protocol
_MODULES = MappingProxyType(
    {
        "socket": ("serial.urlhandler.protocol_socket",),
        "rfc2217": ("serial.rfc2217", "serial.urlhandler.protocol_rfc2217"),
        "dynamixel": ("ptu_drivers.dynamixel.bus", "ptu_drivers.dynamixel.table"),
    }
)
# a D-series unit drops commands faster than ten a second
_PACE_S = 0.11


@dataclass(frozen=True, slots=True, kw_only=True)
class HaltLine:
    """The address of a unit for `halt_once`.

    Attributes
    ----------
    url, protocol, options : as in `open_ptu`.
    baud : speed to which the driver raises the line, bit/s; 0 where it keeps the unit's own.
    """

    url: str
    protocol: str = "flir"
    options: Mapping[str, Any] = field(default_factory=dict)
    baud: int = 0


def prepared(line: HaltLine) -> HaltLine:
    """Return the line with its host's address, with all modules imported that a halt needs.

    A halt then needs no name server and little memory. An unknown name stays unchanged.
    Queries the system's resolver, which may take seconds: call it when the line is set up.
    """
    with contextlib.suppress(ImportError):
        for name in ("serial", *_MODULES.get(line.url.partition("://")[0], ()), *_MODULES.get(line.protocol, ())):
            importlib.import_module(name)
    parts = urlsplit(line.url)
    try:
        host, port = parts.hostname, parts.port
        if not parts.netloc or not host:
            return line
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, ValueError):
        return line
    number = f"[{address[0]}]" if family == socket.AF_INET6 else str(address[0])
    netloc = number if port is None else f"{number}:{port}"
    return replace(line, url=parts._replace(netloc=netloc).geturl())


def halt_once(line: HaltLine, attempt: int = 0, clock: Callable[[], float] = time.monotonic) -> None:
    """Send a halt, and return when the unit has acknowledged it; at most about half a second on an open line.

    Parameters
    ----------
    line : the unit's. attempt : number of the attempt, from 0; uncertain settings alternate.
    clock : monotonic, s.

    Raises
    ------
    PtuError : the line cannot be opened, or no acknowledgement arrived; then the unit may or may not have received it.
    """
    began_s = clock()
    try:
        halt = HALTS[line.protocol]
    except KeyError:
        raise ProtocolError("protocol", got=line.protocol, wanted="one of " + ", ".join(HALTS)) from None
    try:
        halt(line, attempt, clock)
    except ExchangeFailed as fault:
        raise NoAnswerError("halt", waited_s=clock() - began_s, got=str(fault)) from fault


def _opened(line: HaltLine, baud: int, clock: Callable[[], float]) -> SerialTransport:
    return SerialTransport(line.url, baud, clock, exclusive=False, open_within_s=_OPEN_S)


def _halt_flir(line: HaltLine, attempt: int, clock: Callable[[], float]) -> None:
    bauds = tuple(dict.fromkeys((line.baud or BAUDS[0], BAUDS[0])))
    transport = SerialTransport(
        line.url, bauds[attempt // 2 % len(bauds)], clock, exclusive=False, open_within_s=_OPEN_S
    )
    try:
        # twice: half a command of the ended driver may precede the first and invalidate it
        _heard(transport, "H", clock() + _PACE_S)
        heard = _heard(transport, "H", clock() + _REPLY_S)
        transport.wait(_PACE_S)
        asked = FlirLine(transport, HealthCounter(), _REPLY_S)
        if not heard:
            if attempt % 2:
                # a unit that has lost its settings does not echo
                asked.greet(clock() + 3 * asked.longest_s())
            else:
                asked.resynchronise(clock() + asked.longest_s())
            _acknowledged(asked, "H")
        if "velocity" in asked.query("C").answer.text.lower():
            # H stops the motion; the rates that are set must not begin again
            _acknowledged(asked, "PS0")
            _acknowledged(asked, "TS0")
    finally:
        transport.close()


def _heard(transport: SerialTransport, command: str, until_s: float) -> bool:
    """Send a command on a line in any state; return whether a reply arrived by then. False for a line that is full."""
    transport.write(flir_encode(command))
    answer = f"{command} *".encode()
    received = b""
    while True:
        chunk = transport.read(until_s)
        received += chunk.data
        if answer in received:
            return True
        if not chunk.data:
            return False


def _acknowledged(line: FlirLine, command: str) -> None:
    answer = line.query(command).answer
    if not answer.ok:
        raise RefusedError(command, reported=answer.text)


def _halt_pelco(framing: PelcoFraming) -> Callable[[HaltLine, int, Callable[[], float]], None]:
    def halt(line: HaltLine, _attempt: int, clock: Callable[[], float]) -> None:
        options = parse_options(PelcoOptions, "Pelco", line.options)
        transport = _opened(line, line.baud or options.baud, clock)
        exchange = PelcoExchange(
            line=transport, address=options.address, framing=framing, reply_timeout_s=_REPLY_S, late_s=options.late_s
        )
        stop = PelcoMessage(address=options.address, opcode=Opcode.STOP)
        pause_s = 8 * transport.character_s() + options.gap_s
        try:
            # a stop has no reply of its own: it is sent before and after a query that has one
            for _ in range(2):
                exchange.send(stop)
                transport.wait(pause_s)
            try:
                exchange.query(exchange.barrier()[0], clock() + _REPLY_S + 16 * transport.character_s())
            finally:
                exchange.send(stop)
        finally:
            transport.close()

    return halt


def _halt_dynamixel(line: HaltLine, _attempt: int, clock: Callable[[], float]) -> None:
    # the maker's package is an extra: imported only where a unit needs it
    from ptu_drivers.dynamixel import table
    from ptu_drivers.dynamixel.bus import DynamixelBus
    from ptu_drivers.dynamixel.table import OperatingMode

    options = parse_options(DynamixelOptions, "Dynamixel", line.options)
    transport = _opened(line, line.baud or options.baud, clock)
    try:
        bus = DynamixelBus(transport, _REPLY_S)
        failed: ExchangeFailed | None = None
        for identifier in (options.pan_id, options.tilt_id):
            try:
                bus.drain()
                try:
                    bus.write(identifier, table.GOAL_VELOCITY, 0)
                    if bus.read(identifier, table.OPERATING_MODE) != OperatingMode.VELOCITY:
                        bus.write(identifier, table.GOAL_POSITION, bus.read(identifier, table.PRESENT_POSITION))
                except RefusedError:
                    # its own watchdog has closed its goals; without torque nothing turns it
                    bus.write(identifier, table.TORQUE_ENABLE, 0)
            except ExchangeFailed as fault:
                failed = fault
        if failed is not None:
            raise failed
    finally:
        transport.close()


def _halt_alpaca(line: HaltLine, _attempt: int, clock: Callable[[], float]) -> None:
    options = parse_options(AlpacaOptions, "Alpaca", line.options)
    connection = HttpConnection(line.url, clock)
    connection.reopen()
    telescope = AlpacaTelescope(connection, options.device)
    refused: RefusedError | None = None
    failed: ExchangeFailed | PtuError | None = None
    heard = False
    try:
        # what stops a slew need not stop a motion by rate, and a mount may know but one of them
        for name, parameters in (
            ("moveaxis", {"Axis": 0, "Rate": "0"}),
            ("moveaxis", {"Axis": 1, "Rate": "0"}),
            ("abortslew", {}),
        ):
            try:
                telescope.put(name, clock() + _REPLY_S, **parameters)
                heard = True
            except RefusedError as fault:
                refused = fault
            except (ExchangeFailed, PtuError) as fault:
                failed = fault
    finally:
        connection.close()
    if failed is not None:
        raise failed
    if refused is not None and not heard:
        raise refused


HALTS: Mapping[str, Callable[[HaltLine, int, Callable[[], float]], None]] = MappingProxyType(
    {
        "flir": _halt_flir,
        "pelco-d": _halt_pelco(PelcoFraming.D),
        "pelco-p": _halt_pelco(PelcoFraming.P),
        "dynamixel": _halt_dynamixel,
        "alpaca": _halt_alpaca,
    }
)
