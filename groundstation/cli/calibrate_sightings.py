"""The command line that records sightings of landmarks: `groundstation calibrate sightings`."""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.number_arguments import count, positive_number
from groundstation.cli.path_arguments import READ, WRITTEN_FILE, WrittenFolder
from groundstation.cli.terminal import print_line
from groundstation.errors import GroundstationError

if TYPE_CHECKING:
    from calibration.landmarks.sighting_list import ListedSighting
    from groundstation.cli.sighting_recorder import SightingRecorder
    from groundstation.sources.cameras.camera import CameraEvent

_SIGHTINGS = """Record the sightings of landmarks that survey, check and mount read: turn a
station's head to each, pick the mark in its picture, save angles and pixels."""
_MORE = """examples:
  groundstation calibrate sightings field.toml left --landmarks landmarks.csv \\
      --out sightings.csv
  groundstation calibrate sightings field.toml left --landmarks landmarks.csv \\
      --out today.csv --from aims.csv

how: a dialogue on the terminal goes through the landmarks; `help` in it lists
what can be typed. `look` writes a picture, and a part of it enlarged with a
scale; `at U V` takes the mark's pixel from it, follows the mark through 40
pictures and saves a row for each: then the head is at rest, and may be turned to
the next. At a landmark whose pixel is known from before, `same` finds it by
itself. Every stop is saved at once; the same line again continues the table.
With --from, a table landmark, pan_deg, tilt_deg, u_px, v_px, all of its rows are
recorded without a question; empty pixels are found by the earlier pictures.
The head is halted on every way out, by the motion guard if the program is killed.

exit code: 0 done; 1 a device or a table is at fault, or with --from a landmark
was not recorded; 2 wrong usage; 130 interrupted"""


def add_sightings(kinds: Commands) -> None:
    """Add `sightings`."""
    parser = add_command(
        kinds, "sightings", run_calibrate_sightings, "record what survey and check read", _SIGHTINGS, _MORE
    )
    parser.add_argument("station_file", type=READ, metavar="STATION.toml", help="the station file, as for live")
    parser.add_argument("name", metavar="NAME", help="which station of it")
    parser.add_argument("--landmarks", type=READ, required=True, metavar="FILE", help="table of the landmarks")
    parser.add_argument(
        "--out", type=WRITTEN_FILE, required=True, metavar="FILE", help="the table of sightings; one there is continued"
    )
    parser.add_argument(
        "--from", dest="listed", type=READ, metavar="LIST", help="record these without a dialogue, see below"
    )
    parser.add_argument(
        "--pictures",
        type=WrittenFolder(),
        metavar="DIR",
        help="where pictures go (default: next to --out, .pictures)",
    )
    parser.add_argument("--rows", type=count, default=40, metavar="N", help="pictures, and rows, of a stop (40)")
    parser.add_argument(
        "--readings", type=count, default=3, metavar="N", help="angles are the median of so many for a picture (3)"
    )
    parser.add_argument(
        "--pixel-sigma", type=positive_number, default=0.3, metavar="PX", help="1 sigma of a pixel that you pick (0.3)"
    )
    parser.add_argument(
        "--rate", type=positive_number, metavar="DEG_S", help="speed of the head, deg/s; else a tenth of its fastest"
    )


def run_calibrate_sightings(options: argparse.Namespace) -> int:
    """Record sightings by a dialogue or by a list."""
    from calibration.landmarks.mark_pictures import MarkPictures
    from calibration.landmarks.sighting_list import read_sighting_list
    from calibration.landmarks.sighting_table import SightingTable
    from calibration.sightings import read_landmarks
    from groundstation.cli.sighting_dialogue import SightingDialogue
    from groundstation.cli.sighting_recorder import SightingRecorder, StopSettings
    from groundstation.live.sighting_station import SightingStation

    landmarks = read_landmarks(options.landmarks)
    listed = None if options.listed is None else read_sighting_list(options.listed, landmarks)
    table = SightingTable(options.out)
    rate = None if options.rate is None else math.radians(options.rate)

    def warn(text: str) -> None:
        print_line(f"groundstation: {options.name}: {text}", sys.stderr)

    def tell(text: str) -> None:
        print(text, flush=True)

    def of_camera(event: "CameraEvent") -> None:
        if event.kind not in ("opened", "ended"):
            warn(f"camera: {event.text}")

    unopened = SightingStation(options.station_file, options.name, rate_rad_s=rate, tell=of_camera, report=warn)
    folder: Path = options.pictures or options.out.with_suffix(".pictures")
    pictures = MarkPictures(folder, options.name, unopened.calibrated.lens.image_size_px, landmarks)
    settings = StopSettings(pictures=options.rows, readings=options.readings, picked_sigma_px=options.pixel_sigma)
    with unopened as station:
        recorder = SightingRecorder(station, landmarks, table, pictures, settings, tell)
        if listed is not None:
            return _record_listed(recorder, listed, warn)
        SightingDialogue(recorder, _ask, tell).run()
    plural = "" if recorder.stops == 1 else "s"
    tell(f"{recorder.stops} stop{plural} saved to {options.out}" if recorder.stops else "nothing was recorded")
    return 0


def _ask(prompt: str) -> str:
    return input(prompt)


def _record_listed(
    recorder: "SightingRecorder", listed: "Sequence[ListedSighting]", warn: Callable[[str], None]
) -> int:
    """Record every row of a list; returns 1 where one was not."""
    failed = 0
    for row in listed:
        try:
            if recorder.station.turns:
                recorder.turn_to(row.pan_rad, row.tilt_rad)
            if row.pixel_px is None:
                recorder.record_same(row.landmark)
            else:
                recorder.record_picked(row.landmark, row.pixel_px)
        except GroundstationError as fault:
            failed += 1
            warn(str(fault))
    print(f"{recorder.stops} of {len(listed)} stops saved", flush=True)
    return 1 if failed else 0
