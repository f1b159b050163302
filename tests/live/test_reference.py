"""A reference receiver in operation: its sentences become positions in the runway frame, or a reason."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import ConfigError, LogError
from groundstation.live.check_reference import check_reference
from groundstation.live.head_device import DeviceError
from groundstation.live.input_queue import DeviceLogLine, InputQueue, Item
from groundstation.live.reference_device import ReferenceDevice, sender_networks
from groundstation.live.reference_fixes import ReferenceClock, ReferenceConverter, Refusal
from groundstation.live.reference_line import open_reference_line
from groundstation.live.reference_table import DgpsTable
from groundstation.live.reference_worker import ReferenceWorker
from groundstation.messages import DgpsFix, ReferenceFix
from groundstation.session.logs.fixes import LogFix, LogOptions
from groundstation.session.logs.gps_time import TimeScale, civil_from_unix, gps_from_civil
from groundstation.session.logs.nmea_stream import NmeaStream
from groundstation.session.logs.read import read_log
from groundstation.simulation.simulated_receiver import SIMULATED_ORIGIN, ReceiverModel, SimulatedReceiver, sentences
from tests.complaints import complaint
from tests.session.logs.writers import UNIX_S, flight, gga, gst, rmc

SIGMA_M = (0.015, 0.02, 0.03)
ZERO_UTC_S = 1_700_000_000.0
GPS_ZERO_S = gps_from_civil(*civil_from_unix(ZERO_UTC_S), TimeScale.UTC)


def place_at(t_s: float) -> np.ndarray:
    return np.array([3.0 + 0.1 * t_s, 400.0 - 20.0 * t_s, 30.0 - t_s])


def said_at(t_s: float, clock_offset_s: float = 0.0) -> bytes:
    return sentences(ZERO_UTC_S + t_s + clock_offset_s, place_at(t_s), SIMULATED_ORIGIN, SIGMA_M)


def stream() -> NmeaStream:
    return NmeaStream("DGPS", LogOptions())


def fixes_of(data: bytes) -> list[LogFix]:
    return stream().feed(data, ZERO_UTC_S)


# --------------------------------------------------------------------------------------- sentences
@given(cuts=st.lists(st.integers(1, 400), max_size=30), sigmas=st.booleans())
def test_however_a_line_is_cut_its_positions_are_those_of_the_log(
    cuts: list[int], sigmas: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = b"".join(rmc(p) + gga(p) + (gst(p, 0.01, 0.02, 0.03) if sigmas else b"") for p in flight(6))
    path = tmp_path_factory.mktemp("nmea") / "log.nmea"
    path.write_bytes(data)
    log = read_log(path)
    listener, found = stream(), list[LogFix]()
    ends = sorted({min(sum(cuts[: k + 1]), len(data)) for k in range(len(cuts))} | {len(data)})
    for begin, end in zip([0, *ends], ends, strict=False):
        found += listener.feed(data[begin:end], UNIX_S)
    found += listener.quiet(UNIX_S)
    assert [gps_from_civil(f.day, f.second, f.scale) for f in found] == list(log.gps_s)
    assert [f.lat_deg for f in found] == list(log.lat_deg)
    assert [f.height_m for f in found] == list(log.height_m)
    assert all((f.sigma_enu_m is not None) is sigmas for f in found)


@given(noise=st.binary(max_size=3000))
def test_noise_before_a_sentence_costs_no_more_than_that_one(noise: bytes) -> None:
    listener = stream()
    listener.feed(noise, UNIX_S)
    first, second = (gga(p) for p in flight(2))
    found = listener.feed(b"\r\n" + first + second, UNIX_S) + listener.quiet(UNIX_S)
    assert [f.second for f in found][-1] == pytest.approx(43192.2)


@pytest.mark.parametrize("off_s", [-20_000.0, 0.0, 20_000.0])
def test_without_a_date_it_is_the_listeners(off_s: float) -> None:
    listener = stream()
    assert listener.feed(gga(flight(1)[0]), UNIX_S + off_s) == []
    (fix,) = listener.quiet(UNIX_S + off_s)
    assert gps_from_civil(fix.day, fix.second, fix.scale) == gps_from_civil(*civil_from_unix(UNIX_S), TimeScale.UTC)


def test_unexplained_heights_are_reported_and_the_line_continues() -> None:
    listener = stream()
    reported = complaint(LogError, lambda: listener.feed(gga(flight(1)[0], separation=""), UNIX_S))
    assert "geoid separation" in reported
    listener.feed(gga(flight(1)[0]), UNIX_S)
    assert len(listener.quiet(UNIX_S)) == 1


# ---------------------------------------------------------------------------------------- conversion
def converter_of(
    offset_s: float | None = None, antenna: tuple[float, float, float] | None = None
) -> ReferenceConverter:
    lever = None if antenna is None else np.array(antenna)
    return ReferenceConverter(SIMULATED_ORIGIN, ReferenceClock(GPS_ZERO_S, offset_s), lever)


def test_a_position_is_where_and_when_it_was_true() -> None:
    (fix,) = fixes_of(said_at(4.0))
    placed = converter_of().convert(fix, 4.1)
    assert placed.nose is not None
    assert placed.antenna is not None
    assert placed.nose.t_s == pytest.approx(4.0, abs=1e-6)
    np.testing.assert_allclose(placed.nose.position_runway_m, place_at(4.0), atol=3e-4)
    assert placed.antenna.status == "fix"
    # sigmas are in east, north, up, and +y points to 35°
    c, s = np.cos(np.radians(35.0)), np.sin(np.radians(35.0))
    level = np.hypot([c * SIGMA_M[0], s * SIGMA_M[0]], [s * SIGMA_M[1], c * SIGMA_M[1]])
    np.testing.assert_allclose(placed.nose.sigma_m, [*level, SIGMA_M[2]], atol=1e-6)


def test_the_antenna_is_taken_to_the_nose_along_the_flight() -> None:
    converter = converter_of(antenna=(-1.0, 0.2, -0.1))
    placed = [converter.convert(fixes_of(said_at(0.2 * k))[0], 0.2 * k + 0.1) for k in range(6)]
    assert placed[0].refusal is Refusal.NO_HEADING
    nose = placed[-1].nose
    assert nose is not None
    forward = np.array([0.1, -20.0, -1.0]) / np.linalg.norm([0.1, -20.0, -1.0])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    np.testing.assert_allclose(nose.position_runway_m, place_at(1.0) + forward - 0.2 * right + 0.1 * down, atol=2e-3)


def test_a_clock_that_is_off_is_found_out_unless_it_is_given() -> None:
    found = converter_of()
    placed = [found.convert(fixes_of(said_at(0.2 * k, 37.0))[0], 0.2 * k + 0.15) for k in range(8)]
    assert [p.refusal for p in placed[:4]] == [Refusal.CLOCK] * 4
    assert all(p.nose is not None for p in placed[4:])
    assert found.clock.adopted == 1
    # they come 0.15 s late, and are taken to come 0.1 s late
    assert found.clock.offset_s == pytest.approx(36.95, abs=1e-6)
    given_as_right = converter_of(0.0)
    for k in range(30):
        placed_by_it = given_as_right.convert(fixes_of(said_at(0.2 * k, 37.0))[0], 0.2 * k)
        assert placed_by_it.refusal is Refusal.CLOCK
    right = converter_of(37.0).convert(fixes_of(said_at(1.0, 37.0))[0], 1.1)
    assert right.nose is not None
    assert right.nose.t_s == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
def test_a_clock_that_steps_and_returns_is_right_again(rate_hz: float) -> None:
    """Ahead by 1.5 s for eight seconds: the way back is a step, too, and no delay of 1.5 s."""
    converter, late_s = converter_of(), 0.12
    off_s = list[float]()
    for k in range(int(24 * rate_hz)):
        t_s = k / rate_hz
        stepped_s = 1.5 if 4.0 <= t_s < 12.0 else 0.0
        placed = converter.convert(fixes_of(said_at(t_s, stepped_s))[0], t_s + late_s)
        if placed.antenna is not None:
            off_s.append(placed.antenna.t_s - t_s)
        else:
            assert placed.refusal is Refusal.CLOCK
    assert converter.clock.adopted == 2
    assert converter.clock.offset_s == 0.0
    # four are refused each time; what is adopted by arrival is off by what the usual delivery is off
    assert len(off_s) == int(24 * rate_hz) - 8
    assert max(abs(v) for v in off_s) < 0.03
    assert abs(off_s[-1]) < 1e-6


def test_a_link_that_gets_slow_is_no_step_and_overtaking_is_none_either() -> None:
    converter = converter_of()
    for k in range(60):
        # first at once, then 1.4 s late, as if a buffer had filled
        arrived_s = 0.2 * k + 0.1 if k < 20 else 0.2 * k + 1.5
        placed = converter.convert(fixes_of(said_at(0.2 * k))[0], arrived_s)
        assert placed.antenna is not None
        assert placed.antenna.t_s == pytest.approx(0.2 * k, abs=1e-6)
    order = [60, 62, 61, *range(63, 80)]
    refused = [converter.convert(fixes_of(said_at(0.2 * k))[0], 0.2 * max(k, 62) + 1.5).refusal for k in order]
    assert refused.count(None) == len(order) - 1
    assert converter.clock.adopted == 0


def test_a_step_back_under_a_given_offset_is_refused_until_it_is_over() -> None:
    converter, refused = converter_of(0.0), list[Refusal | None]()
    for k in range(60):
        stepped_s = -1.5 if 20 <= k < 40 else 0.0
        refused.append(converter.convert(fixes_of(said_at(0.2 * k, stepped_s))[0], 0.2 * k + 0.1).refusal)
    assert refused == [None] * 20 + [Refusal.CLOCK] * 20 + [None] * 20


def test_what_is_no_new_position_is_named() -> None:
    converter = converter_of()
    (fix,) = fixes_of(said_at(1.0))
    assert converter.convert(fix, 1.1).refusal is None
    assert converter.convert(fix, 1.1).refusal is Refusal.BACKWARDS
    later = replace(fix, second=fix.second + 0.2)
    assert converter.convert(later, 1.3).refusal is Refusal.REPEATED
    assert converter.convert(replace(fix, second=fix.second + 0.4, lat_deg=48.0), 1.5).refusal is Refusal.FAR


# ------------------------------------------------------------------------------------------ worker
class Script:
    """A line that delivers a script: bytes, or a fault; after that nothing."""

    def __init__(self) -> None:
        self.waiting: list[bytes | DeviceError] = []
        self.opened = 0
        self.refused, self.refused_sender, self._strange = 0, "", 0

    def open(self, device: ReferenceDevice) -> "Script":
        self.opened += 1
        return self

    def refuse(self, count: int) -> None:
        """Deliver so many datagrams of a refused sender with the next read."""
        self._strange += count

    def read(self, timeout_s: float) -> bytes:
        if self._strange:
            self.refused, self.refused_sender = self.refused + self._strange, "10.9.8.7"
            self._strange = 0
        if not self.waiting:
            time.sleep(0.001)
            return b""
        what = self.waiting.pop(0)
        if isinstance(what, DeviceError):
            raise what
        return what

    def close(self) -> None:
        pass


class Now:
    """A clock that stands until it is set."""

    def __init__(self) -> None:
        self.s = 0.0

    def __call__(self) -> float:
        return self.s


def wait_for(condition: Callable[[], object], seconds: float = 20.0) -> None:
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "it did not happen"
        time.sleep(0.002)


def drained(input_queue: InputQueue) -> list[Item]:
    items = []
    while (item := input_queue.get(0.0)) is not None:
        items.append(item)
    return items


@contextmanager
def listening(
    script: Script, now: Now, input_queue: InputQueue, table: DgpsTable | None = None, *, learn: bool = True
) -> Iterator[ReferenceWorker]:
    device = ReferenceDevice(url="scripted", learn=learn)
    worker = ReferenceWorker(
        device,
        converter_of(),
        input_queue,
        table,
        start_s=0.0,
        clock=now,
        utc=lambda: ZERO_UTC_S + now.s,
        connect=script.open,
    )
    worker.start()
    try:
        yield worker
    finally:
        worker.stop()


def test_loss_and_return_of_the_receiver_are_reported(tmp_path: Path) -> None:
    now, input_queue, faults = Now(), InputQueue(), list[str]()
    script, table = Script(), DgpsTable(tmp_path / "dgps.csv", faults)
    with listening(script, now, input_queue, table) as worker:
        assert worker.state(0.0, 0.0).summary() == "DGPS: no position yet"
        for k in range(5):
            now.s = 0.2 * k + 0.1
            script.waiting.append(said_at(0.2 * k))
            wait_for(lambda k=k: worker.fixes == k + 1)
        assert worker.state(1.1, 5.0).summary() == "DGPS: 5 fixes, 0.2 s old, fix"
        assert worker.state(1.1, 5.0, 3).summary() == "DGPS: 5 fixes, 0.2 s old, fix, 3 refused by the filter"
        # nothing for long, and the line is lost, too
        now.s = 4.0
        script.waiting.append(DeviceError("scripted: got end of file; wanted a line that is there"))
        wait_for(lambda: script.opened == 2)
        assert worker.state(4.0, 0.0).summary() == "DGPS: gone since 0.9 s, after 5 fixes, fix"
        script.waiting.append(said_at(3.9))
        wait_for(lambda: worker.fixes == 6)
        assert worker.state(4.0, 5.0).summary() == "DGPS: 6 fixes, 0.0 s old, fix"
    items = drained(input_queue)
    assert [round(i.t_s, 3) for i in items if isinstance(i, ReferenceFix)] == [0.0, 0.2, 0.4, 0.6, 0.8, 3.9]
    reported = [(i.level, i.text) for i in items if isinstance(i, DeviceLogLine)]
    assert ("warning", "DGPS: gone: no position that can be used since 0.9 s") in reported
    assert ("warning", "DGPS: scripted: got end of file; wanted a line that is there; it is tried again") in reported
    assert reported[-1] == ("info", "DGPS: there again")
    content = table.close()
    assert content is not None
    rows = content.decode().splitlines()
    assert rows[0] == "t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,status"
    assert len(rows) == 7
    assert [float(c) for c in rows[-1].split(",")[:4]] == pytest.approx([3.9, *place_at(3.9)], abs=3e-4)
    assert faults == []


def test_for_comparison_only_nothing_is_estimated_from_it() -> None:
    now, input_queue, script = Now(), InputQueue(), Script()
    with listening(script, now, input_queue, learn=False) as worker:
        now.s = 0.1
        script.waiting.append(said_at(0.0))
        wait_for(lambda: worker.fixes == 1)
        assert worker.state(0.2, 5.0).summary() == "DGPS: 1 fixes, 0.1 s old, fix, not learnt"
    assert not [i for i in drained(input_queue) if isinstance(i, ReferenceFix)]


def test_a_table_refused_by_the_disk_ends_alone(tmp_path: Path) -> None:
    faults = list[str]()
    table = DgpsTable(tmp_path / "no folder" / "dgps.csv", faults)
    fix = DgpsFix(t_s=1.0, position_runway_m=np.zeros(3), sigma_m=np.ones(3), status="fix")
    table.write(fix)
    table.write(fix)
    assert faults == ["dgps.csv ends here: No such file or directory"]
    assert table.close() is None


# ------------------------------------------------------------------------------------------- lines
def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def send(port: int, data: bytes, source: str = "127.0.0.1") -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, 0))
        sender.sendto(data, ("127.0.0.1", port))


def test_udp_and_tcp_deliver_the_sent_bytes() -> None:
    port = free_port()
    device = ReferenceDevice(url=f"udp://127.0.0.1:{port}")
    line = open_reference_line(device)
    assert line.read(0.01) == b""
    send(port, b"$GPGGA")
    assert line.read(5.0) == b"$GPGGA"
    assert "in use" in complaint(DeviceError, lambda: open_reference_line(device))
    line.close()
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = open_reference_line(ReferenceDevice(url=f"socket://127.0.0.1:{server.getsockname()[1]}"))
        peer, _ = server.accept()
        peer.sendall(b"$GPRMC")
        assert line.read(5.0) == b"$GPRMC"
        peer.close()
        assert "closed" in complaint(DeviceError, lambda: line.read(5.0))
        line.close()


def test_without_an_address_it_listens_to_this_machine_alone() -> None:
    """Expected: bound to 127.0.0.1, so another socket may have the same port on another address of this machine."""
    port = free_port()
    line = open_reference_line(ReferenceDevice(url=f"udp://:{port}"))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        # all interfaces were taken: this one could not be bound
        other.bind(("127.0.0.2", port))
        other.sendto(b"$GPGGA", ("127.0.0.1", port))
    assert line.read(5.0) == b"$GPGGA"
    line.close()


def test_datagrams_of_others_are_counted_and_not_read() -> None:
    port = free_port()
    device = ReferenceDevice(url=f"udp://0.0.0.0:{port}", senders=sender_networks(["127.0.0.8/30"], "test"))
    line = open_reference_line(device)
    for _ in range(3):
        send(port, b"$GPGGA of a stranger", "127.0.0.7")
    send(port, b"$GPGGA", "127.0.0.9")
    assert line.read(5.0) == b"$GPGGA"
    assert (line.refused, line.refused_sender) == (3, "127.0.0.7")
    send(port, b"$GPGGA of a stranger", "127.0.0.12")
    assert line.read(0.2) == b""
    assert (line.refused, line.refused_sender) == (4, "127.0.0.12")
    line.close()


@pytest.mark.parametrize("url", ["udp://nowhere", "udp://:0", "udp://:65536", "udp://256.0.0.1:5000", "udp://a.b:5000"])
def test_an_address_that_is_none_is_refused(url: str) -> None:
    assert "wanted udp://:PORT" in complaint(ConfigError, lambda: ReferenceDevice(url=url))


def test_beyond_this_machine_its_senders_have_to_be_named() -> None:
    reported = complaint(ConfigError, lambda: ReferenceDevice(url="udp://0.0.0.0:5000"))
    assert "got none for udp://0.0.0.0:5000, which others reach" in reported
    assert "wanted senders" in reported
    senders = sender_networks(["192.168.1.20", "10.1.0.0/16"], "test")
    device = ReferenceDevice(url="udp://192.168.1.5:5000", senders=senders)
    allowed = [device.allows(a) for a in ("192.168.1.20", "192.168.1.21", "10.1.255.3", "10.2.0.1", "127.0.0.1")]
    assert allowed == [True, False, True, False, False]
    assert "got senders for /dev/ttyUSB2" in complaint(
        ConfigError, lambda: ReferenceDevice(url="/dev/ttyUSB2", senders=senders)
    )
    for wrong in ("192.168.1", "192.168.1.20/8", "::1", "", 7):
        assert "wanted IPv4 addresses" in complaint(ConfigError, lambda w=wrong: sender_networks([w], "test"))


def test_refused_senders_are_reported_periodically() -> None:
    now, input_queue, script = Now(), InputQueue(), Script()
    with listening(script, now, input_queue) as worker:
        for k in range(40):
            now.s = 0.1 * k
            script.refuse(3)
            wait_for(lambda k=k: worker.state(now.s, 0.0).note == f"{3 * (k + 1)} datagrams of others refused")
    reported = [i.text for i in drained(input_queue) if isinstance(i, DeviceLogLine) and "sender" in i.text]
    assert reported == ["DGPS: 10.9.8.7 is not among its senders: datagrams refused"]


def test_a_clock_stepped_back_only_within_the_limits_of_overtaking() -> None:
    for offset_s, adopted_s in ((0.29, 0.0), (-0.29, 0.0), (0.3, 0.3), (-0.3, -0.3), (5.0, 5.0)):
        clock = ReferenceClock(0.0, None)
        clock._adopt(offset_s)
        assert clock.offset_s == adopted_s
        assert clock.adopted == 1


def test_a_closed_tcp_line_is_closed_for_the_other_side_too() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = open_reference_line(ReferenceDevice(url=f"socket://127.0.0.1:{server.getsockname()[1]}"))
        peer, _ = server.accept()
        peer.settimeout(60.0)
        line.close()
        assert peer.recv(1) == b""
        peer.close()


class Flown:
    """`place_at`, from an instant of the host's clock on."""

    span_s = (-1e9, 1e9)

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s

    def position(self, t_s: np.ndarray) -> np.ndarray:
        return np.array([place_at(float(t) - self._start_s) for t in t_s])

    def velocity(self, t_s: np.ndarray) -> np.ndarray:
        return np.tile([0.1, -20.0, -1.0], (len(t_s), 1))


