"""Damaged logs and session files, a million and more: only errors of our own may come out, and only sane numbers.

python benchmarks/log_fuzz.py [--inputs N] [--seed S]
"""

import argparse
import collections
import os
import random
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.errors import GroundstationError, InputError  # noqa: E402
from groundstation.logs.fixes import LogOptions  # noqa: E402
from groundstation.logs.read import GnssLog, read_log  # noqa: E402
from groundstation.rig import load_rig  # noqa: E402
from groundstation.session import Session, load_dgps, load_session, load_truth  # noqa: E402
from groundstation.sources.frame_table import read_frames  # noqa: E402
from groundstation.sources.labels import read_labels  # noqa: E402
from groundstation.sources.ptu_readings import PtuReadings  # noqa: E402
from tests.logs.damage import damaged, forged, seeds  # noqa: E402
from tests.session.folder import Tiny  # noqa: E402

OPTIONS = (
    LogOptions(),
    LogOptions(geoid_separation_m=37.7, base_deg_m=(35.68, 139.76, 60.0)),
    LogOptions(instance=1, height="ellipsoid"),
)
SESSION_TABLES = ("frames.csv", "ptu.csv", "dgps.csv", "truth.csv", "detections.csv", "rig.toml", "session.toml")
SESSION_TEXT = """name = "tiny"
[origin]
lat_deg = 35.68
lon_deg = 139.76
height_m = 60
y_axis_azimuth_deg = 12.5
[clocks]
left = { offset_s = 61.95, sigma_s = 0.3 }
[target]
span_m = 2.0
antenna_in_body_m = [-0.4, 0.0, -0.1]
[initial]
t_s = 1.0
position_m = [0, 300, 20]
velocity_m_s = [0, -15, -1]
sigma_position_m = [1, 5, 1]
sigma_velocity_m_s = 2
[dgps]
epoch_utc = 2025-05-08T11:59:00Z
date = 2025-05-08
geoid_separation_m = 37.7
base = [35.68, 139.76, 60.0]
instance = 0
[[phase]]
from_s = 0.5
to_s = 2
background = "sky"
"""


def read_angles(session: Session) -> None:
    """Read all of ptu.csv."""
    readings = PtuReadings(session)
    readings.start(0.0, 10.0)
    for _ in readings.until(10.0):
        pass


def check(log: GnssLog) -> None:
    """Raise `AssertionError` for a log whose numbers cannot be."""
    numbers = (log.gps_s, log.lat_deg, log.lon_deg, log.height_m, log.sigma_enu_m, log.covariance_en_m2)
    assert all(np.all(np.isfinite(n)) for n in numbers)
    assert len(log.gps_s) == len(log.quality) > 0
    assert np.all(np.diff(log.gps_s) > 0)
    assert np.all(np.abs(log.lat_deg) <= 90)
    assert np.all(log.sigma_enu_m > 0)


def check_line(fault: GroundstationError) -> None:
    """Raise `AssertionError` for an error that is not one printable line."""
    assert str(fault).isprintable(), repr(str(fault))


def tell(done: int, what: str) -> None:
    """Say now and then how far it is."""
    if done % 20_000 == 0 and done:
        print(f"{done} {what} without an error that is not ours", file=sys.stderr, flush=True)


def fuzz_logs(inputs: int, chance: random.Random, folder: Path, counts: collections.Counter[str]) -> None:
    """Read damaged logs of every format in turn."""
    found = seeds()
    names = list(found)
    for k in range(inputs):
        tell(k, "logs")
        name = names[k % len(names)]
        content = forged(name, found[name], chance) if chance.random() < 0.4 else damaged(found[name], chance)
        path = folder / f"log{Path(name).suffix}"
        path.write_bytes(content)
        try:
            check(read_log(path, OPTIONS[k // len(names) % len(OPTIONS)]))
            counts[f"{path.suffix} read"] += 1
        except GroundstationError as fault:
            check_line(fault)
            counts[f"{path.suffix} refused"] += 1
        except BaseException:
            (Path(tempfile.gettempdir()) / f"fuzz_failure{path.suffix}").write_bytes(content)
            print(f"input {k} of {name}: kept as fuzz_failure{path.suffix}", file=sys.stderr)
            raise


def fuzz_sessions(inputs: int, chance: random.Random, folder: Path, counts: collections.Counter[str]) -> None:
    """Read a small session, one of whose files is damaged."""
    Tiny(rows=4, video="png", session=SESSION_TEXT, ptu_from_s=0.9, ptu_to_s=1.2, ptu_step_s=0.1).write(folder)
    (folder / "dgps.csv").write_text("t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,status\n1,0,300,20,1,1,1,fix\n")
    (folder / "truth.csv").write_text("t_s,x_m,y_m,z_m,left_u_px,left_v_px\n1,0,300,20,31,23\n1.1,0,299,20,,\n")
    (folder / "detections.csv").write_text("t_s,station,u_px,v_px\n1,left,31,23\n1,right,30,22\n")
    whole = {name: (folder / name).read_bytes() for name in SESSION_TABLES}
    session = load_session(folder)
    read = {
        "frames.csv": lambda: read_frames(session),
        "ptu.csv": lambda: read_angles(session),
        "dgps.csv": lambda: load_dgps(session),
        "truth.csv": lambda: load_truth(session),
        "detections.csv": lambda: read_labels(session),
        "rig.toml": lambda: load_rig(folder / "rig.toml"),
        "session.toml": lambda: load_session(folder),
    }
    for k in range(inputs):
        tell(k, "session files")
        name = SESSION_TABLES[k % len(SESSION_TABLES)]
        content = damaged(whole[name], chance)
        (folder / name).write_bytes(content)
        try:
            read[name]()
            counts[f"{name} read"] += 1
        except InputError as fault:
            check_line(fault)
            counts[f"{name} refused"] += 1
        except BaseException:
            (Path(tempfile.gettempdir()) / f"fuzz_failure_{name}").write_bytes(content)
            raise
        if k % len(SESSION_TABLES) >= SESSION_TABLES.index("rig.toml"):
            (folder / name).write_bytes(whole[name])


def main() -> None:
    """Run both and print how many were read and refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_050_000, metavar="N", help="how many in all")
    parser.add_argument("--seed", type=int, default=8, metavar="S")
    options = parser.parse_args()
    counts: collections.Counter[str] = collections.Counter()
    chance = random.Random(options.seed)
    shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(dir=shared) as name:
        fuzz_logs(options.inputs * 2 // 3, chance, Path(name), counts)
        fuzz_sessions(options.inputs - options.inputs * 2 // 3, chance, Path(name) / "session", counts)
    for kind in sorted({key.rsplit(" ", 1)[0] for key in counts}):
        print(f"{kind:<15} read {counts[f'{kind} read']:>8}  refused {counts[f'{kind} refused']:>8}")
    print(f"{sum(counts.values())} inputs, no error that is not ours, {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
