"""JSON lines over UDP: one datagram, one object, one line (docs/autopilot.md)."""

import json
import math
import re
import socket
from collections.abc import Mapping
from typing import Any

from groundstation.errors import ConfigError, os_words

_ADDRESS = re.compile(r"(?:udp:(?://)?)?(?:\[([0-9a-fA-F:]+)\]|([^:/\s\[\]]+)):(\d{1,5})")


def parse_udp_address(text: str) -> tuple[str, int]:
    """Return host and port of an address. Raises `ConfigError` for a text that is none."""
    match = _ADDRESS.fullmatch(text)
    if match is None or not 0 < int(match[3]) < 65_536:
        raise ConfigError("--udp", got=repr(text), wanted="HOST:PORT, the port from 1 to 65535")
    return match[1] or match[2], int(match[3])


class UdpJsonSender:
    """Sends objects to an address, ``HOST:PORT``; never waits: what the network does not take is dropped and counted.

    Raises `ConfigError` for an address that is none or is not known.
    """

    def __init__(self, address: str) -> None:
        host, port = parse_udp_address(address)
        try:
            family, kind, protocol, _, to = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
        except OSError as fault:
            raise ConfigError(
                "--udp", got=f"{address!r}: {os_words(fault)}", wanted="an address that is known"
            ) from fault
        self._to: Any = to
        self._socket.setblocking(False)
        self.sent = 0
        self.dropped = 0

    def send(self, values: Mapping[str, object]) -> None:
        """Send one object; a number that is not finite, which JSON does not have, becomes null."""
        data = json.dumps(_finite(values), allow_nan=False, separators=(",", ":")).encode() + b"\n"
        try:
            self._socket.sendto(data, self._to)
        except OSError:
            self.dropped += 1
        else:
            self.sent += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _finite(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(v) for key, v in value.items()}
    return [_finite(v) for v in value] if isinstance(value, list | tuple) else value
