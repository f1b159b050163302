"""`groundstation calibrate stars`: heads, lenses and axes by the night sky."""

import argparse
import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from groundstation.cli.command_arguments import Commands, add_calibrated_rig, add_command, print_files
from groundstation.cli.head_pictures import (
    add_inputs,
    add_taking,
    range_of,
    require_inputs,
    site_of,
    stations_of,
    unopened_head,
)
from groundstation.cli.number_arguments import count, positive_number, take_negative_numbers
from groundstation.cli.progress import ProgressLine
from groundstation.errors import UsageError

if TYPE_CHECKING:
    from calibration.stars.sky import ObservingSite
    from groundstation.rig.rig import Rig

_STARS = """Ten minutes of night sky in place of a flight: each head is turned over its range
and takes pictures of the stars, which tell its lens, how the camera sits on it,
what is wrong with its axes, and where it looks against the other heads: range
hangs on that."""
_MORE = """examples:
  groundstation calibrate stars field.toml --out stars.toml --report out/stars
  groundstation calibrate stars field.toml --out stars.toml --from stars.pictures
  groundstation calibrate stars --rig rig.toml --site site.toml --from night/ \\
      --out stars.toml

how: with the station file alone, heads are turned, one after the other, and
pictures are saved first (default: next to --out, .pictures), each with its angles;
the heads are halted on every way out. With --from nothing moves: DIR has
pictures.csv with file, station, pan_deg, tilt_deg, t_utc_s (Unix time of the
mid-exposure) and, where known, pan_from and tilt_from (1 or -1: how each axis moved
last). Needed are a table [origin] (the station file's, or --site), a lens to 10 %,
and positions; the orientation need not be known. [air] with pressure_hpa (at the
site) and air_c makes refraction certain to 1 %.

exit code: 0 done; 1 pictures or devices are at fault or do not determine it, and no
rig is written; 2 wrong usage; 130 interrupted"""
# what concerns new pictures only, and its defaults
_TAKING = {"within": (-60.0, 60.0, 5.0, 55.0), "pointings": 24, "exposure": 0.5, "rate": 5.0, "gain": None}


def add_stars(kinds: Commands) -> None:
    """Add `calibrate stars`."""
    parser = add_command(kinds, "stars", run_calibrate_stars, "heads and lenses by the night sky", _STARS, _MORE)
    add_inputs(parser)
    add_calibrated_rig(parser)
    add_taking(parser, "0.5", "-60,60,5,55")
    parser.add_argument("--pointings", type=count, metavar="N", help="of each head (24)")
    parser.add_argument(
        "--clock-sigma", type=positive_number, metavar="S", help="1 sigma of the stamps, all together, s (0.1)"
    )
    parser.add_argument(
        "--each-clock", action="store_true", help="the stamps' errors are each picture's own: times hardly known"
    )
    parser.add_argument(
        "--station-clocks", action="store_true", help="each station's stamps have an error of their own"
    )
    take_negative_numbers(parser)


def run_calibrate_stars(options: argparse.Namespace) -> int:
    """Take pictures unless they are there, calibrate, print the report and what was written."""
    from calibration.rig_output import require_toml_name, require_writable
    from calibration.stars.calibrate import (
        CLOCK_SIGMA_S,
        calibrate_night,
        sky_uncertainty,
        write_night_rig,
    )
    from calibration.stars.html_report import write_night_page
    from calibration.stars.night import read_night
    from calibration.stars.star_images import load_tetra3rs
    from calibration.stars.text_report import format_night
    from groundstation.live.station_file import load_station
    from groundstation.rig.rig import load_rig

    require_toml_name(options.out)
    _require_inputs(options)
    require_writable(options.out, options.report)
    load_tetra3rs()
    file = (
        None
        if options.station_file is None
        else load_station(options.station_file, opens_cameras=options.taken is None)
    )
    rig = file.load_rig() if options.rig is None and file is not None else load_rig(options.rig)
    site = site_of(options, file)
    names = stations_of(options, rig)
    folder = options.taken if options.taken is not None else _take(options, rig, site)
    with ProgressLine(sys.stderr, "stars", "picture") as line:
        pictures = read_night(folder, rig, line.update)
    clock = CLOCK_SIGMA_S if options.clock_sigma is None else options.clock_sigma
    uncertain = sky_uncertainty(site, clock, each_clock=options.each_clock, station_clocks=options.station_clocks)
    found = calibrate_night(rig, {n: p for n, p in pictures.items() if n in names}, site, uncertain)
    print(format_night(found))
    write_night_rig(options.out, found)
    print(f"\nwrote {options.out}")
    if options.report is not None:
        print_files(write_night_page(options.report, found))
    return 0


def _require_inputs(options: argparse.Namespace) -> None:
    """Raise `UsageError` for a choice of inputs that cannot be."""
    require_inputs(options, _TAKING)
    if options.each_clock and options.station_clocks:
        raise UsageError("--station-clocks", got="--each-clock as well", wanted="one of them")
    if options.each_clock and options.clock_sigma is None:
        raise UsageError("--each-clock", got="no --clock-sigma", wanted="one sigma of each picture's time, s")


def _take(options: argparse.Namespace, rig: "Rig", site: "ObservingSite") -> Path:
    """Turn the heads and save pictures; returns their folder."""
    from calibration.stars.pointing_plan import plan_pointings
    from calibration.stars.sky import SkyOverSite
    from groundstation.cli.star_recorder import PictureFolder, take_pictures

    for name, default in _TAKING.items():
        if getattr(options, name) is None:
            setattr(options, name, default)
    folder: Path = options.pictures or options.out.with_suffix(".pictures")
    night, sky = PictureFolder(folder), SkyOverSite(site)
    now = time.time()
    sun, moon = sky.body("sun", now), sky.body("moon", now)
    within = range_of(options)
    names = [name for name in stations_of(options, rig) if not rig[name].fixed]
    altitude = math.degrees(math.asin(float(sun[2])))
    # all plans before the first move
    plans = {
        name: plan_pointings(rig[name], within, options.pointings, moon if moon[2] > 0.0 else None, altitude)
        for name in names
    }
    for name, plan in plans.items():
        with unopened_head(options, name, rig, site) as station:
            take_pictures(station, plan, night, lambda text: print(text, flush=True))
    return folder
