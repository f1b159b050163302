"""One HTTP connection with a deadline for the whole exchange: connecting, sending, and all bytes of the reply.

The time-out of a socket applies to a single read: a server that sends single bytes with pauses delays the whole
reply without limit. Here every read has the remaining time of the exchange, and checks for a waiting halt.
"""

import http.client
import os
import select
import socket
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from ptu_drivers.errors import LineError, ProtocolError, os_words
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.line_lock import SLICE_S, LineLock

_DEFAULT_PORT = 11111
# a reply of Alpaca has some hundred bytes
_LONGEST = 1 << 16
# time for a command that is sent after its call's deadline
LEAST_S = 0.01


class _ExchangeSocket(socket.socket):
    """A socket with the deadline of the current exchange, and the limit of its bytes."""

    until_s = 0.0
    left = 0
    clock: Callable[[], float]
    lock: LineLock

    def begin(self, until_s: float) -> None:
        """Begin an exchange."""
        self.until_s, self.left = until_s, 2 * _LONGEST

    def connect_by(self, address: Any, until_s: float) -> None:
        """Connect. Raises TimeoutError, OSError; ExchangeFailed when a halt waits."""
        self.begin(until_s)
        self.setblocking(False)
        self.connect_ex(address)
        while not select.select([], [self], [], self._slice_s())[1]:
            pass
        if code := self.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            raise OSError(code, os.strerror(code))
        self.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def sendall(self, data: Any, flags: int = 0, /) -> None:
        """Send all of it by the end of the exchange."""
        self.settimeout(max(LEAST_S, self.until_s - self.clock()))
        super().sendall(data, flags)

    def recv_into(self, buffer: Any, nbytes: int = 0, flags: int = 0, /) -> int:
        """Receive available data, or wait for them until the end of the exchange."""
        while True:
            self.settimeout(self._slice_s())
            try:
                got = super().recv_into(buffer, nbytes, flags)
            except TimeoutError:
                continue
            self.left -= got
            if self.left < 0:
                raise http.client.HTTPException(f"an answer of more than {2 * _LONGEST} bytes")
            return got

    def _slice_s(self) -> float:
        """Return how long to wait now, s. Raises TimeoutError at the end of the exchange; ExchangeFailed."""
        self.lock.raise_if_preempted()
        left_s = self.until_s - self.clock()
        if left_s <= 0.0:
            raise TimeoutError
        return min(left_s, SLICE_S)


class HttpConnection:
    """A connection that is kept open between requests.

    After a request without a reply it is closed, so that a late reply is discarded and cannot be taken
    for the reply to the next request. A halt during the wait for a reply therefore uses a separate
    connection. The host's name is resolved once, when the line is opened.
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
        self.lock = LineLock()
        self._host, self._port = parts.hostname, port
        self._clock = clock
        self._addresses: list[Any] = []
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
        if not self._addresses:
            try:
                self._addresses = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_STREAM)
            except OSError as unknown:
                raise LineError(self.url, got=os_words(unknown), wanted="a host that has an address") from unknown
        self._connection = http.client.HTTPConnection(self._host, self._port)

    def close(self) -> None:
        """Close."""
        if self._connection is not None:
            self._connection.close()

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        """Send a request and return status and body."""
        if self._connection is None:
            raise LineError(self.url, got="a closed line", wanted="an open one")
        until_s = max(until_s, self.now() + LEAST_S)
        whole = False
        try:
            answer = self._request(self._connection, method, path, query, until_s)
            body = answer.read(_LONGEST)
            whole = answer.isclosed()
            return answer.status, body
        except TimeoutError as late:
            raise ExchangeFailed(FailureReason.TIMEOUT, f"no whole answer to {path}") from late
        except http.client.HTTPException as broken:
            # an idle connection that the server closed shows only when it is used
            raise ExchangeFailed(FailureReason.TRUNCATED, str(broken) or type(broken).__name__) from broken
        except OSError as gone:
            raise LineError(self.url, got=os_words(gone), wanted="an Alpaca server") from gone
        finally:
            if not whole:
                self._connection.close()

    def _request(
        self, connection: http.client.HTTPConnection, method: str, path: str, query: str, until_s: float
    ) -> http.client.HTTPResponse:
        if isinstance(connection.sock, _ExchangeSocket):
            connection.sock.begin(until_s)
        else:
            connection.sock = self._connect(until_s)
        if method == "GET":
            connection.request(method, f"{path}?{query}")
        else:
            form = {"Content-Type": "application/x-www-form-urlencoded"}
            connection.request(method, path, body=query, headers=form)
        return connection.getresponse()

    def _connect(self, until_s: float) -> _ExchangeSocket:
        """Connect to the first address that takes it. Raises TimeoutError, OSError, ExchangeFailed."""
        fault: OSError | None = None
        for family, kind, number, _, address in self._addresses:
            sock = _ExchangeSocket(family, kind, number)
            sock.clock, sock.lock = self._clock, self.lock
            try:
                sock.connect_by(address, until_s)
            except (OSError, ExchangeFailed) as raised:
                sock.close()
                if not isinstance(raised, OSError):
                    raise
                fault = raised
            else:
                return sock
        raise fault or OSError("no address")
