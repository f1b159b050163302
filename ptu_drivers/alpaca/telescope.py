"""ASCOM Alpaca's requests to one telescope by name, with checked replies."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol
from urllib.parse import urlencode

from ptu_drivers.alpaca.codec import decode, finite
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.line_lock import LockedLine

_CLIENT = 4242
NOT_IMPLEMENTED = 0x400


class HttpLine(LockedLine, Protocol):
    """What carries a request: a connection, or a simulated one."""

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        """Return status and body; the query is in the path of a GET, or in the body of a PUT.

        Raises
        ------
        ExchangeFailed : no complete reply until then, or a halt waits. LineError : no connection.
        """


@dataclass(slots=True)
class AlpacaTelescope:
    """Properties and methods of one telescope by name."""

    line: HttpLine
    device: int = 0
    sent: int = 0
    _transactions: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def get(self, name: str, until_s: float, **parameters: object) -> Any:
        """Return a property. Raises ExchangeFailed, RefusedError, LineError."""
        return self._query("GET", name, parameters, until_s).get("Value")

    def number(self, name: str, until_s: float, **parameters: object) -> float:
        """Return a property that is a finite number. Raises ExchangeFailed, RefusedError, LineError."""
        return finite(name, self.get(name, until_s, **parameters))

    def flag(self, name: str, until_s: float, **parameters: object) -> bool:
        """Return a property that is true or false. Raises ExchangeFailed, RefusedError, LineError."""
        value = self.get(name, until_s, **parameters)
        if not isinstance(value, bool):
            raise ExchangeFailed(FailureReason.GARBAGE, f"{name}: {value!r}")
        return value

    def put(self, name: str, until_s: float, **parameters: object) -> None:
        """Call a method, or set a property. Raises ExchangeFailed, RefusedError, LineError."""
        self._query("PUT", name, parameters, until_s)

    def _query(self, method: str, name: str, parameters: Mapping[str, object], until_s: float) -> dict[str, Any]:
        if method == "GET" and self.line.now() >= until_s:
            # commands still go out: a halt that is late is better than none
            raise ExchangeFailed(FailureReason.TIMEOUT, f"no time left to ask for {name}")
        transaction = next(self._transactions) % 0xFFFFFFFF
        self.sent += 1
        query = urlencode({**parameters, "ClientID": _CLIENT, "ClientTransactionID": transaction})
        path = f"/api/v1/telescope/{self.device}/{name}"
        status, body = self.line.transfer(method, path, query, until_s)
        return decode(name, status, body, transaction)
