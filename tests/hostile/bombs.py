"""Files of at most a megabyte that need far more memory or time than that: one for each known way."""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cache

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from groundstation.recording.mcap_metadata import ABOUT, EVENTS_TOPIC, header_values
from tests.hostile.records import attachment, chunk, container, metadata, record, schema, text
from tests.recording.recorded import FILES, header

MEGABYTE = 1_000_000
# where a schema's record has its number, after the kind and the length
SCHEMA_NUMBER = slice(9, 11)
Bomb = Callable[[], bytes]


def _zstd(data: bytes | bytearray) -> bytes:
    return zstandard.ZstdCompressor(level=3).compress(data)


@cache
def _deflated_zeros(size: int) -> bytes:
    """Return what raw deflate makes of so many zeros: one block for each MiB, all the same, so that one is packed."""
    packer = zlib.compressobj(6, zlib.DEFLATED, -zlib.MAX_WBITS)
    # nothing in a block refers to the one before it
    block = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    return block * (size >> 20) + packer.compress(bytes(size % (1 << 20))) + packer.flush()


def _zlib_zeros(size: int) -> bytes:
    """Return so many zeros as `zlib.decompress` reads them."""
    return b"\x78\x9c" + _deflated_zeros(size) + struct.pack(">HH", size % 65521, 1)


def _recording(*chunks: tuple[int, bytes]) -> bytes:
    """A recording with a header as the recorder writes it, an epoch, and these chunks."""
    epoch = b'{"n":0,"kind":"epoch","t_s":1.0,"epoch":0,"stations":["left","right"]}'
    first = chunk(channel(9, EVENTS_TOPIC) + message(9, epoch))
    head = [metadata(ABOUT, header_values(header())), *(attachment(name, data) for name, data in FILES.items())]
    return container([*head, first, *chunks])


def _packed(inside: bytes, stated_length: int | None = None) -> tuple[int, bytes]:
    return chunk(inside, "zstd", stated_length=stated_length, packed=_zstd(inside))


def channel(number: int, topic: str, pairs: bytes = b"") -> bytes:
    """Return a channel as a record."""
    content = struct.pack("<HH", number, 0) + text(topic) + text("json") + struct.pack("<I", len(pairs)) + pairs
    return record(Opcode.CHANNEL, content)


def message(number: int, data: bytes, sequence: int = 0) -> bytes:
    """Return a message as a record."""
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, sequence, 0, 0) + data)


def schemas() -> bytes:
    """Chunks with a schema of 200 MB each, all different in number."""
    chunks = []
    for size, numbers in ((200 << 20, range(1, 3)), (60 << 20, range(3, 20))):
        # one for all numbers: to fill the memory takes longer than to pack it
        inside = bytearray(schema(0, data=bytes(size)))
        for number in numbers:
            inside[SCHEMA_NUMBER] = struct.pack("<H", number)
            chunks.append(chunk(b"", "zstd", stated_length=len(inside), packed=_zstd(inside)))
    return _recording(*chunks)[:MEGABYTE]


def channel_notes() -> bytes:
    """A channel with millions of notes of no length."""
    return _recording(_packed(channel(1, EVENTS_TOPIC, bytes(50 << 20))))


def channels_again() -> bytes:
    """The same channel announced millions of times."""
    return _recording(_packed(channel(1, EVENTS_TOPIC, bytes(800)) * 60_000))


def tiny_records() -> bytes:
    """Millions of unknown records of zero length."""
    return _recording(_packed(record(0x80, b"") * 3_000_000))


def tiny_messages() -> bytes:
    """Millions of messages without content."""
    return _recording(_packed(channel(1, EVENTS_TOPIC) + message(1, b"") * 1_000_000))


def long_line() -> bytes:
    """One event of forty megabytes."""
    line = b'{"n":1,"kind":"ptu","t_s":1.0,"station":"left","pan_rad":0.0,"x":[' + b"0," * 20_000_000 + b"0]}"
    return _recording(_packed(channel(1, EVENTS_TOPIC) + message(1, line)))


def many_lines() -> bytes:
    """Events of sixty kilobytes each, thousands of them."""
    chunks = []
    for k in range(800):
        line = b'{"n":%d,"kind":"ptu","t_s":1.0,"station":"left","pan_rad":0.0,"tilt_rad":0.0,"x":[' % (k + 1)
        chunks.append(message(1, line + b"0," * 30_000 + b"0]}", k))
    return _recording(_packed(channel(1, EVENTS_TOPIC) + b"".join(chunks)))


