"""`groundstation calibrate sky`: heads by day, by airliners with ADS-B and the Moon."""

import argparse
import math
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from groundstation.cli.command_arguments import Commands, add_command, add_report, print_files
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
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.errors import GroundstationError, InputError, UsageError

if TYPE_CHECKING:
    from calibration.stars.sky import ObservingSite
    from groundstation.cli.standing_heads import StandingPlace
    from groundstation.live.station_file import StationFile
    from groundstation.rig.rig import Rig

_SKY = """By day, in place of the stars: pictures of airliners, whose positions a receiver
of ADS-B notes, and of the Moon tell where the heads look against each other."""
_MORE = """examples:
  groundstation calibrate sky field.toml --receive localhost:30003 \\
      --out sky.toml --report out/sky
  groundstation calibrate sky --receive localhost:30003 --keep day/adsb.jsonl
  groundstation calibrate sky --rig rig.toml --site field.toml --from day/ \\
      --out sky.toml --report out/sky

how: with the station file and --receive the heads are turned ahead of airliners that
will be in reach (--range, 6 deg above the horizon, 20 deg from the Sun), one after
the other, and take pictures while each passes; pictures and positions are saved
(default: next to --out, .pictures), and the heads are halted on every way out.
Heads that wait are turned away before the Sun comes to them, and parked in the end.
With --from nothing moves: DIR has pictures.csv with file, station, pan_deg,
tilt_deg, t_utc_s (Unix time of the mid-exposure) and, where known, pan_from and
tilt_from, as for calibrate stars; and next to it adsb.jsonl or adsb.sbs (or --adsb
FILE): lines of dump1090 or readsb, JSON or SBS, in UTC. The receiver may be late by up to 2 s;
that is found. Which object is which airliner is found, too, if the rig's
orientation is known to 5 deg. Take some twelve stops of three pictures of each of
five airliners from every head, near ones high up and far ones low down.
With --receive and --keep alone the positions are kept until Ctrl-C, those of a TCP
port with the time at which they came; nothing moves, nothing is calibrated.

exit code: 0 done; 1 pictures, positions or devices are at fault or do not determine
it, and no rig is written; 2 wrong usage; 130 interrupted"""
# what concerns new pictures only, and its defaults
_TAKING = {
    "within": (-60.0, 60.0, 5.0, 55.0),
    "airliners": 5,
    "stops": 12,
    "sun": 20.0,
    "minutes": 60.0,
    "rate": 5.0,
    "exposure": None,
    "gain": None,
}
_WITHOUT_KEEPING = (*_TAKING, "station_file", "taken", "rig", "site", "report", "adsb", "clock_sigma", "pictures")


def add_sky(kinds: Commands) -> None:
    """Add `calibrate sky`."""
    parser = add_command(kinds, "sky", run_calibrate_sky, "heads by airliners and the Moon, by day", _SKY, _MORE)
    add_inputs(parser)
    parser.add_argument("--adsb", type=READ, metavar="FILE", help="the receiver's lines, in place of DIR's adsb.jsonl")
    parser.add_argument("--out", type=WRITTEN_FILE, metavar="FILE", help="the rig file to write")
    add_report(parser)
    parser.add_argument(
        "--clock-sigma", type=positive_number, metavar="S", help="1 sigma of the pictures' stamps, s (0.1)"
    )
    parser.add_argument("--receive", metavar="SOURCE", help="a receiver: HOST:PORT, or file:PATH of a file that grows")
    parser.add_argument("--keep", type=WRITTEN_FILE, metavar="FILE", help="where positions are kept; nothing moves")
    add_taking(parser, "the station file's", "-60,60,5,55")
    parser.add_argument("--airliners", type=count, metavar="N", help="to follow (5)")
    parser.add_argument("--stops", type=count, metavar="N", help="of each head and airliner (12)")
    parser.add_argument(
        "--sun", type=positive_number, metavar="DEG", help="airliners nearer to the Sun are let go (20)"
    )
    parser.add_argument("--minutes", type=positive_number, metavar="N", help="look for airliners so long (60)")
    take_negative_numbers(parser)


