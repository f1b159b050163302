"""`groundstation calibrate sky`: heads by day, by airliners with ADS-B and the Moon."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_command, add_report, print_files
from groundstation.cli.number_arguments import positive_number
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.errors import UsageError

_SKY = """By day, in place of the stars: pictures of airliners, whose positions a receiver
of ADS-B notes, and of the Moon tell where the heads look against each other."""
_MORE = """examples:
  groundstation calibrate sky --receive localhost:30003 --keep day/adsb.jsonl
  groundstation calibrate sky --rig rig.toml --site field.toml --from day/ \\
      --out sky.toml --report out/sky

how: DIR has pictures.csv with file, station, pan_deg, tilt_deg, t_utc_s (Unix
time of the mid-exposure) and, where known, pan_from and tilt_from, as for
calibrate stars; and next to it adsb.jsonl or adsb.sbs (or --adsb FILE): lines of
dump1090 or readsb, JSON or SBS, in UTC. The receiver may be late by up to 2 s;
that is found. Which object is which airliner is found, too, if the rig's
orientation is known to 5 deg. Take some twelve stops of three pictures of each of
five airliners from every head, near ones high up and far ones low down.
With --receive the positions of a receiver's TCP port are kept in --keep until
Ctrl-C, each with the time at which it came; nothing is calibrated.

exit code: 0 done; 1 pictures or positions are at fault or do not determine it,
and no rig is written; 2 wrong usage; 130 interrupted"""


def add_sky(kinds: Commands) -> None:
    """Add `calibrate sky`."""
    parser = add_command(kinds, "sky", run_calibrate_sky, "heads by airliners and the Moon, by day", _SKY, _MORE)
    parser.add_argument("--from", dest="taken", type=READ, metavar="DIR", help="pictures with pictures.csv")
    parser.add_argument("--adsb", type=READ, metavar="FILE", help="the receiver's lines, in place of DIR's adsb.jsonl")
    parser.add_argument("--rig", type=READ, metavar="FILE", help="the rig file")
    parser.add_argument("--site", type=READ, metavar="FILE", help="a file with [origin], as the station file is")
    parser.add_argument("--out", type=WRITTEN_FILE, metavar="FILE", help="the rig file to write")
    add_report(parser)
    parser.add_argument(
        "--clock-sigma", type=positive_number, metavar="S", help="1 sigma of the pictures' stamps, s (0.1)"
    )
    parser.add_argument("--receive", metavar="HOST:PORT", help="keep the positions of a receiver's port in --keep")
    parser.add_argument("--keep", type=WRITTEN_FILE, metavar="FILE", help="where positions are kept")


def run_calibrate_sky(options: argparse.Namespace) -> int:
    """Calibrate, print the report and what was written; or keep a receiver's lines."""
    if options.receive is not None:
        return _receive(options)
    given = {"--from": options.taken, "--rig": options.rig, "--site": options.site, "--out": options.out}
    missing = [name for name, value in given.items() if value is None]
    if missing:
        raise UsageError("calibrate sky", got=f"no {', '.join(missing)}", wanted=", ".join(given) + ", or --receive")
    from calibration.rig_output import require_toml_name, require_writable
    from calibration.sky.calibrate import calibrate_sky
    from calibration.sky.day import find_adsb, read_day
    from calibration.sky.html_report import write_sky_page
    from calibration.sky.text_report import format_sky
    from calibration.stars.calibrate import CLOCK_SIGMA_S, sky_uncertainty, write_noted_rig
    from calibration.stars.site_file import read_site
    from calibration.stars.sky import SkyOverSite
    from groundstation.rig.rig import load_rig

    require_toml_name(options.out)
    require_writable(options.out, options.report)
    rig, site = load_rig(options.rig), read_site(options.site)
    reports = find_adsb(options.taken, options.adsb)
    with ProgressLine(sys.stderr, "sky", "picture") as line:
        pictures = read_day(options.taken, rig, SkyOverSite(site), line.update)
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


def _receive(options: argparse.Namespace) -> int:
    """Keep a receiver's positions until it ends, or Ctrl-C."""
    from groundstation.cli.adsb_receiver import keep_lines

    names = ("taken", "rig", "site", "out", "report", "adsb", "clock_sigma")
    others = [getattr(options, name) for name in names]
    if options.keep is None or any(value is not None for value in others):
        raise UsageError("--receive", got="no --keep, or more than it", wanted="--receive HOST:PORT --keep FILE")
    host, _, number = options.receive.rpartition(":")
    if not host or not number.isdigit() or not 0 < int(number) < 65536:
        raise UsageError("--receive", got=repr(options.receive), wanted="HOST:PORT, as localhost:30003")
    kept = keep_lines(host, int(number), options.keep, lambda text: print(text, flush=True))
    print(f"kept {kept} positions in {options.keep}")
    return 0
