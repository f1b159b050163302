"""Import of videos and a log as a session: `groundstation import`."""

import argparse
import datetime
import sys
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_command, print_files
from groundstation.cli.number_arguments import parse_number, take_negative_numbers
from groundstation.cli.path_arguments import NEW_FOLDER, READ
from groundstation.cli.progress import ProgressLine
from groundstation.errors import InputError, UsageError

_IMPORT = """Make a session folder of what a flight left: a video from each station, the table of
pan and tilt, the log of a receiver or an autopilot. Frame times are the stamps in
the videos (they need not be even) from the given start; positions come into
the runway's frame with quality and sigma; all of it is checked before the folder
is there."""
_IMPORT_MORE = """example:
  groundstation import left.mp4 right.mp4 --rig rig.toml --ptu angles.csv \\
      --dgps flight.nmea --origin 47.3977,8.5456,455.2 --azimuth 271.5 \\
      --left-start 2026-05-17T09:30:00.20Z --right-start 2026-05-17T09:30:00.35Z \\
      --out sessions/flight-3
  groundstation replay sessions/flight-3 --out out/flight-3

logs: NMEA, PX4 .ulg, ArduPilot .bin and .tlog, u-blox .ubx (these need
pip install 'groundstation[logs]'), RTKLIB .pos, and .csv: lat_deg, lon_deg, height_m
with a time in UTC, or t_s, x_m, y_m, z_m as in dgps.csv. What each of them leaves
open, and how times and heights are read: docs/formats.md

exit code: 0 done; 1 something cannot be right, one line states what, and nothing is
written; 2 wrong usage; 130 interrupted"""


def add_import(commands: Commands) -> None:
    """Add `import`."""
    add = add_command(
        commands, "import", run_import, "videos and a DGPS log in, a session folder out", _IMPORT, _IMPORT_MORE
    )
    # a place in the south, an antenna behind the nose: "-35.36,149.17,584"
    take_negative_numbers(add)
    add.add_argument(
        "videos",
        type=READ,
        nargs="+",
        metavar="VIDEO",
        help="left and right, or in the order of the rig's stations; in any order if named after them",
    )
    add.add_argument("--rig", type=READ, required=True, metavar="FILE", help="the stations' calibration, rig.toml")
    add.add_argument("--out", type=NEW_FOLDER, required=True, metavar="SESSION", help="the folder to make")
    add.add_argument("--ptu", type=READ, metavar="TABLE", help="t_s (or utc, unix_s), left_pan_deg, left_tilt_deg, ...")
    add.add_argument("--link", action="store_true", help="link to the videos instead of copying them")
    add.add_argument("--name", default="", metavar="TEXT", help="the session's name (default: the folder's)")
    _add_times(add)
    _add_log(add)
    add.add_argument("--span", type=_positive, metavar="M", help="wing span of the aircraft, m")
    add.add_argument("--antenna", type=_triple, metavar="X,Y,Z", help="antenna from the nose, m: forward, right, down")


def _add_times(add: argparse.ArgumentParser) -> None:
    times = add.add_argument_group("times")
    when = "when its first frame was taken: UTC, or seconds since the epoch"
    times.add_argument("--left-start", metavar="TIME", help=f"station left: {when}")
    times.add_argument("--right-start", metavar="TIME", help="the same of station right")
    times.add_argument("--start", action="append", default=[], metavar="STATION=TIME", help="the same of another one")
    times.add_argument("--frames", type=READ, metavar="TABLE", help="frames.csv, instead of stamps and starts")
    times.add_argument("--ptu-start", metavar="TIME", help="what zero of the angles' t_s is (default: the epoch)")
    times.add_argument(
        "--epoch", metavar="UTC", help="zero of the session's clock (default: the second before the first frame)"
    )


