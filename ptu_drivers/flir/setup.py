"""FLIR / Directed Perception pan-tilt units: found on their line, set up, probed."""

import time
from collections.abc import Callable
from contextlib import suppress

from ptu_drivers.errors import ProtocolError, PtuError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import integer
from ptu_drivers.flir.line import FlirLine
from ptu_drivers.flir.poll import Query, best_query
from ptu_drivers.flir.probe import UnitFacts, probe, set_up
from ptu_drivers.flir.unit import DRAINING_S, FlirUnit
from ptu_drivers.health import FailureReason, HealthCounter
from ptu_drivers.line_lock import PreemptibleLine
from ptu_drivers.settings import UnitSettings
from ptu_drivers.transport import SerialTransport, Transport

BAUDS = (9600, 115200, 57600, 38400, 19200)
SETTABLE_BAUDS = (600, 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
_TRIES = 3
_HOMING_S = 40.0


def open_flir(
    url: str,
    settings: UnitSettings,
    clock: Callable[[], float] = time.monotonic,
    *,
    patience_s: float = 5.0,
    query: str = "auto",
) -> "FlirUnit":
    """Open a unit on a line that pyserial opens, see `open_ptu`.

    Parameters
    ----------
    patience_s : time to search for a unit at all usual speeds, s; one that homes does not reply for up to 40 s.
    query : "auto", or one of `Query`.

    Raises
    ------
    LineError, ProtocolError, MissingPackageError.
    """
    if settings.baud and settings.baud not in SETTABLE_BAUDS:
        raise ProtocolError("baud", got=str(settings.baud), wanted=", ".join(map(str, SETTABLE_BAUDS)))
    if query != "auto" and query not in tuple(Query):
        raise ProtocolError("query", got=query, wanted="auto, " + ", ".join(Query))
    transport = SerialTransport(url, BAUDS[0], clock)
    return connect(transport, settings, patience_s=patience_s, query=query, watch=True)


def connect(
    transport: Transport,
    settings: UnitSettings,
    *,
    patience_s: float = 5.0,
    query: str = "auto",
    watch: bool = False,
) -> "FlirUnit":
    """Find the unit on an open line, set it up, probe it.

    Parameters
    ----------
    watch : run the watchdog in a separate thread; otherwise it is checked only in `read`.
    """
    counter = HealthCounter()
    shared = PreemptibleLine(transport)
    line = FlirLine(shared, counter, settings.reply_timeout_s)
    try:
        facts = _probed(line, settings, patience_s)
        _raise_baud(line, settings.baud)
        type_ahead = _takes_type_ahead(line)
    except ExchangeFailed as failure:
        transport.close()
        raise ProtocolError(transport.url, got=failure.got, wanted="a FLIR unit's answer") from failure
    except PtuError:
        transport.close()
        raise
    unit = FlirUnit(shared, line, settings, facts, counter, watch=watch)
    unit.use_query(best_query(facts) if query == "auto" else Query(query), type_ahead=type_ahead)
    return unit


def _probed(line: FlirLine, settings: UnitSettings, patience_s: float) -> UnitFacts:
    """Find the unit, set it up and probe it; a few attempts, because a busy machine may stand still in any of them.

    Raises
    ------
    ExchangeFailed, ProtocolError : as of the last attempt.
    """
    for _ in range(_TRIES - 1):
        _find(line, settings, patience_s)
        with suppress(ExchangeFailed):
            set_up(line)
            return probe(line)
    _find(line, settings, patience_s)
    set_up(line)
    return probe(line)


def _takes_type_ahead(line: FlirLine) -> bool:
    """Return whether letters sent during a reply leave that reply intact; tested, because it is not documented."""
    try:
        for _ in range(_TRIES):
            for reported in line.query_pair("PP", "TP"):
                integer(reported.answer.text)
    except (ExchangeFailed, ProtocolError):
        # what is not repaired here is repaired by the unit's recovery
        with suppress(ExchangeFailed):
            line.resynchronise(line.transport.now() + line.longest_s())
        return False
    return True


def _find(line: FlirLine, settings: UnitSettings, patience_s: float) -> None:
    """Send a greeting at all speeds until a reply arrives. Raises ProtocolError."""
    transport = line.transport
    bauds: tuple[int, ...] = BAUDS if transport.baud() else (0,)
    if settings.baud and transport.baud():
        bauds = (BAUDS[0], settings.baud, *(b for b in BAUDS[1:] if b != settings.baud))
    end, got = transport.now() + patience_s, "silence"
    while True:
        for baud in bauds:
            transport.set_baud(baud)
            try:
                line.greet(transport.now() + line.longest_s() + DRAINING_S)
            except ExchangeFailed as failure:
                got = "silence" if failure.reason is FailureReason.TIMEOUT else failure.got
            else:
                return
            if transport.now() >= end:
                wanted = f"a FLIR unit's answer within {patience_s:.0f} s"
                if patience_s < _HOMING_S:
                    wanted += f"; one that homes is deaf for up to {_HOMING_S:.0f} s (patience_s)"
                raise ProtocolError(transport.url, got=got, wanted=wanted) from None


def _raise_baud(line: FlirLine, baud: int) -> bool:
    """Raise both ends' speed and confirm it; the old one stays where the unit does not follow."""
    transport = line.transport
    old = transport.baud()
    if not baud or not old or baud == old:
        return False
    if not line.query(f"@({baud},0,F)").answer.ok:
        return False
    for speed in (baud, baud, old, old):
        transport.set_baud(speed)
        with suppress(ExchangeFailed):
            line.resynchronise(transport.now() + line.longest_s())
            return speed == baud
    raise ExchangeFailed(FailureReason.TIMEOUT, f"nothing at {baud} baud, nor at {old} any more")
