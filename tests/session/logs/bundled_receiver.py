"""The bundled receiver's log: the landing's DGPS as an RTK receiver would have written it, NMEA at ten fixes a second.

python -m tests.session.logs.bundled_receiver    writes recordings/receiver.nmea; a test holds the file to it.
"""

import csv
from pathlib import Path

import numpy as np

from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef
from tests.session.logs.writers import with_checksum

RECORDINGS = Path(__file__).resolve().parents[3] / "recordings"
# where the landing is put: a field in Switzerland, +y to the west
ORIGIN_DEG_M, AZIMUTH_DEG = (47.3977, 8.5456, 455.2), 271.5
SEPARATION_M, SIGMA_M = 47.8, 0.012
# zero of the landing's clock; its DGPS is 0.3 s late in a clock of its own, and so is this
DAY, HOUR, MINUTE = "170526", 9, 30


def receiver_log() -> bytes:
    """Return the log: time and date, position and quality, sigmas, for each fix."""
    with (RECORDINGS / "landing-1" / "dgps.csv").open(newline="") as file:
        rows = [[float(row[name]) for name in ("t_s", "x_m", "y_m", "z_m")] for row in csv.DictReader(file)]
    azimuth = np.radians(AZIMUTH_DEG)
    s, c = np.sin(azimuth), np.cos(azimuth)
    enu_from_runway = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T
    lines = []
    for t_s, *place_m in rows:
        lat, lon, height = (
            float(v[0]) for v in geodetic_from_ecef(ecef_from_enu((enu_from_runway @ place_m)[None], ORIGIN_DEG_M))
        )
        time = f"{HOUR:02d}{MINUTE:02d}{t_s:06.3f}"
        place = f"{_angle(lat, 2)},N,{_angle(lon, 3)},E"
        lines += [
            f"GNRMC,{time},A,{place},48.6,271.5,{DAY},,,R",
            f"GNGGA,{time},{place},4,17,0.7,{height - SEPARATION_M:.4f},M,{SEPARATION_M},M,1.0,0001",
            f"GNGST,{time},{SIGMA_M},,,,{SIGMA_M},{SIGMA_M},{2 * SIGMA_M}",
        ]
    return b"".join(with_checksum(line) for line in lines)


def _angle(degrees: float, digits: int) -> str:
    """Return an angle as NMEA has it: degrees and minutes in one number."""
    whole = int(degrees)
    return f"{whole:0{digits}d}{60.0 * (degrees - whole):010.7f}"


if __name__ == "__main__":
    (RECORDINGS / "receiver.nmea").write_bytes(receiver_log())