def run_calibrate_sky(options: argparse.Namespace) -> int:
    """Calibrate, print the report and what was written; or keep a receiver's lines."""
    if options.receive is not None and options.station_file is None and options.taken is None:
        return _keep(options)
    _require_inputs(options)
    from calibration.rig_output import require_toml_name, require_writable
    from calibration.sky.calibrate import calibrate_sky
    from calibration.sky.day import find_adsb, read_day
    from calibration.sky.html_report import write_sky_page
    from calibration.sky.text_report import format_sky
    from calibration.stars.calibrate import CLOCK_SIGMA_S, sky_uncertainty, write_noted_rig
    from calibration.stars.sky import SkyOverSite
    from groundstation.live.station_file import load_station
    from groundstation.rig.rig import load_rig

    require_toml_name(options.out)
    require_writable(options.out, options.report)
    file = (
        None
        if options.station_file is None
        else load_station(options.station_file, opens_cameras=options.taken is None)
    )
    rig = file.load_rig() if options.rig is None and file is not None else load_rig(options.rig)
    site, names = site_of(options, file), stations_of(options, rig)
    if options.taken is None and file is not None:
        _require_sun_avoided(file)
        # to a few degrees: where heads turn, and where the Sun is, hang on it
        rig.require_known(("orientation", "lens"))
    folder = options.taken if options.taken is not None else _take(options, rig, site, file)
    reports = find_adsb(folder, options.adsb)
    with ProgressLine(sys.stderr, "sky", "picture") as line:
        pictures = read_day(folder, rig, SkyOverSite(site), line.update)
    pictures = tuple(p for p in pictures if p.station in names)
    clock = CLOCK_SIGMA_S if options.clock_sigma is None else options.clock_sigma
    found = calibrate_sky(rig, pictures, reports, site, sky_uncertainty(site, clock, each_clock=False))
    print(format_sky(found))
    notes = [
        f"# {one.before.name} by airliners and the Moon: {int(one.fit.kept.sum())} pictures"
        for one in found.night.joint.nights
    ]
    write_noted_rig(options.out, found.night.rig, notes)
    print(f"\nwrote {options.out}")
    if options.report is not None:
        print_files(write_sky_page(options.report, found))
    return 0


def _require_inputs(options: argparse.Namespace) -> None:
    """Raise `UsageError` for a choice of inputs that cannot be."""
    given = {"--from": options.taken, "--rig": options.rig, "--site": options.site, "--out": options.out}
    missing = [name for name, value in given.items() if value is None]
    if options.out is None or (options.station_file is None and missing):
        wanted = "STATION.toml, --receive and --out; " + ", ".join(given) + "; or --receive and --keep"
        got = "no " + (", ".join(missing) if options.station_file is None else "--out")
        raise UsageError("calibrate sky", got=got, wanted=wanted)
    require_inputs(options, _TAKING)
    if options.keep is not None:
        raise UsageError("--keep", got="--out as well", wanted="one of them: positions are kept next to new pictures")
    if options.taken is not None and options.receive is not None:
        raise UsageError("--receive", got="--from as well", wanted="one of them; --adsb FILE for lines that are there")
    if options.taken is None and options.adsb is not None:
        raise UsageError("--adsb", got="no --from", wanted="--receive for new pictures, or --from DIR")
    if options.taken is None and options.receive is None:
        raise UsageError(
            "STATION.toml", got="no --receive", wanted="--receive SOURCE to follow airliners by, or --from"
        )


