"""Pelco frames: known ones whole, byte by byte and with trailing bytes; round trips; rubbish."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptu_drivers.errors import ProtocolError, PtuError
from ptu_drivers.pelco.codec import (
    Opcode,
    PelcoDecoder,
    PelcoFraming,
    PelcoMessage,
    acknowledgement_of,
    decode,
    encode,
    encode_acknowledgement,
    scan,
    with_word,
)

D, P = PelcoFraming.D, PelcoFraming.P

# framing, bytes, message: sums and exclusive ors worked out by hand; 4B and 4D as a third-party client sends them
KNOWN = [
    (D, "FF 01 00 00 00 00 01", PelcoMessage(address=1, opcode=Opcode.STOP)),
    (D, "FF 01 00 02 20 00 23", PelcoMessage(address=1, opcode=Opcode.RIGHT, data_1=0x20)),
    (D, "FF 02 00 0C 1F 3F 6C", PelcoMessage(address=2, opcode=Opcode.LEFT | Opcode.UP, data_1=0x1F, data_2=0x3F)),
    (D, "FF 01 00 4B 30 39 B5", with_word(1, Opcode.SET_PAN, 12345)),
    (D, "FF 01 00 4D 88 86 5C", with_word(1, Opcode.SET_TILT, 36000 - 1050)),
    (D, "FF 01 00 51 00 00 52", PelcoMessage(address=1, opcode=Opcode.QUERY_PAN)),
    (D, "FF 01 00 53 00 00 54", PelcoMessage(address=1, opcode=Opcode.QUERY_TILT)),
    (D, "FF 01 00 59 30 39 C3", with_word(1, Opcode.PAN_IS, 12345)),
    (D, "FF FF 00 5B 00 FF 59", with_word(255, Opcode.TILT_IS, 255)),
    (P, "A0 00 00 51 00 00 AF 5E", PelcoMessage(address=1, opcode=Opcode.QUERY_PAN)),
    (P, "A0 00 00 59 30 39 AF 5F", with_word(1, Opcode.PAN_IS, 12345)),
    (P, "A0 06 00 00 00 00 AF 09", PelcoMessage(address=7, opcode=Opcode.STOP)),
]

messages = st.builds(
    PelcoMessage,
    address=st.integers(1, 32),
    opcode=st.integers(0, 255),
    data_1=st.integers(0, 255),
    data_2=st.integers(0, 255),
    command_1=st.integers(0, 255),
)


@pytest.mark.parametrize(("framing", "text", "message"), KNOWN)
class TestKnownFrames:
    def test_whole(self, framing: PelcoFraming, text: str, message: PelcoMessage) -> None:
        frame = bytes.fromhex(text)
        assert encode(message, framing) == frame
        assert decode(frame, framing) == message
        assert PelcoDecoder(framing).feed(frame) == [message]

    def test_byte_by_byte(self, framing: PelcoFraming, text: str, message: PelcoMessage) -> None:
        decoder = PelcoDecoder(framing)
        frame = bytes.fromhex(text)
        for i, byte in enumerate(frame):
            assert decoder.feed(bytes((byte,))) == ([message] if i == len(frame) - 1 else [])
        assert decoder.skipped == decoder.pending == 0

    def test_with_trailing_bytes(self, framing: PelcoFraming, text: str, message: PelcoMessage) -> None:
        decoder = PelcoDecoder(framing)
        frame = bytes.fromhex(text)
        assert decoder.feed(frame + b"\x00\x11" + frame[:3]) == [message]
        assert (decoder.skipped, decoder.pending) == (2, 3)
        assert decoder.feed(frame[3:]) == [message]

    def test_behind_garbage_that_holds_start_bytes(
        self, framing: PelcoFraming, text: str, message: PelcoMessage
    ) -> None:
        decoder = PelcoDecoder(framing)
        assert decoder.feed(b"\x12\xff\xa0\x07" + bytes.fromhex(text)) == [message]
        assert decoder.skipped == 4

    def test_one_wrong_byte_is_no_message(self, framing: PelcoFraming, text: str, message: PelcoMessage) -> None:
        frame = bytearray.fromhex(text)
        for i in range(len(frame)):
            for change in range(1, 256):
                frame[i] ^= change
                assert decode(bytes(frame), framing) is None
                frame[i] ^= change

    def test_each_beginning_is_no_message(self, framing: PelcoFraming, text: str, message: PelcoMessage) -> None:
        frame = bytes.fromhex(text)
        for length in range(len(frame)):
            assert decode(frame[:length], framing) is None
            assert PelcoDecoder(framing).feed(frame[:length]) == []


@given(messages, st.sampled_from(PelcoFraming))
def test_round_trip(message: PelcoMessage, framing: PelcoFraming) -> None:
    assert decode(encode(message, framing), framing) == message


@given(st.lists(messages, max_size=4), st.sampled_from(PelcoFraming), st.randoms(use_true_random=False))
def test_however_a_stream_is_cut(sent: list[PelcoMessage], framing: PelcoFraming, cuts: random.Random) -> None:
    stream = b"".join(encode(m, framing) for m in sent)
    decoder, got = PelcoDecoder(framing), []
    while stream:
        n = cuts.randint(1, 9)
        got += decoder.feed(stream[:n])
        stream = stream[n:]
    assert got == sent


@given(st.binary(max_size=40), st.sampled_from(PelcoFraming))
def test_any_bytes_are_messages_or_skipped(data: bytes, framing: PelcoFraming) -> None:
    seen = scan(data, framing)
    length = 7 if framing is D else 8
    assert seen.used == seen.skipped + length * len(seen.found)
    for at, message in seen.found:
        assert encode(message, framing) == data[at : at + length]


def test_a_hundred_thousand_random_strings() -> None:
    """The same with many start bytes; the study does a million and more."""
    draw = random.Random(3)
    decoders = {framing: PelcoDecoder(framing) for framing in PelcoFraming}
    for _ in range(50_000):
        data = bytes(draw.choice((0xFF, 0xA0, 0xAF, 0x01, 0x59, draw.randrange(256))) for _ in range(6))
        for framing, decoder in decoders.items():
            for message in decoder.feed(data):
                assert decode(encode(message, framing), framing) == message
            assert decoder.pending < 8


@given(messages, st.integers(0, 255))
def test_acknowledgement(command: PelcoMessage, alarms: int) -> None:
    short = encode_acknowledgement(command, alarms)
    got = acknowledgement_of(short, command)
    assert got is not None
    assert (got.address, got.alarms) == (command.address, alarms)
    assert acknowledgement_of(short + b"\x00", command) is None
    assert acknowledgement_of(short[:3] + bytes((short[3] ^ 1,)), command) is None


def test_acknowledgement_is_the_commands_sum_and_the_alarms() -> None:
    command = with_word(1, Opcode.SET_PAN, 12345)
    assert encode_acknowledgement(command).hex(" ") == "ff 01 00 b5"
    assert encode_acknowledgement(command, 0x08).hex(" ") == "ff 01 08 bd"


def test_what_cannot_be_sent_is_refused() -> None:
    for make in (
        lambda: PelcoMessage(address=0, opcode=0),
        lambda: PelcoMessage(address=1, opcode=256),
        lambda: PelcoMessage(address=1, opcode=0, data_2=-1),
        lambda: with_word(1, Opcode.SET_PAN, 65536),
        lambda: encode(PelcoMessage(address=33, opcode=0), P),
    ):
        with pytest.raises(ProtocolError, match=r"got .*wanted"):
            make()
    assert issubclass(ProtocolError, PtuError)
