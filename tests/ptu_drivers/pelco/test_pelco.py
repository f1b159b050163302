"""Replies that a Pelco unit's driver accepts, and others."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptu_drivers import open_ptu
from ptu_drivers.errors import LimitError, NoAnswerError, ProtocolError, UnsupportedError
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import Axis, NoReading, Reading
from ptu_drivers.pelco.codec import Opcode, PelcoFraming, PelcoMessage, decode, encode, with_word
from ptu_drivers.pelco.unit import PelcoOptions, PelcoUnit, connect_pelco
from ptu_drivers.settings import AxisSettings, UnitSettings
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from tests.ptu_drivers.scripted import ScriptedPeer

D = PelcoFraming.D
STOP = encode(PelcoMessage(address=1, opcode=Opcode.STOP))


def simulated(model: PelcoModel | None = None) -> tuple[SimulatedPelco, VirtualLine]:
    unit = SimulatedPelco(model, seed=11)
    return unit, VirtualLine(unit, unit.baud)


def connect(line: VirtualLine, settings: UnitSettings | None = None, **options: object) -> PelcoUnit:
    chosen = PelcoOptions(**options)  # type: ignore[arg-type]
    return connect_pelco(line, settings or UnitSettings(), chosen, D, watch=False)


class Answers:
    """Pan 100.00 and tilt 5.00 degrees down, unless a test sets other replies to the next queries for pan."""

    def __init__(self) -> None:
        self.next: list[Callable[[bytes], bytes]] = []

    def __call__(self, typed: bytes) -> bytes | None:
        question = decode(typed[-7:])
        if question is None or question.opcode not in (Opcode.QUERY_PAN, Opcode.QUERY_TILT):
            return None
        if question.opcode == Opcode.QUERY_TILT:
            return encode(with_word(1, Opcode.TILT_IS, 500))
        right = encode(with_word(1, Opcode.PAN_IS, 10000))
        return self.next.pop(0)(right) if self.next else right


@pytest.fixture
def scripted() -> tuple[Answers, VirtualLine, ScriptedPeer]:
    answers = Answers()
    peer = ScriptedPeer(answers)
    return answers, VirtualLine(peer, 9600), peer


Scripted = tuple[Answers, VirtualLine, ScriptedPeer]


def inserted(frame: bytes) -> bytes:
    """A byte too many, chosen so that the first seven bytes pass the checksum: FF 01 00 59 27 g 10 .."""
    g = (frame[5] - sum(frame[1:5])) & 0xFF
    wrong = frame[:5] + bytes((g,)) + frame[5:]
    assert decode(wrong[:7]) is not None
    return wrong


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (lambda f: b"", FailureReason.TIMEOUT),
        (lambda f: f[:4], FailureReason.TRUNCATED),
        (lambda f: f[:3] + f[4:], FailureReason.TRUNCATED),
        (lambda f: f[1:], FailureReason.GARBAGE),
        (lambda f: f[:5] + b"\x00" + f[6:], FailureReason.CHECKSUM),
        (inserted, FailureReason.GARBAGE),
        (lambda f: f + b"\x00", FailureReason.GARBAGE),
        (lambda f: encode(with_word(1, Opcode.TILT_IS, 10000)), FailureReason.TIMEOUT),
        (lambda f: encode(with_word(9, Opcode.PAN_IS, 11000)), FailureReason.TIMEOUT),
        (lambda f: encode(with_word(1, Opcode.PAN_IS, 36000)), FailureReason.OUT_OF_RANGE),
        (lambda f: encode(PelcoMessage(address=1, opcode=Opcode.PAN_IS, command_1=1)), FailureReason.TIMEOUT),
    ],
    ids=[
        "none",
        "truncated",
        "lost inside",
        "lost start",
        "wrong byte",
        "byte too many",
        "trailing byte",
        "shifted",
        "another unit",
        "no angle",
        "another command",
    ],
)
def test_a_doubtful_reply_gives_no_angle_and_the_next_read_is_right(
    scripted: Scripted, wrong: Callable[[bytes], bytes], reason: FailureReason
) -> None:
    answers, line, _ = scripted
    unit = connect(line)
    answers.next = [wrong]
    got = unit.read()
    assert isinstance(got, NoReading)
    assert got.reason is reason
    assert unit.health().failures[reason] == 1
    got = unit.read()
    assert isinstance(got, Reading)
    assert math.degrees(got.pan.angle_rad) == pytest.approx(-100.0)
    assert math.degrees(got.tilt.angle_rad) == pytest.approx(-5.0)


@pytest.mark.parametrize("word", [10003, 10100, 12000, 28000])
def test_a_single_wrong_angle_with_valid_bytes_is_not_accepted(scripted: Scripted, word: int) -> None:
    """Two wrong bytes may agree with the checksum; the unit is queried again, and does not confirm it."""
    answers, line, _ = scripted
    unit = connect(line)
    assert isinstance(unit.read(), Reading)
    answers.next = [lambda f: encode(with_word(1, Opcode.PAN_IS, word))]
    got = unit.read()
    if isinstance(got, Reading):
        assert math.degrees(got.pan.angle_rad) == pytest.approx(-100.0)
    else:
        assert got.reason is FailureReason.TOO_FAST
    after = [unit.read() for _ in range(3)][-1]
    assert isinstance(after, Reading)
    assert math.degrees(after.pan.angle_rad) == pytest.approx(-100.0)


def test_bytes_before_the_query_are_not_a_reply(scripted: Scripted) -> None:
    _, line, peer = scripted
    unit = connect(line)
    unit.read()
    stale = encode(with_word(1, Opcode.PAN_IS, 10001))
    peer.say(line.now() + 0.001, stale)
    line.wait(0.02)
    for _ in range(3):
        # and one that comes in while the question still goes out
        peer.say(line.now() + 0.0001, stale)
        got = unit.read()
        if isinstance(got, Reading):
            assert math.degrees(got.pan.angle_rad) == pytest.approx(-100.0)
    assert isinstance(unit.read(), Reading)


def test_a_late_reply_is_not_taken_for_the_next_one() -> None:
    """The unit turns; one reply is 0.3 s late: every angle is consistent with its own stamp."""
    sim, line = simulated(PelcoModel(max_rate_deg_s=30.0))
    unit = connect(line)
    unit.move_to(pan_rad=2.0)
    line.wait(0.5)
    readings = 0
    for i in range(60):
        if i in (5, 20):
            sim.late_s.append(0.3 if i == 5 else 0.22)
        got = unit.read()
        if isinstance(got, Reading):
            readings += 1
            for s in (got.pan, got.tilt):
                error = abs(s.angle_rad - sim.head_rad(s.axis, s.t_s))
                assert error < 5 * math.hypot(s.sigma_rad, math.radians(30) * s.sigma_t_s)
    assert readings > 40
    assert unit.health().failures[FailureReason.TIMEOUT] >= 1


def test_stamps_at_9600_baud() -> None:
    """2 to 8 ms of latency: 1.7 ms rms, and both axes at the line's pace."""
    sim, line = simulated()
    unit = connect(line)
    unit.move_to(pan_rad=2.5, tilt_rad=0.5)
    errors, begun = [], line.now()
    axis = sim.axes[Axis.PAN]
    while line.now() < begun + 1.5:
        got = unit.read()
        assert isinstance(got, Reading)
        rate = math.radians(axis.speed(got.pan.t_s) / 100)
        if abs(rate) > math.radians(30):
            errors.append((got.pan.angle_rad - sim.head_rad(Axis.PAN, got.pan.t_s)) / rate)
    assert len(errors) > 20
    assert math.sqrt(sum(e * e for e in errors) / len(errors)) < 0.0025


