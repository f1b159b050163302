"""Packets of Protocol 2.0: the maker's examples, the maker's CRC and stuffing, round trips, rubbish."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptu_drivers.dynamixel.codec import Instruction, Packet, PacketDecoder, crc16, decode, encode
from ptu_drivers.errors import ProtocolError
from tests.peers import peer_module

# as the maker's manual prints them
KNOWN = [
    ("FF FF FD 00 01 03 00 01 19 4E", Packet(identifier=1, instruction=Instruction.PING)),
    (
        "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",
        Packet(identifier=1, instruction=Instruction.STATUS, parameters=bytes.fromhex("00 06 04 26")),
    ),
    (
        "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
        Packet(identifier=1, instruction=Instruction.READ, parameters=bytes.fromhex("84 00 04 00")),
    ),
    (
        "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
        Packet(identifier=1, instruction=Instruction.STATUS, parameters=bytes.fromhex("00 A6 00 00 00")),
    ),
    (
        "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
        Packet(identifier=1, instruction=Instruction.WRITE, parameters=bytes.fromhex("74 00 00 02 00 00")),
    ),
]

packets = st.builds(
    Packet,
    identifier=st.integers(0, 254),
    instruction=st.integers(0, 255),
    # many of what stuffing is about
    parameters=st.lists(st.sampled_from((0xFF, 0xFF, 0xFD, 0x00, 0x55)) | st.integers(0, 255), max_size=40).map(bytes),
)


@pytest.fixture(scope="module")
def sdk() -> object:
    module = peer_module("dynamixel-sdk", "dynamixel_sdk")
    return module.PacketHandler(2.0)


@pytest.mark.parametrize(("text", "packet"), KNOWN)
class TestKnownPackets:
    def test_whole(self, text: str, packet: Packet) -> None:
        frame = bytes.fromhex(text)
        assert encode(packet) == frame
        assert decode(frame) == packet

    def test_byte_by_byte(self, text: str, packet: Packet) -> None:
        decoder = PacketDecoder()
        frame = bytes.fromhex(text)
        for i, byte in enumerate(frame):
            assert decoder.feed(bytes((byte,))) == ([packet] if i == len(frame) - 1 else [])
        assert decoder.skipped == 0

    def test_with_bytes_before_and_behind(self, text: str, packet: Packet) -> None:
        decoder = PacketDecoder()
        frame = bytes.fromhex(text)
        assert decoder.feed(b"\xff\xff\xfd\xff" + frame + b"\x00" + frame[:5]) == [packet]
        assert decoder.feed(frame[5:]) == [packet]
        assert decoder.skipped == 5

    def test_one_wrong_byte_is_no_packet(self, text: str, packet: Packet) -> None:
        frame = bytearray.fromhex(text)
        for i in range(len(frame)):
            for change in range(1, 256):
                frame[i] ^= change
                assert decode(bytes(frame)) is None
                frame[i] ^= change


@given(st.binary(max_size=60))
def test_crc_is_the_makers(sdk: object, data: bytes) -> None:
    assert crc16(data) == sdk.updateCRC(0, data, len(data))  # type: ignore[attr-defined]


@given(packets)
def test_bytes_are_the_makers(sdk: object, packet: Packet) -> None:
    """The SDK stuffs the same packet into the same bytes, and unstuffs this codec's."""
    body = [packet.instruction, *packet.parameters]
    plain = [0xFF, 0xFF, 0xFD, 0, packet.identifier, (len(body) + 2) & 0xFF, (len(body) + 2) >> 8, *body, 0, 0]
    ours = encode(packet)
    assert bytes(sdk.addStuffing(plain.copy())[: len(ours) - 2]) == ours[:-2]  # type: ignore[attr-defined]
    back = sdk.removeStuffing(list(ours))  # type: ignore[attr-defined]
    length = back[5] | back[6] << 8
    assert bytes(back[7 : 7 + length - 2]) == bytes(body)


@given(packets)
def test_round_trip(packet: Packet) -> None:
    assert decode(encode(packet)) == packet
    assert b"\xff\xff\xfd" not in encode(packet)[3:].replace(b"\xff\xff\xfd\xfd", b"")


@given(st.lists(packets, max_size=4), st.randoms(use_true_random=False))
def test_however_a_stream_is_cut(sent: list[Packet], cuts: random.Random) -> None:
    stream = b"".join(map(encode, sent))
    decoder, got = PacketDecoder(), []
    while stream:
        n = cuts.randint(1, 12)
        got += decoder.feed(stream[:n])
        stream = stream[n:]
    assert got == sent


@given(st.lists(st.sampled_from((0xFF, 0xFD, 0x00, 0x01, 0x03)) | st.integers(0, 255), max_size=60).map(bytes))
def test_any_bytes_are_packets_or_skipped(data: bytes) -> None:
    decoder = PacketDecoder()
    for packet in decoder.feed(data):
        assert decode(encode(packet)) == packet
    assert decoder.skipped <= len(data)


def test_what_cannot_be_sent_is_refused() -> None:
    for make in (
        lambda: Packet(identifier=255, instruction=1),
        lambda: Packet(identifier=1, instruction=256),
        lambda: encode(Packet(identifier=1, instruction=3, parameters=bytes(1100))),
    ):
        with pytest.raises(ProtocolError, match=r"got .*wanted"):
            make()