def _add_log(add: argparse.ArgumentParser) -> None:
    log = add.add_argument_group("log of positions")
    log.add_argument("--dgps", type=READ, metavar="LOG", help="the log")
    log.add_argument(
        "--origin", type=_place, metavar="LAT,LON,H", help="the session's origin: degrees, height above the ellipsoid"
    )
    log.add_argument("--azimuth", type=_azimuth, metavar="DEG", help="where +y points, clockwise from true north")
    log.add_argument("--date", type=_date, metavar="DATE", help="UTC date of the log's first position, if it has none")
    log.add_argument("--height", choices=("ellipsoid", "sea level"), help="what a table's bare altitude is above")
    log.add_argument(
        "--geoid-separation", type=_number, metavar="M", help="ellipsoid height of sea level there, if the log has none"
    )
    log.add_argument("--base", type=_place, metavar="LAT,LON,H", help="the base, for a log of baselines")
    log.add_argument("--instance", type=int, choices=range(16), metavar="N", help="which receiver of an autopilot")


def run_import(options: argparse.Namespace) -> int:
    """Create the folder and print its contents; returns the exit code."""
    from groundstation.conversion.import_request import ImportRequest
    from groundstation.conversion.import_session import import_session
    from groundstation.rig.rig import load_rig
    from groundstation.session.logs.fixes import LogOptions

    request = ImportRequest(
        videos=_by_station(options.videos, load_rig(options.rig).names),
        rig=options.rig,
        out=options.out,
        dgps=options.dgps,
        ptu=options.ptu,
        frames=options.frames,
        origin_deg_m=options.origin,
        azimuth_deg=options.azimuth,
        starts=_starts(options),
        ptu_start=options.ptu_start,
        epoch=options.epoch,
        reading=LogOptions(
            date=options.date,
            height=options.height,
            geoid_separation_m=options.geoid_separation,
            base_deg_m=options.base,
            instance=options.instance,
        ),
        link=options.link,
        name=options.name,
        span_m=options.span,
        antenna_in_body_m=options.antenna,
    )
    with ProgressLine(sys.stderr, "import", "frame") as line:
        made = import_session(request, lambda n: line.update(n, None))
    for text in made.summary:
        print(text)
    for text in made.remarks:
        print(f"groundstation: {text}", file=sys.stderr)
    print()
    print_files(made.files)
    return 0


def _by_station(videos: list[Path], names: tuple[str, ...]) -> dict[str, Path]:
    """Return the videos by station.

    Where all files are named after the stations, that decides: a shell's `*.mp4` is in order of the alphabet. Else they
    are in order, left before right whatever their order in the rig.
    """
    named = {video.stem: video for video in videos}
    if len(named) == len(videos) and set(named) == set(names):
        return {name: named[name] for name in names}
    order = ("left", "right") if set(names) == {"left", "right"} else names
    if len(videos) != len(order):
        got = f"{len(videos)} video{'' if len(videos) == 1 else 's'}"
        raise InputError("VIDEO", got=got, wanted=f"{len(order)}, of the stations {', '.join(order)}")
    return dict(zip(order, videos, strict=True))


def _starts(options: argparse.Namespace) -> dict[str, str]:
    """Return the starts by station."""
    starts = {n: t for n, t in (("left", options.left_start), ("right", options.right_start)) if t is not None}
    for text in options.start:
        name, sign, time = text.partition("=")
        if not sign or name in starts:
            raise UsageError("--start", got=repr(text), wanted="STATION=TIME, one for each station")
        starts[name] = time
    return starts


def _number(text: str) -> float:
    return parse_number(text, "a number", lambda value: abs(value) < 1e6)


def _azimuth(text: str) -> float:
    value = _number(text)
    if not -360.0 <= value <= 360.0:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted degrees clockwise from true north, -360 to 360")
    return value


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a number above 0")
    return value


def _triple(text: str) -> tuple[float, float, float]:
    parts = text.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted three numbers with commas")
    first, second, third = (_number(part) for part in parts)
    return first, second, third


def _place(text: str) -> tuple[float, float, float]:
    lat, lon, height = _triple(text)
    if abs(lat) > 90 or abs(lon) > 360:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted latitude, longitude in degrees, height in m")
    return lat, lon, height


def _date(text: str) -> datetime.date:
    try:
        value = datetime.date.fromisoformat(text)
    except ValueError:
        value = datetime.date.min
    if value.year < 1980:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a date such as 2026-05-17")
    return value