def test_own_echo_is_passed_over() -> None:
    sim, line = simulated(PelcoModel(echo=True))
    unit = connect(line)
    assert isinstance(unit.read(), Reading)
    assert not unit.health().failures
    sim.power_cycle(line.now(), 0.1, homing=False)
    assert isinstance(unit.read(), NoReading)


def test_every_way_out_sends_stop() -> None:
    sim, line = simulated()
    line.record = True

    def interrupted() -> None:
        with connect(line) as unit:
            unit.move_to(pan_rad=1.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    line.settle(1.0)
    sent = b"".join(data for _, way, data in line.traffic if way == ">")
    assert sent.endswith(STOP)
    assert sent.count(STOP) == 2
    assert sim.axes[Axis.PAN].speed(line.now()) == 0


def test_a_lost_stop_is_sent_again() -> None:
    sim, line = simulated()
    unit = connect(line)
    unit.move_to(pan_rad=2.0)
    line.wait(0.2)
    line.faults.to_unit_lose = 3
    unit.halt()
    line.settle(1.0)
    assert sim.axes[Axis.PAN].speed(line.now()) == 0
    assert sim.head_rad(Axis.PAN, line.now()) < 1.0


def test_a_unit_that_does_not_report_its_position_is_named() -> None:
    _, line = simulated(PelcoModel(answers=False))
    began = line.now()
    with pytest.raises(ProtocolError, match=r"virtual: got timeout.*51, 53.*address 1 at 9600.*not every Pelco unit"):
        connect(line)
    assert line.now() - began < 5.0


def test_acknowledgements_are_waited_for() -> None:
    _, line = simulated(PelcoModel(acknowledges=False))
    unit = connect(line, acknowledges=True)
    with pytest.raises(NoAnswerError, match="no acknowledgement"):
        unit.move_to(pan_rad=0.1)


def test_speeds_are_no_rates_without_a_table() -> None:
    _, line = simulated()
    unit = connect(line)
    with pytest.raises(UnsupportedError, match="rate"):
        unit.move_at(pan_rad_s=0.1, tilt_rad_s=0)
    with pytest.raises(UnsupportedError, match="speed"):
        unit.move_to(pan_rad=0.1, rate_rad_s=0.1)


def test_a_rate_stops_at_the_limit_and_when_commands_stop() -> None:
    sim, line = simulated()
    soft = UnitSettings(pan=AxisSettings(low_rad=-0.5, high_rad=0.5))
    unit = connect(line, soft, speeds_deg_s=sim.speed_table())

    def on_and_on() -> None:
        for _ in range(60):
            unit.move_at(pan_rad_s=0.5, tilt_rad_s=0.0)
            line.wait(0.05)

    with pytest.raises(LimitError, match=r"pan.*upper limit"):
        on_and_on()
    line.settle(0.5)
    assert 0.3 < sim.head_rad(Axis.PAN, line.now()) < 0.55
    unit.move_at(pan_rad_s=-0.3, tilt_rad_s=0.0)
    line.wait(0.8)
    unit.read()
    line.settle(0.5)
    assert sim.axes[Axis.PAN].speed(line.now()) == 0
    assert unit.health().watchdog_stops == 1


@given(
    st.sampled_from((1, -1)),
    st.sampled_from(("turn", "word")),
    st.sampled_from((10.0, 100.0)),
    st.floats(-179.9, 179.9),
    st.sampled_from(Axis),
)
def test_angles_survive_their_numbers(sign: int, wrap: str, counts: float, angle_deg: float, axis: Axis) -> None:
    options = PelcoOptions(pan_sign=sign, tilt_sign=sign, tilt_wrap=wrap, counts_per_degree=counts)
    back = options.unit_angle(axis, options.word(axis, math.radians(angle_deg)))
    assert back is not None
    assert math.degrees(math.remainder(back - math.radians(angle_deg), 2 * math.pi)) == pytest.approx(
        0, abs=0.5001 / counts
    )


def test_the_numbers_of_a_fielded_client() -> None:
    """Pan clockwise; up is 36000 less a hundredfold, down a hundredfold."""
    options = PelcoOptions()
    assert options.word(Axis.PAN, math.radians(-123.45)) == 12345
    assert options.word(Axis.TILT, math.radians(10.5)) == 36000 - 1050
    assert options.word(Axis.TILT, math.radians(-10.5)) == 1050
    assert options.unit_angle(Axis.TILT, 34950) == pytest.approx(math.radians(10.5))
    assert PelcoOptions(tilt_wrap="word").word(Axis.TILT, math.radians(10.5)) == 0x10000 - 1050


@pytest.mark.parametrize(
    "wrong",
    [
        {"pan_sign": 0},
        {"tilt_wrap": "fold"},
        {"counts_per_degree": 200.0},
        {"pan_low_deg": -181.0},
        {"speeds_deg_s": {64: 1.0}},
        {"max_rate_deg_s": 0.0},
    ],
)
def test_wrong_options_are_named(wrong: dict[str, object]) -> None:
    with pytest.raises(ProtocolError, match=f"{next(iter(wrong))}: got .*wanted"):
        PelcoOptions(**wrong)  # type: ignore[arg-type]


def test_unknown_options_are_named() -> None:
    with pytest.raises(ProtocolError, match="got adress; wanted address"):
        open_ptu("/dev/null", "pelco-d", adress=1)