def many_chunks() -> bytes:
    """Chunks that unpack to sixty megabytes of nothing, dozens of them."""
    one = _packed(channel(1, "/x") + message(1, bytes(60 << 20)))
    return _recording(*[one] * 60)


def large_message() -> bytes:
    """A message as large as a chunk may be, in a file that is large enough for it, and cut short: it is recovered."""
    padding = [attachment(f"x{k}", bytes(100_000)) for k in range(5)]
    opened = _recording(*padding, _packed(channel(1, "/x") + message(1, bytes(79 << 20))))
    return opened[:-40]


def lz4_chunks() -> bytes:
    """As much as LZ4 can pack into a megabyte."""
    inside = channel(1, "/x") + message(1, bytes(48 << 20))
    one = chunk(inside, "lz4", packed=lz4.frame.compress(inside))
    return _recording(*[one] * 4)


def pictures_waiting() -> bytes:
    """Frames whose parts of many megabytes never become whole."""
    frame = {"n": 1, "kind": "frame", "t_s": 1.0, "station": "left", "epoch": 0, "size_px": [64, 48], "pattern": None}
    part = {"topic": "part0/raw", "x": 0, "y": 0, "w": 8, "h": 8}
    note = {"kind": "pixels", "of": 1, "colour": False, "parts": [part] * 64}
    events = channel(1, EVENTS_TOPIC) + channel(2, "/stations/left/part0/raw")
    events += message(1, json.dumps(frame).encode()) + message(1, json.dumps(note).encode())
    big = message(2, bytes(60 << 20), 1)
    return _recording(_packed(events), *[_packed(big)] * 20)


def small_attachments() -> bytes:
    """Attached files of no length, as many as there is room for."""
    return _recording(*[attachment(str(k), b"") for k in range(12_000)])


def small_records() -> bytes:
    """Records outside of any chunk, of no length, as many as there is room for."""
    return _recording(*[(0x80, b"")] * 100_000)


def toml_key() -> bytes:
    """A key of 200,000 parts."""
    return b"a." * 200_000 + b"a = 1\n"


def toml_header() -> bytes:
    """A table whose name has 200,000 parts."""
    return b"[" + b"a." * 200_000 + b"a]\n"


def toml_headers() -> bytes:
    """Tables of thirty parts each, thousands of them."""
    return b"".join(b"[" + b".".join(b"k%d" % (k + n) for n in range(30)) + b"]\n" for k in range(6_000))[:MEGABYTE]


def toml_inline() -> bytes:
    """Inline tables in one another."""
    return b"a = " + b"{a=" * 100_000 + b"1" + b"}" * 100_000 + b"\n"


def toml_arrays() -> bytes:
    """Arrays in one another."""
    return b"a = " + b"[" * 300_000 + b"]" * 300_000 + b"\n"


def toml_dotted() -> bytes:
    """Keys of forty parts, thousands of them."""
    return b"".join(b".".join([b"k%d" % k] * 40) + b" = 1\n" for k in range(4_000))[:MEGABYTE]


def toml_flat() -> bytes:
    """As many keys as there is room for."""
    return b"".join(b"k%d=1\n" % k for k in range(110_000))[:MEGABYTE]


def toml_long() -> bytes:
    """A key of a million letters."""
    return b"phase" * 190_000 + b" = [1]\n"


def toml_numbers() -> bytes:
    """A number of a million digits."""
    return b"a = " + b"9" * 900_000 + b"\n"


def toml_phases() -> bytes:
    """Tables of an array, as many as there is room for."""
    return b'name = "x"\n' + b"[[phase]]\n" * 99_000


def toml_strings() -> bytes:
    """A string that does not end, after many that do."""
    return b'a = """' + b'\\"' * 450_000


def toml_space() -> bytes:
    """An array of spaces and remarks."""
    return b"a = [" + b"#\n " * 300_000 + b"]\n"


def png(width: int, height: int, *, interlaced: bool = False, depth: int = 8, colour: int = 0) -> bytes:
    """An empty PNG of the stated size."""
    channels = {0: 1, 2: 3, 6: 4}[colour]
    row = 1 + (width * channels * depth + 7) // 8
    # as much of it as goes into a megabyte: a thousand to one is the most that there is
    data = _zlib_zeros(min(row * height, 200 << 20))
    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, int(interlaced))
    parts = [(b"IHDR", head), (b"IDAT", data), (b"IEND", b"")]
    body = b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts)
    return b"\x89PNG\r\n\x1a\n" + body


