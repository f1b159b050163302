"""A unit by URL and the name of its protocol."""

import time
from collections.abc import Callable, Mapping
from importlib import import_module
from inspect import Parameter, signature
from types import MappingProxyType
from typing import Any

from ptu_drivers.errors import ProtocolError
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.protocol_options import check_options
from ptu_drivers.settings import UnitSettings
from ptu_drivers.watchdog import halt_on_exit

# module:function, imported when asked for: a protocol's own packages are not needed by the others.
# Each function is called as f(url, settings, clock, **options) and returns an opened, probed unit.
PROTOCOLS: Mapping[str, str] = MappingProxyType(
    {
        "flir": "ptu_drivers.flir.setup:open_flir",
        "pelco-d": "ptu_drivers.pelco.unit:open_pelco_d",
        "pelco-p": "ptu_drivers.pelco.unit:open_pelco_p",
        "dynamixel": "ptu_drivers.dynamixel.unit:open_dynamixel",
        "alpaca": "ptu_drivers.alpaca.unit:open_alpaca",
    }
)


def open_ptu(
    url: str,
    protocol: str = "flir",
    settings: UnitSettings | None = None,
    *,
    clock: Callable[[], float] = time.monotonic,
    **options: Any,
) -> PanTiltUnit:
    """Open a unit, probe it, and return it ready; it is halted however the program ends (`halt_on_exit`).

    Parameters
    ----------
    url : `/dev/ttyUSB0`, `socket://host:4000`, `rfc2217://host:port`, a pty; `http://host:11111` for Alpaca.
    protocol : one of `PROTOCOLS`.
    settings : sign, zero, limits and times; the defaults leave limits to the unit.
    clock : monotonic, in s; every instant of the unit is on it.
    options : options of this protocol (addresses, scales), by keyword.

    Raises
    ------
    LineError : the line cannot be opened. ProtocolError : no reply, or one of another protocol;
    an unknown protocol or option. MissingPackageError : a package is not installed.
    """
    if protocol not in PROTOCOLS:
        raise ProtocolError("protocol", got=protocol, wanted="one of " + ", ".join(PROTOCOLS))
    module, function = PROTOCOLS[protocol].split(":")
    try:
        opener = getattr(import_module(module), function)
    except ModuleNotFoundError as missing:
        if missing.name != module:
            raise
        raise ProtocolError("protocol", got=protocol, wanted="one that is part of this version") from missing
    settings = settings or UnitSettings()
    if settings.baud and "://" in url and not url.startswith("rfc2217://"):
        raise ProtocolError(url, got=f"{settings.baud} baud", wanted="no speed: only serial lines have one")
    named = {p.name: p.annotation for p in signature(opener).parameters.values() if p.kind is Parameter.KEYWORD_ONLY}
    if named:
        if unknown := [name for name in options if name not in named]:
            raise ProtocolError("options", got=", ".join(unknown), wanted=f"what {protocol} has: " + ", ".join(named))
        check_options(protocol, options, named)
    unit: PanTiltUnit = opener(url, settings, clock, **options)
    halt_on_exit(unit)
    return unit
