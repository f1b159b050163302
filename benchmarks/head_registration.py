"""Head angles from the picture against the truth of a rendered session, and against its encoders.

    python benchmarks/head_registration.py landing-clutter [--every N] [--stations N]

The session is a folder of $GROUNDSTATION_DATA with truth.csv. The panorama is made of even frames, one in so many of
them; odd frames are scored: with the encoder, and with the encoder withheld but for ±0.5°. The true angles are those at
which the nose of truth.csv is seen at its pixel. Printed are rms errors of pan and tilt, and why frames had none.
"""

import argparse
import csv
import os
from collections import Counter
from pathlib import Path

import numpy as np

from calibration.flight.observations import read_angles
from calibration.panorama.mosaic import PanoramaFrame, frame_of, make_mosaic
from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.registration.head_registration import HeadRegistration, RegisteredAngles
from groundstation.rig.rig import Station
from groundstation.session import Session, load_session
from groundstation.sources.frame_table import read_frames
from groundstation.sources.picture_reader import PictureReader

HIGHEST_DEG = 3.0
WITHHELD_DEG = 0.5
WITHHELD_EVERY = 3


def true_angles(session: Session, station: Station) -> FloatArray:
    """Return the angles (n, 2) of each frame, NaN where the nose is not in its picture."""
    geometry, rows = station.geometry(), []
    with (session.folder / "truth.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if not row[f"{station.name}_u_px"]:
                rows.append(np.full(2, np.nan))
                continue
            nose = np.array([float(row[f"{axis}_m"]) for axis in "xyz"])
            pixel = np.array([float(row[f"{station.name}_{axis}_px"]) for axis in "uv"])
            aim = aim_at(geometry, nose)
            assert aim is not None
            angles = np.array([aim.pan_rad, aim.tilt_rad])
            for _ in range(8):
                seen = geometry.project(nose, *angles)
                assert seen is not None
                angles = angles - np.linalg.solve(seen.jacobian[:, 3:], seen.pixel - pixel)
            rows.append(angles)
    return np.array(rows)


def read(session: Session, station: Station) -> list[PanoramaFrame]:
    """Return all frames of a station with its encoders' angles."""
    table = read_frames(session)
    stamps = table.stamps_s[station.name]
    readings = read_angles(session, float(stamps[0]) - 1.0, float(stamps[-1]) + 1.0)[station.name]
    angles = np.column_stack([np.interp(stamps, readings[:, 0], readings[:, k]) for k in (1, 2)])
    numbers, size = table.numbers[station.name], station.lens.image_size_px
    frames = []
    with PictureReader(session.media[station.name], numbers, table.line, size, whole=False) as reader:
        for row in angles:
            picture = reader.next()
            if picture is None:
                break
            frames.append(frame_of(picture.image, row))
    return frames


def score(station: Station, frames: list[PanoramaFrame], true: FloatArray, every: int) -> None:
    """Print one station's figures."""
    mosaic = make_mosaic(station, frames[::2][::every], np.radians(HIGHEST_DEG))
    used = len(frames[::2][::every])
    print(f"{station.name}: {mosaic.registered} of {used} frames in the panorama, last moved by", end=" ")
    print(f"{np.degrees(mosaic.moved_rad):.4f} deg")
    head, random = HeadRegistration(station, mosaic.panorama), np.random.default_rng(0)
    for word, off_deg in (("encoder", 0.0), ("withheld", WITHHELD_DEG)):
        rows, why = [], Counter[str]()
        sigma = np.radians(off_deg / np.sqrt(3.0)) if off_deg else station.angle_sigma_rad
        for k in range(1, len(frames), 2 * (WITHHELD_EVERY if off_deg else 1)):
            start = frames[k].angles_rad + np.radians(random.uniform(-off_deg, off_deg, 2))
            found = head.register_grey(frames[k].grey, float(start[0]), float(start[1]), float(sigma))
            if not isinstance(found, RegisteredAngles):
                why[found.value] += 1
            elif np.isfinite(true[k, 0]):
                here = np.array([found.pan_rad, found.tilt_rad])
                rows.append([*(here - true[k]), *(frames[k].angles_rad - true[k]), found.sigma_rad])
        table = np.degrees(np.array(rows).reshape(-1, 5))
        rms = np.sqrt(np.mean(table**2, axis=0))
        print(f"  {word}: {len(table)} frames, picture {rms[0]:.5f} {rms[1]:.5f} deg", end=", ")
        print(
            f"encoder {rms[2]:.5f} {rms[3]:.5f}, stated {rms[4]:.5f}, mean {table[:, :2].mean(axis=0).round(5)}",
            end=", ",
        )
        print(f"largest {np.abs(table[:, :2]).max():.4f}; not: {dict(why)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session")
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--stations", type=int, default=2)
    options = parser.parse_args()
    session = load_session(Path(os.environ["GROUNDSTATION_DATA"]) / options.session, None)
    for station in session.rig.stations[: options.stations]:
        score(station, read(session, station), true_angles(session, station), options.every)


if __name__ == "__main__":
    main()