def png_text() -> bytes:
    """A small PNG with a packed note of a hundred megabytes."""
    whole = png(8, 8)
    note = b"x\0\0" + _zlib_zeros(100 << 20)
    notes = struct.pack(">I", len(note)) + b"zTXt" + note + struct.pack(">I", zlib.crc32(b"zTXt" + note))
    return whole[:33] + notes + whole[33:]


def jpeg() -> bytes:
    """A JPEG whose header states 65,000 pixels of width and height."""
    import cv2
    import numpy as np

    data = bytearray(cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8))[1].tobytes())
    at = data.find(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", 65_000, 65_000)
    return bytes(data)


def jpeg_scans() -> bytes:
    """A progressive JPEG of many scans, each over all of a large picture."""
    import cv2
    import numpy as np

    flags = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_QUALITY, 5]
    data = cv2.imencode(".jpg", np.zeros((6000, 6000), np.uint8), flags)[1].tobytes()
    scan = data.rfind(b"\xff\xda")
    end = data.rfind(b"\xff\xd9")
    return (data[:end] + data[scan:end] * ((MEGABYTE - len(data)) // max(end - scan, 1)) + data[end:])[:MEGABYTE]


def bmp() -> bytes:
    """A BMP with a large stated size, packed in runs."""
    head = struct.pack("<IiiHHIIiiII", 40, 60_000, 60_000, 1, 8, 1, 900_000, 0, 0, 256, 0)
    palette = bytes(1024)
    body = b"\xff\x00" * 400_000
    return b"BM" + struct.pack("<IHHI", 14 + 40 + 1024 + len(body), 0, 0, 14 + 40 + 1024) + head + palette + body


def tiff() -> bytes:
    """An empty TIFF of a large stated size, packed."""
    import cv2
    import numpy as np

    flags = [cv2.IMWRITE_TIFF_COMPRESSION, 8]
    return cv2.imencode(".tif", np.zeros((7_000, 7_000), np.uint8), flags)[1].tobytes()[:MEGABYTE]


def npz(shape: tuple[int, ...], size: int) -> bytes:
    """An archive with a mask of this shape, packed."""
    file, infos = io.BytesIO(), []
    with zipfile.ZipFile(file, "w") as archive:
        for name, dtype, dims, length in (("left_0000", "|u1", shape, size), ("left_0000_xy", "<i4", (2,), 8)):
            text_ = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {dims!r}, }}".encode()
            text_ += b" " * (63 - (len(text_) + 10) % 64 + 1 - 1) + b"\n"
            head = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text_)) + text_
            packer = zlib.compressobj(6, zlib.DEFLATED, -zlib.MAX_WBITS)
            packed = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH) + _deflated_zeros(length)
            info = zipfile.ZipInfo(f"{name}.npy")
            archive.writestr(info, packed)
            # it is packed already, which the list of all members states from here on
            info.compress_type, info.file_size = zipfile.ZIP_DEFLATED, len(head) + length
            info.CRC = zlib.crc32(bytes(length), zlib.crc32(head))
            infos.append(info)
    for info in infos:
        file.seek(info.header_offset)
        file.write(info.FileHeader())
    return file.getvalue()