def _require_sun_avoided(file: "StationFile") -> None:
    """Raise `InputError` where heads that turn by day would not be kept off the Sun on their ways."""
    if file.origin is None and file.sun_angle_rad != 0.0:
        wanted = "[origin], so that lenses are kept off the Sun; or [safety] sun_angle_deg = 0"
        raise InputError(str(file.path), got="no [origin]", wanted=wanted)


def _take(options: argparse.Namespace, rig: "Rig", site: "ObservingSite", file: "StationFile | None") -> Path:
    """Turn the heads to airliners and save pictures and positions; returns their folder."""
    from calibration.sky.airliner_choice import SkyReach
    from calibration.stars.sky import SkyOverSite
    from groundstation.cli.adsb_receiver import AdsbReceiver
    from groundstation.cli.sky_recorder import AirlinerOrders, AirlinerRecorder, RecorderClock
    from groundstation.cli.star_recorder import PictureFolder

    for name, default in _TAKING.items():
        if getattr(options, name) is None:
            setattr(options, name, default)
    folder: Path = options.pictures or options.out.with_suffix(".pictures")
    pictures, sky = PictureFolder(folder), SkyOverSite(site)
    names = [name for name in stations_of(options, rig) if not rig[name].fixed]
    orders = AirlinerOrders(
        airliners=options.airliners,
        stops=options.stops,
        rate_rad_s=math.radians(options.rate),
        most_s=60.0 * options.minutes,
    )
    reach = SkyReach(
        stations=tuple(rig[name] for name in names),
        within=range_of(options),
        sun=None,
        sun_rad=math.radians(options.sun),
        pictures_s=orders.pictures_s,
    )
    clock = RecorderClock(now=time.time, wait=time.sleep)

    def tell(text: str) -> None:
        print(text, flush=True)

    with ExitStack() as stack:
        receiver = stack.enter_context(AdsbReceiver(options.receive, folder / "adsb.jsonl"))
        heads = [stack.enter_context(unopened_head(options, name, rig, site)) for name in names]
        recorder = AirlinerRecorder(
            heads, reach, orders, receiver, sky, pictures, clock, tell, _places(rig, names, file)
        )
        try:
            recorder.run()
            recorder.leave()
        except GroundstationError:
            recorder.leave()
            raise
        except KeyboardInterrupt:
            tell(f"pictures until now are in {folder} (--from)")
            tell("the heads stand where they were, and the Sun moves on: park them or cover the lenses")
            raise
    if not pictures.count:
        got = f"no picture: no airliner was in reach in {options.minutes:g} minutes"
        if recorder.refused:
            got = f"no picture: {recorder.refused} ways were refused, the last: {recorder.refusal}"
        raise InputError("calibrate sky", got=got, wanted="a receiver, heads and hours with airliners within 50 km")
    return folder


def _places(rig: "Rig", names: list[str], file: "StationFile | None") -> "dict[str, StandingPlace]":
    """Return how heads stand: as far from the Sun as the station file keeps them, and parked where it says."""
    from groundstation.cli.standing_heads import StandingPlace
    from groundstation.live.keep_out_zones import sun_angle_of

    heads = {} if file is None else {s.name: s.head for s in file.stations}
    given = None if file is None else file.sun_angle_rad
    return {
        name: StandingPlace(
            sun_rad=sun_angle_of(rig[name], given), park_rad=(0.0, 0.0) if head is None else head.park_rad
        )
        for name, head in ((name, heads.get(name)) for name in names)
    }


def _keep(options: argparse.Namespace) -> int:
    """Keep a receiver's positions until it ends, or Ctrl-C."""
    from groundstation.cli.adsb_receiver import keep_lines

    others = [name for name in _WITHOUT_KEEPING if getattr(options, name) is not None]
    if options.keep is None or others:
        raise UsageError("--receive", got="no --keep, or more than it", wanted="--receive SOURCE --keep FILE")
    kept = keep_lines(options.receive, options.keep, lambda text: print(text, flush=True))
    print(f"kept {kept} positions in {options.keep}")
    return 0