@contextmanager
def receiver(link: Path, model: ReceiverModel) -> Iterator[str]:
    start_s, stop = time.monotonic(), threading.Event()
    simulated = SimulatedReceiver(link, model, Flown(start_s), lambda: start_s, 1)
    thread = threading.Thread(target=simulated.run, args=(stop,), daemon=True)
    thread.start()
    try:
        wait_for(link.exists)
        yield str(link)
    finally:
        stop.set()
        thread.join(5.0)


def test_check_describes_a_receiver_in_a_line(tmp_path: Path) -> None:
    with receiver(tmp_path / "dgps", ReceiverModel(rate_hz=10.0)) as url:
        line = check_reference(ReferenceDevice(url=url), SIMULATED_ORIGIN, 1.5)
    assert line.good, line.text
    assert line.text.startswith("DGPS: ")
    assert "fix, ± 0.02 m level" in line.text
    assert "m from the origin" in line.text
    with receiver(tmp_path / "dgps", ReceiverModel(rate_hz=10.0, clock_offset_s=100.0)) as url:
        line = check_reference(ReferenceDevice(url=url), SIMULATED_ORIGIN, 1.5)
    assert not line.good
    assert "its clock is +" in line.text
    with receiver(tmp_path / "dgps", ReceiverModel(gone_s=((-1.0, 1e9),))) as url:
        line = check_reference(ReferenceDevice(url=url), SIMULATED_ORIGIN, 0.3)
    assert not line.good
    assert "no data in" in line.text
    line = check_reference(ReferenceDevice(url=str(tmp_path / "none")), SIMULATED_ORIGIN, 0.3)
    assert not line.good
    assert "none" in line.text