def npz_many() -> bytes:
    """An archive of very many members."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for k in range(9_000):
            archive.writestr(f"{k}", b"")
    return file.getvalue()[-MEGABYTE:]


def ubx_syncs() -> bytes:
    """False beginnings of messages, each as long as it may be."""
    return b"\xb5\x62\x01\x07\xff\xff" * (MEGABYTE // 6)


def ubx_messages() -> bytes:
    """True messages of position, as short as they come."""
    frame = b"\x01\x07" + struct.pack("<H", 0)
    a = b = 0
    for byte in frame:
        a = a + byte & 255
        b = b + a & 255
    return (b"\xb5\x62" + frame + bytes([a, b])) * (MEGABYTE // 8)


def nmea_lines() -> bytes:
    """Lines of a dollar and a comma that never become a sentence."""
    return b"$GPGGA," + b"$," * 490_000 + b"\n" + b"$GPGGA,,*00\n" * 1_000


def nmea_sentences() -> bytes:
    """Sentences with hundreds of empty cells."""
    body = b"GPGGA," + b"," * 3_000
    check = 0
    for byte in body:
        check ^= byte
    return (b"$" + body + b"*%02X\r\n" % check) * (MEGABYTE // (len(body) + 6))


def pos_rows() -> bytes:
    """Rows and headers of thousands of cells."""
    return (b"%  GPST latitude(deg) longitude(deg) height(m) " + b"a(m) " * 800 + b"\n" + b"1 " * 2_000 + b"\n") * 120


def pos_digits() -> bytes:
    """Numbers of thousands of digits that end in a letter."""
    digits = b"9" * 3_900 + b"x"
    head = b"%  GPST  latitude(deg) longitude(deg)  height(m)   Q\n"
    return head + (b"2025/05/08 11:59:52.2 " + digits + b" 139.7 75.0 1\n") * 240


def tlog_syncs() -> bytes:
    """False beginnings of packets."""
    return b"\xfd" * MEGABYTE


def csv_cells() -> bytes:
    """A header of very many columns."""
    return b"t_s," + b"x," * 30_000 + b"y\n" + b"1," * 30_000 + b"\n"


def csv_quotes() -> bytes:
    """A cell in quotation marks over all lines."""
    return b't_s,x_m,y_m,z_m\n1,2,3,"' + b"a\n" * 490_000


def csv_rows() -> bytes:
    """As many rows as there is room for."""
    return b"t_s,x_m,y_m,z_m\n" + b"".join(b"%d,,,\n" % k for k in range(140_000))[: MEGABYTE - 100]


def csv_blank() -> bytes:
    """Empty lines."""
    return b"t_s,x_m,y_m,z_m\n" + b"\n" * (MEGABYTE - 100)


def csv_name() -> bytes:
    """A column's name of sixty thousand underscores."""
    return b"lat_deg,lon_deg,height_m,utc," + b"_" * 60_000 + b"\n"


def json_nested() -> bytes:
    """Lists in one another."""
    return b"[" * 500_000 + b"]" * 500_000


def json_lists() -> bytes:
    """Very many short lists."""
    return b'{"format":[' + b"[]," * 330_000 + b"[]]}"


def json_number() -> bytes:
    """A number of a million digits."""
    return b'{"format":' + b"9" * 990_000 + b"}"


def yaml_lists() -> bytes:
    """A list in brackets over very many lines."""
    return b"a: [\n" + b"1,\n" * 330_000 + b"]\n"


def yaml_items() -> bytes:
    """Items that are blocks of their own."""
    return b"a:\n" + b"- b: 1\n" * 140_000


def yaml_brackets() -> bytes:
    """Brackets that never close."""
    return b"a: " + b"[" * 990_000


def yaml_key() -> bytes:
    """A key that never ends."""
    return b"a " * 490_000 + b"\n"


def yaml_space() -> bytes:
    """A key with spaces in it."""
    return b"a" + b" " * 900_000 + b"b\n"


def yaml_digits() -> bytes:
    """A number of very many digits that ends in a letter."""
    return b"a: " + b"9" * 900_000 + b"x\n"


def mp4_inside() -> bytes:
    """A box with very many empty ones in it."""
    inner = struct.pack(">I4s", 8, b"free") * 120_000
    return struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0) + struct.pack(">I4s", len(inner) + 8, b"moov") + inner


def mp4_boxes() -> bytes:
    """Nested boxes, and tables with a long stated length."""
    inner = struct.pack(">I4sIII", 20, b"stsz", 0, 1, 0xFFFFFFFF)
    for kind in (b"stbl", b"minf", b"mdia", b"trak", b"moov"):
        inner = struct.pack(">I4s", len(inner) + 8, kind) + inner
    empty = struct.pack(">I4s", 8, b"free") * 120_000
    return struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0) + inner + empty


def tum_lines() -> bytes:
    """Lines of very many numbers."""
    return b"1 " * 490_000 + b"\n"


def ulog_formats() -> bytes:
    """A ULog whose format has very many fields, each an array as long as it may be."""
    head = b"ULog\x01\x12\x35\x01" + bytes(8)
    body = b"vehicle_gps_position:" + b"uint64_t[65535] a;" * 3_000
    fields = struct.pack("<HB", len(body), ord("F")) + body
    subscription = struct.pack("<BH", 0, 0) + b"vehicle_gps_position"
    added = struct.pack("<HB", len(subscription), ord("A")) + subscription
    data = struct.pack("<HB", 10, ord("D")) + bytes(10)
    return head + struct.pack("<HB", 40, ord("B")) + bytes(40) + fields + added + data * 60_000


