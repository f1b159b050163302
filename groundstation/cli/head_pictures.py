"""What commands share that turn heads to take pictures of the sky, or take pictures that are there."""

import argparse
import math
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from groundstation.cli.number_arguments import finite_number, positive_number
from groundstation.cli.path_arguments import READ, WrittenFolder
from groundstation.cli.terminal import print_line
from groundstation.errors import UsageError

if TYPE_CHECKING:
    from calibration.stars.pointing_plan import HeadRange
    from calibration.stars.sky import ObservingSite
    from groundstation.live.sighting_station import SightingStation
    from groundstation.live.station_file import StationFile
    from groundstation.rig.rig import Rig


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """Add the station file, and what stands for it: `--from`, `--rig`, `--site`."""
    parser.add_argument(
        "station_file", type=READ, nargs="?", metavar="STATION.toml", help="the station file, as for live"
    )
    parser.add_argument("--from", dest="taken", type=READ, metavar="DIR", help="pictures that are there; nothing moves")
    parser.add_argument("--rig", type=READ, metavar="FILE", help="the rig file, in place of the station file's")
    parser.add_argument("--site", type=READ, metavar="FILE", help="a file with [origin], for the station file's")


def add_taking(parser: argparse.ArgumentParser, exposure: str, within: str) -> None:
    """Add how new pictures are taken, with the defaults of exposure and range in words."""
    parser.add_argument("--pictures", type=WrittenFolder(), metavar="DIR", help="where new pictures go")
    parser.add_argument("--stations", metavar="NAMES", help="only these, with commas")
    parser.add_argument("--exposure", type=positive_number, metavar="S", help=f"of each picture, s ({exposure})")
    parser.add_argument("--gain", type=finite_number, metavar="G", help="the camera's, in its own unit")
    parser.add_argument(
        "--range",
        dest="within",
        type=_head_range,
        metavar="PAN,PAN,TILT,TILT",
        help=f"lowest and highest readings, deg ({within})",
    )
    parser.add_argument("--rate", type=positive_number, metavar="DEG_S", help="speed of the heads, deg/s (5)")


def _head_range(text: str) -> tuple[float, ...]:
    """Return four angles in degrees."""
    parts = [finite_number(part) for part in text.split(",")]
    if len(parts) != 4 or parts[0] >= parts[1] or parts[2] >= parts[3]:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted PAN_LOW,PAN_HIGH,TILT_LOW,TILT_HIGH in degrees")
    return tuple(parts)


def require_inputs(options: argparse.Namespace, taking: Iterable[str]) -> None:
    """Raise `UsageError` for inputs that cannot be; ``taking`` names the options of new pictures only."""
    if options.station_file is None and (options.rig is None or options.site is None):
        raise UsageError("STATION.toml", got="none", wanted="it, or --rig, --site and --from")
    if options.station_file is None and options.taken is None:
        raise UsageError("--rig, --site", got="no pictures", wanted="--from DIR with them: no head can be turned")
    if options.taken is not None and options.pictures is not None:
        raise UsageError("--pictures", got="--from as well", wanted="where new pictures go, or where old are")
    for option in taking:
        if options.taken is not None and getattr(options, option) is not None:
            name = "--range" if option == "within" else f"--{option}"
            raise UsageError(name, got="--from as well", wanted="one of them: with --from no picture is taken")


def stations_of(options: argparse.Namespace, rig: "Rig") -> tuple[str, ...]:
    """Return the stations that were asked for; raises `UsageError` for one that the rig has not."""
    if options.stations is None:
        return rig.names
    names = tuple(name.strip() for name in options.stations.split(","))
    for name in names:
        if name not in rig.names:
            raise UsageError("--stations", got=repr(name), wanted="some of " + ", ".join(rig.names))
    return names


def site_of(options: argparse.Namespace, file: "StationFile | None") -> "ObservingSite":
    """Return the place of `--site`, or the station file's."""
    from calibration.stars.site_file import read_site

    return read_site(options.site if options.site is not None or file is None else options.station_file)


def range_of(options: argparse.Namespace) -> "HeadRange":
    """Return the readings between which heads are turned."""
    from calibration.stars.pointing_plan import HeadRange

    low, high, down, up = options.within
    return HeadRange(pan_deg=(low, high), tilt_deg=(down, up))


def unopened_head(options: argparse.Namespace, name: str, rig: "Rig", site: "ObservingSite") -> "SightingStation":
    """Return one station's camera and head, to be opened on ``with``; kept off the Sun by this rig and site."""
    from groundstation.live.sighting_station import SightingStation
    from groundstation.session.folder import GeoOrigin

    def warn(text: str) -> None:
        print_line(f"groundstation: {text}", sys.stderr)

    return SightingStation(
        options.station_file,
        name,
        rate_rad_s=math.radians(options.rate),
        tell=lambda event: warn(f"{name}: camera: {event.text}") if event.kind not in ("opened", "ended") else None,
        report=warn,
        exposure_s=options.exposure,
        gain=options.gain,
        rig=rig,
        origin=GeoOrigin(
            lat_deg=site.lat_deg,
            lon_deg=site.lon_deg,
            height_m=site.height_m,
            y_axis_azimuth_deg=site.y_axis_azimuth_deg,
        ),
    )
