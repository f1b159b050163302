"""The reference receiver of a station file: where its positions come from, and from whom they may come."""

import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass

from groundstation.errors import ConfigError
from groundstation.files.toml_table import quoted

Network = ipaddress.IPv4Network
_UDP = re.compile(r"udp://([^:/\s]*):(\d{1,5})")
_LOOPBACK = ipaddress.IPv4Address("127.0.0.1")


@dataclass(frozen=True, slots=True, kw_only=True)
class UdpAddress:
    """Where datagrams are listened for: an address of this machine and a port."""

    host: ipaddress.IPv4Address
    port: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceDevice:
    """A reference receiver on the aircraft, whose positions (NMEA) come to the station by a radio link.

    Attributes
    ----------
    url : a serial port, ``socket://host:port``, or ``udp://[address]:port`` to listen at; without an address, the
        loopback interface.
    baud : of a serial port.
    clock_offset_s : how far its clock is ahead of this machine's; None finds out, if they are seconds apart.
    clock_sigma_s : and how well that is known; None is the tuning's.
    geoid_separation_m : ellipsoid height of sea level, for a receiver that does not tell.
    learn : whether the filter learns from it, or it is kept for comparison only.
    senders : whose datagrams are taken; empty takes those of this machine alone.

    Raises
    ------
    ConfigError : an address that is none, senders of something that is not UDP, or none beyond the loopback interface.
    """

    url: str
    baud: int = 115200
    clock_offset_s: float | None = None
    clock_sigma_s: float | None = None
    geoid_separation_m: float | None = None
    learn: bool = True
    senders: tuple[Network, ...] = ()

    def __post_init__(self) -> None:
        udp = udp_address(self.url)
        if udp is None and self.senders:
            raise ConfigError("senders", got=f"senders for {self.url}", wanted="them with udp:// alone")
        if udp is not None and not udp.host.is_loopback and not self.senders:
            wanted = (
                'senders = ["ADDRESS or NETWORK", …]: whose positions are taken; or udp://:PORT for this machine\'s'
            )
            raise ConfigError("senders", got=f"none for {self.url}, which others reach", wanted=wanted)

    def allows(self, sender: str) -> bool:
        """Return whether datagrams from an address are taken."""
        address = ipaddress.IPv4Address(sender)
        return any(address in network for network in self.senders) if self.senders else address.is_loopback


def udp_address(url: str) -> UdpAddress | None:
    """Return where a URL listens for datagrams; None for a URL of another kind. Raises `ConfigError`."""
    if not url.startswith("udp:"):
        return None
    match = _UDP.fullmatch(url)
    port = int(match[2]) if match else 0
    try:
        host = (
            _LOOPBACK if match and match[1] in ("", "localhost") else ipaddress.IPv4Address(match[1] if match else "")
        )
    except ipaddress.AddressValueError:
        port, host = 0, _LOOPBACK
    if not 0 < port < 65_536:
        wanted = "udp://:PORT (this machine alone), or udp://ADDRESS:PORT with an IPv4 address of this machine"
        raise ConfigError("url", got=url, wanted=wanted)
    return UdpAddress(host=host, port=port)


def sender_networks(listed: Sequence[object], where: str) -> tuple[Network, ...]:
    """Return addresses and networks (CIDR) as networks; raises `ConfigError`."""
    found = []
    for one in listed:
        try:
            if not isinstance(one, str):
                raise ValueError
            found.append(Network(one))
        except ValueError as fault:
            raise ConfigError(where, got=quoted(one), wanted='IPv4 addresses or networks, as "192.168.1.20"') from fault
    return tuple(found)
