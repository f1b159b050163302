"""ASCOM Alpaca's HTTP requests to one telescope: a connection, and answers that are checked."""

import http.client
import itertools
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol
from urllib.parse import urlencode, urlsplit

from ptu_drivers.alpaca_codec import decode, finite
from ptu_drivers.doubtful import Doubtful
from ptu_drivers.errors import LineError, ProtocolError
from ptu_drivers.health import DoubtReason
from ptu_drivers.polled_unit import Line

_DEFAULT_PORT = 11111
_LONGEST = 1 << 16
_CLIENT = 4242
NOT_IMPLEMENTED = 0x400
# what a command gets that goes out when its call's time is over
LEAST_S = 0.01


class HttpLine(Line, Protocol):
    """What carries a request: a connection, or a simulated one."""

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        """Return status and body; the query goes behind the path of a GET, into the body of a PUT.

        Raises
        ------
        Doubtful : no whole answer until then. LineError : nobody is there.
        """


class HttpConnection:
    """A connection that is kept open between requests.

    After a request without an answer it is closed: a late answer then has nowhere to arrive, so that none can be taken
    for the answer to the next request.
    """

    def __init__(self, url: str, clock: Callable[[], float] = time.monotonic) -> None:
        try:
            parts = urlsplit(url)
            port = parts.port or _DEFAULT_PORT
        except ValueError as wrong:
            raise ProtocolError("Alpaca address", got=url, wanted="http://host:port") from wrong
        if parts.scheme != "http" or not parts.hostname:
            raise ProtocolError("Alpaca address", got=url, wanted="http://host:port")
        self.url = url
        self._host, self._port = parts.hostname, port
        self._clock = clock
        self._connection: http.client.HTTPConnection | None = None

    def now(self) -> float:
        """Return the clock, s."""
        return self._clock()

    def wait(self, duration_s: float) -> None:
        """Sleep."""
        time.sleep(max(0.0, duration_s))

    def reopen(self) -> None:
        """Forget the old connection; the next request makes a new one."""
        self.close()
        self._connection = http.client.HTTPConnection(self._host, self._port)

    def close(self) -> None:
        """Close."""
        if self._connection is not None:
            self._connection.close()

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        """Send a request and return status and body."""
        if self._connection is None:
            raise LineError(self.url, got="a closed line", wanted="an open one")
        left_s = max(LEAST_S, until_s - self.now())
        self._connection.timeout = left_s
        try:
            if self._connection.sock is not None:
                self._connection.sock.settimeout(left_s)
            if method == "GET":
                self._connection.request(method, f"{path}?{query}")
            else:
                form = {"Content-Type": "application/x-www-form-urlencoded"}
                self._connection.request(method, path, body=query, headers=form)
            answer = self._connection.getresponse()
            return answer.status, answer.read(_LONGEST)
        except TimeoutError as late:
            self._connection.close()
            raise Doubtful(DoubtReason.TIMEOUT, f"no answer to {path}") from late
        except http.client.HTTPException as broken:
            self._connection.close()
            # an idle connection that the server closed shows only when it is used
            raise Doubtful(DoubtReason.TRUNCATED, str(broken) or type(broken).__name__) from broken
        except OSError as gone:
            self._connection.close()
            raise LineError(self.url, got=str(gone) or type(gone).__name__, wanted="an Alpaca server") from gone


@dataclass(slots=True)
class AlpacaTelescope:
    """Properties and methods of one telescope by name."""

    line: HttpLine
    device: int = 0
    sent: int = 0
    _transactions: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def get(self, name: str, until_s: float, **parameters: object) -> Any:
        """Return a property. Raises Doubtful, RefusedError, LineError."""
        return self._ask("GET", name, parameters, until_s).get("Value")

    def number(self, name: str, until_s: float, **parameters: object) -> float:
        """Return a property that is a finite number. Raises Doubtful, RefusedError, LineError."""
        return finite(name, self.get(name, until_s, **parameters))

    def flag(self, name: str, until_s: float, **parameters: object) -> bool:
        """Return a property that is true or false. Raises Doubtful, RefusedError, LineError."""
        value = self.get(name, until_s, **parameters)
        if not isinstance(value, bool):
            raise Doubtful(DoubtReason.GARBAGE, f"{name}: {value!r}")
        return value

    def put(self, name: str, until_s: float, **parameters: object) -> None:
        """Call a method, or set a property. Raises Doubtful, RefusedError, LineError."""
        self._ask("PUT", name, parameters, until_s)

    def _ask(self, method: str, name: str, parameters: Mapping[str, object], until_s: float) -> dict[str, Any]:
        if method == "GET" and self.line.now() >= until_s:
            # commands still go out: a halt that is late is better than none
            raise Doubtful(DoubtReason.TIMEOUT, f"no time left to ask for {name}")
        transaction = next(self._transactions) % 0xFFFFFFFF
        self.sent += 1
        query = urlencode({**parameters, "ClientID": _CLIENT, "ClientTransactionID": transaction})
        path = f"/api/v1/telescope/{self.device}/{name}"
        status, body = self.line.transfer(method, path, query, until_s)
        return decode(name, status, body, transaction)
