"""Logs and session files, damaged at random: bytes lost, changed, doubled; content forged under a right checksum."""

import random
import re
from pathlib import Path

from tests.session.logs.writers import (
    dataflash,
    flight,
    gga,
    gst,
    nmea_log,
    relposned,
    tlog,
    ubx_log,
    ulog,
    with_checksum,
    with_fletcher,
    zda,
)

DATA = Path(__file__).parent / "data"
_SCRAPS = [b"", b",", b"\n", b"-", b"nan", b"inf", b"1e999", b"0", b"%", b"$", b"*", b"\xb5\x62", b"\xa3\x95", b"\xfd"]
_SCRAPS += [b"9" * 400, b"\0", b"\xff" * 8, b":", b"/", b"60", b'"', b"latitude(deg)", b"% ref pos   : 91 0 0\n"]
_TABLE = (
    b"utc,lat_deg,lon_deg,height_m,sigma_e_m,sigma_n_m,sigma_u_m,status\n"
    b"2025-05-08T11:59:52.2Z,35.681,139.7605,75.01,0.01,0.01,0.02,fix\n"
    b"2025-05-08T11:59:52.4Z,35.681002,139.760499,75.31,,,,float\n"
)


def seeds() -> dict[str, bytes]:
    """Return one small file of each kind, by a name with the suffix that selects its reader."""
    places = flight(3)
    found = {f"{p.stem}{p.suffix}": p.read_bytes() for p in sorted(DATA.iterdir()) if p.suffix in (".pos", ".nmea")}
    found |= {
        "own.nmea": nmea_log(places) + b"".join(gst(p, 0.01, 0.01, 0.02) + zda(p) + gga(p, 5, "GP") for p in places),
        "own.ubx": ubx_log(places) + relposned(places[0], 100, 200, 300),
        "new.ulg": ulog(places),
        "old.ulg": ulog(places, old=True, topic="vehicle_gps_position"),
        "own.bin": dataflash(places),
        "own.tlog": tlog(places),
        "own.csv": _TABLE,
    }
    return found


_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_ODD_NUMBERS = [b"", b"-1", b"0", b"1", b"1e300", b"-1e300", b"nan", b"inf", b"1e-300", b"true", b"[]", b'"x"', b"null"]
_ODD_NUMBERS += [b"99999999999999999999", b"0.5", b"-0.0", b"1e999", b"9" * 400, b"12345678", b"{}", b"4294967296"]


def altered(content: bytes, chance: random.Random) -> bytes:
    """Return a text with one to three of its numbers changed: it stays a table, TOML or JSON, more or less."""
    for _ in range(chance.randint(1, 3)):
        found = list(_NUMBER.finditer(content))
        if not found:
            break
        number = chance.choice(found)
        content = content[: number.start()] + chance.choice(_ODD_NUMBERS) + content[number.end() :]
    return content


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Return the content with one to four accidents."""
    for _ in range(chance.randint(1, 4)):
        start = chance.randrange(len(content) + 1)
        end = min(len(content), start + chance.choice((0, 1, 2, 8, 40)))
        kind = chance.randrange(6)
        if kind == 0:
            content = content[:start] + content[end:]
        elif kind == 1:
            content = content[:end] + content[start:]
        elif kind == 2:
            content = content[:start] + chance.choice(_SCRAPS) + content[end:]
        elif kind == 3:
            content = content[:start]
        else:
            content = content[:start] + bytes(chance.randrange(256) for _ in range(end - start)) + content[end:]
    return content


def forged(name: str, content: bytes, chance: random.Random) -> bytes:
    """Return the content changed so that checksums still hold, where the format has them; else `damaged`."""
    if name.endswith(".nmea"):
        lines = []
        for line in content.split(b"\r\n"):
            body = line[1:].rpartition(b"*")[0].decode("latin-1")
            if body and chance.random() < 0.5:
                cells = body.split(",")
                cells[chance.randrange(1, len(cells))] = chance.choice(
                    [
                        "",
                        "nan",
                        "-1",
                        "1e400",
                        "9999999",
                        "999999.99",
                        "M",
                        "240000.00",
                        "235960",
                        "320199",
                        "inf",
                        "99999.9",
                    ]
                )
                lines.append(with_checksum(",".join(cells))[:-2])
            else:
                lines.append(line)
        return b"\r\n".join(lines)
    if name.endswith(".ubx"):
        out, place = b"", 0
        while place < len(content):
            end = place + 8 + int.from_bytes(content[place + 4 : place + 6], "little")
            frame = bytearray(content[place:end])
            for _ in range(chance.randint(0, 3)):
                frame[chance.randrange(6, len(frame) - 2)] = chance.randrange(256)
            out += with_fletcher(bytes(frame))
            place = end
        return out
    if name.endswith(".tlog"):
        fields = {
            "time_usec": chance.choice((0, 2**64 - 1, 10**15 + 1, 5 * 10**7)),
            "lat": chance.randint(-(2**31), 2**31 - 1),
            "alt": chance.randint(-(2**31), 2**31 - 1),
            "fix_type": chance.choice((0, 3, 4, 6, 8, 255)),
        }
        return tlog(flight(2), fields=fields, system_time=chance.random() < 0.5, ellipsoid=chance.random() < 0.5)
    return damaged(content, chance)
