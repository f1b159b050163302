"""The URL of a link to a vehicle, as MAVProxy and MAVSDK users write it."""

import ipaddress
import re
from dataclasses import dataclass

from groundstation.errors import ConfigError

_UDP_OUT = re.compile(r"udpout:(?://)?([^:/\s]+):(\d{1,5})")
_UDP_IN = re.compile(r"udp(?:in)?:(?://)?(?:([^:/\s]*):)?(\d{1,5})")
_TCP = re.compile(r"tcp(?:out)?:(?://)?([^:/\s]+):(\d{1,5})")
_SERIAL = re.compile(r"(?:serial:(?://)?)?(/dev/[^\s:]+)(?::(\d{3,7}))?")
_WANTED = (
    "udpout:HOST:PORT (send to), udpin:[HOST:]PORT (listen; 127.0.0.1 unless stated), tcp:HOST:PORT or "
    "/dev/SERIAL[:BAUD]"
)
_BAUD = 57_600
_NUMBERS = re.compile(r"[\d.]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkUrl:
    """A parsed URL: ``device`` as pymavlink's ``mavlink_connection`` takes it, ``baud`` of a serial port."""

    text: str
    device: str
    baud: int = _BAUD


def parse_link_url(text: str) -> LinkUrl:
    """Return the link of a URL; raises `ConfigError`. A listener without a host listens at the loopback interface."""
    if match := _UDP_OUT.fullmatch(text):
        return LinkUrl(text=text, device=f"udpout:{_host(text, match[1])}:{_port(text, match[2])}")
    if match := _UDP_IN.fullmatch(text):
        return LinkUrl(text=text, device=f"udpin:{_host(text, match[1] or '127.0.0.1')}:{_port(text, match[2])}")
    if match := _TCP.fullmatch(text):
        return LinkUrl(text=text, device=f"tcp:{_host(text, match[1])}:{_port(text, match[2])}")
    if match := _SERIAL.fullmatch(text):
        return LinkUrl(text=text, device=match[1], baud=int(match[2] or _BAUD))
    raise ConfigError("autopilot URL", got=repr(text), wanted=_WANTED)


def _host(text: str, host: str) -> str:
    """Return a host; pymavlink would send to one that cannot be, as 192.168.0.256, without a word."""
    if _NUMBERS.fullmatch(host):
        try:
            ipaddress.IPv4Address(host)
        except ValueError as fault:
            raise ConfigError(
                "autopilot URL", got=repr(text), wanted="four numbers from 0 to 255, or a name"
            ) from fault
    return host


def _port(text: str, port: str) -> int:
    if not 0 < int(port) < 65_536:
        raise ConfigError("autopilot URL", got=repr(text), wanted="a port from 1 to 65535")
    return int(port)
