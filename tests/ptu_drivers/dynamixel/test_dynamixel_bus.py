"""The line as the servo maker's packet handler sees it: times out from the start, and counts what was not taken."""

from ptu_drivers.dynamixel.bus import SdkPort
from ptu_drivers.transport import Chunk


class Line:
    """A line with bytes that are there, and a clock that stands."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.reads = 0

    def now(self) -> float:
        return 0.5

    def read(self, until_s: float) -> Chunk:
        self.reads += 1
        data, self.data = self.data, b""
        return Chunk(data=data, t_s=0.5)


def test_there_is_no_wait_before_a_query() -> None:
    line = Line(b"abc")
    port = SdkPort(line, reply_timeout_s=0.1)
    assert port.isPacketTimeout()
    assert port.readPort(3) == b""
    assert line.reads == 0


def test_bytes_that_were_not_taken_are_counted() -> None:
    port = SdkPort(Line(b"abcde"), reply_timeout_s=0.1)
    port.setPacketTimeoutMillis(100.0)
    assert port.readPort(2) == b"ab"
    assert port.leftover() == 3
    assert port.readPort(3) == b"cde"
    assert port.leftover() == 0
