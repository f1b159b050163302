"""One HTTP exchange ends when it must, over real sockets: bytes that trickle, answers without end, a halt that waits.

Limits are generous against a busy machine, and far below what each server here would take.
"""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from ptu_drivers.alpaca.http_connection import HttpConnection
from ptu_drivers.errors import LineError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason

LATE_S = 5.0
Serve = Callable[[socket.socket, threading.Event], None]
WHOLE = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"
LONG = b"HTTP/1.1 200 OK\r\nContent-Length: 99999\r\n\r\n" + b" " * 99999


@contextmanager
def serving(serve: Serve) -> Iterator[HttpConnection]:
    """A server that treats each connection in a thread of its own, and a line to it."""
    end = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(0.05)

        def treat(peer: socket.socket) -> None:
            with peer:
                try:
                    serve(peer, end)
                except OSError:
                    # the client did not wait, which is what is tested
                    return

        def accept() -> None:
            while not end.is_set():
                try:
                    peer = listener.accept()[0]
                except TimeoutError:
                    continue
                threading.Thread(target=treat, args=(peer,), daemon=True).start()

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        line = HttpConnection(f"http://127.0.0.1:{listener.getsockname()[1]}")
        line.reopen()
        yield line
        line.close()
        end.set()
        thread.join()


def trickle(data: bytes, apart_s: float = 0.15) -> Serve:
    """Return a server that sends one byte now and then, for half a minute."""

    def serve(peer: socket.socket, end: threading.Event) -> None:
        peer.recv(4096)
        for byte in data * 200:
            peer.sendall(bytes((byte,)))
            if end.wait(apart_s):
                return

    return serve


@pytest.mark.parametrize(
    "data",
    [
        b"H",
        b"HTTP/1.1 200 OK\r\n" + b"X: " * 10,
        b"HTTP/1.1 100 Continue\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 60000\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1\r\nx\r\n",
    ],
    ids=["status", "headers", "continue", "body", "chunks"],
)
@pytest.mark.parametrize("whole_until", [0, 1], ids=["from the start", "after the head"])
def test_a_trickling_reply_ends_with_its_exchange(data: bytes, whole_until: int) -> None:
    head, _, rest = data.partition(b"\r\n\r\n")

    def serve(peer: socket.socket, end: threading.Event) -> None:
        if whole_until and rest:
            peer.sendall(head + b"\r\n\r\n")
            trickle(rest)(peer, end)
        else:
            trickle(data)(peer, end)

    with serving(serve) as line:
        began = line.now()
        with pytest.raises(ExchangeFailed) as caught:
            line.transfer("GET", "/slow", "", began + 0.4)
        assert caught.value.reason is FailureReason.TIMEOUT
        assert 0.3 < line.now() - began < LATE_S


def test_a_reply_without_end_is_cut_off() -> None:
    """Megabytes as fast as they go: neither memory nor time is spent on them."""

    def serve(peer: socket.socket, end: threading.Event) -> None:
        peer.recv(4096)
        while not end.is_set():
            peer.sendall(b"HTTP/1.1 100 Continue\r\n\r\n" * 1000)

    with serving(serve) as line:
        with pytest.raises(ExchangeFailed) as caught:
            line.transfer("GET", "/endless", "", line.now() + 60.0)
        assert caught.value.reason is FailureReason.TRUNCATED
        assert "more than" in caught.value.got


def test_a_halt_waits_for_no_reply_and_uses_a_separate_connection() -> None:
    requests: list[bytes] = []

    def serve(peer: socket.socket, end: threading.Event) -> None:
        requests.append(peer.recv(4096))
        if b"/halt" in requests[-1]:
            peer.sendall(WHOLE)
        else:
            for byte in WHOLE:
                peer.sendall(bytes((byte,)))
                if end.wait(1.0):
                    return

    outcome: list[object] = []
    with serving(serve) as line:

        def read() -> None:
            with line.lock:
                try:
                    line.transfer("GET", "/read", "", line.now() + 60.0)
                except ExchangeFailed as failure:
                    outcome.append(failure.reason)

        reading = threading.Thread(target=read)
        reading.start()
        limit = time.monotonic() + 60.0
        while not requests and time.monotonic() < limit:
            time.sleep(0.01)
        asked = time.monotonic()
        with line.lock.for_halt():
            # the reply to a halt takes its time, too, and is not aborted for it
            assert line.transfer("PUT", "/halt", "", line.now() + 60.0) == (200, b"{}")
        assert time.monotonic() - asked < LATE_S
        reading.join(60.0)
    assert outcome == [FailureReason.PREEMPTED]
    assert [b"/read" in r for r in requests] == [True, False]


def test_connections_are_kept_between_whole_replies_and_dropped_after_others() -> None:
    connections: list[int] = []

    def serve(peer: socket.socket, end: threading.Event) -> None:
        connections.append(0)
        while request := peer.recv(4096):
            connections[-1] += 1
            peer.sendall(
                WHOLE if b"/long" not in request else b"HTTP/1.1 200 OK\r\nContent-Length: 99999\r\n\r\n" + b" " * 99999
            )

    with serving(serve) as line:
        for path in ("/a", "/b", "/long", "/c"):
            status, body = line.transfer("GET", path, "", line.now() + 60.0)
            assert status == 200
            assert len(body) <= 1 << 16
    assert connections == [3, 1]


def test_a_host_that_accepts_no_data_ends_with_its_exchange() -> None:
    """A full backlog: connecting itself would never return."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen(0)
        address = listener.getsockname()
        with socket.socket() as first, socket.socket() as second:
            for peer in (first, second):
                peer.setblocking(False)
                peer.connect_ex(address)
            line = HttpConnection(f"http://127.0.0.1:{address[1]}")
            line.reopen()
            began = line.now()
            with pytest.raises(ExchangeFailed) as caught:
                line.transfer("GET", "/", "", began + 0.3)
            assert caught.value.reason is FailureReason.TIMEOUT
            assert line.now() - began < LATE_S


def test_an_unknown_host_is_named() -> None:
    with pytest.raises(LineError, match=r"http://nowhere.invalid: got .*wanted a host that has an address"):
        HttpConnection("http://nowhere.invalid").reopen()