def ulog_nested() -> bytes:
    """A ULog whose formats hold one another, doubling at each step."""
    head = b"ULog\x01\x12\x35\x01" + bytes(8)
    records = [b"f0:uint8_t a;"]
    records += [b"f%d:f%d[200] a;f%d[200] b;" % (k, k - 1, k - 1) for k in range(1, 30)]
    records.append(b"vehicle_gps_position:uint64_t timestamp;f29 a;")
    body = b"".join(struct.pack("<HB", len(r), ord("F")) + r for r in records)
    subscription = struct.pack("<BH", 0, 0) + b"vehicle_gps_position"
    added = struct.pack("<HB", len(subscription), ord("A")) + subscription
    data = struct.pack("<HB", 100, ord("D")) + bytes(100)
    return head + struct.pack("<HB", 40, ord("B")) + bytes(40) + body + added + data * 1_000


def ulog_damaged() -> bytes:
    """A ULog of which every byte begins a message of no known kind, as long as it may be."""
    head = b"ULog\x01\x12\x35\x01" + bytes(8)
    return head + struct.pack("<HB", 40, ord("B")) + bytes(40) + b"\xff\xff\x00" * 330_000


def dataflash_formats() -> bytes:
    """An onboard log that describes messages of one type again and again."""
    described = b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", 129, 3, b"GPS\0", b"", b"")
    return described * 5_000 + b"\xa3\x95\x81" * 150_000


def dataflash_garbage() -> bytes:
    """An onboard log without a single description."""
    return b"\xa3\x95" + bytes(MEGABYTE - 2)


# of each reader (tests.hostile.readers), by what is wrong
BOMBS: dict[str, tuple[Bomb, ...]] = {
    "flight.mcap": (
        *(
            schemas,
            large_message,
            channel_notes,
            channels_again,
            tiny_records,
            tiny_messages,
            long_line,
            many_lines,
            many_chunks,
        ),
        *(lz4_chunks, pictures_waiting, small_attachments, small_records),
    ),
    "rig.toml": (toml_key, toml_header, toml_headers, toml_inline, toml_arrays, toml_dotted, toml_flat, toml_numbers),
    "session.toml": (toml_flat, toml_long, toml_phases, toml_strings, toml_space, toml_key),
    "config.toml": (toml_key, toml_flat),
    "site.toml": (toml_key,),
    "station.toml": (toml_key,),
    "faults.toml": (toml_key,),
    "lens.toml": (toml_key,),
    "nose camera.toml": (toml_key,),
    "picture.png": (
        lambda: png(30_000, 30_000),
        lambda: png(30_000, 30_000, depth=1),
        lambda: png(12_000, 12_000, depth=8, colour=6, interlaced=True),
        png_text,
    ),
    "left/000001.png": (lambda: png(30_000, 30_000),),
    "board.png": (lambda: png(30_000, 30_000),),
    "picture.jpg": (jpeg, jpeg_scans),
    "board.jpg": (jpeg,),
    "picture.bmp": (bmp,),
    "picture.tif": (tiff,),
    "masks.npz": (lambda: npz((16_000, 16_000), 256_000_000), lambda: npz((2**31, 2**31), 100), npz_many),
    "log.ubx": (ubx_syncs, ubx_messages),
    "log.nmea": (nmea_lines, nmea_sentences),
    "log.pos": (pos_rows, pos_digits),
    "log.tlog": (tlog_syncs,),
    "log.ulg": (ulog_formats, ulog_nested, ulog_damaged),
    "log.bin": (dataflash_formats, dataflash_garbage),
    "log.csv": (csv_cells, csv_quotes, csv_name),
    "dgps.csv": (csv_cells, csv_quotes, csv_rows, csv_blank),
    "frames.csv": (csv_cells, csv_blank),
    "imu.csv": (csv_cells, csv_quotes, csv_blank),
    "ground track.tum": (tum_lines, csv_blank),
    "results/summary.json": (json_nested, json_lists, json_number),
    "runways.json": (json_nested, json_lists, json_number),
    "lens.yaml": (yaml_lists, yaml_items, yaml_brackets, yaml_key, yaml_space, yaml_digits),
    "boxes.mp4": (mp4_boxes, mp4_inside),
    "mp4/left.mp4": (mp4_boxes,),
}
