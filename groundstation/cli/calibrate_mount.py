"""`groundstation calibrate mount`: how the camera sits on its pan-tilt head."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_calibrated_rig, add_command, print_files
from groundstation.cli.path_arguments import READ
from groundstation.cli.progress import ProgressLine
from groundstation.cli.wrong_usage import refused_as_usage
from groundstation.errors import UsageError

_MOUNT = """How each camera sits on its pan-tilt head, and what is wrong with the head: step the
PTU through a grid while it looks at marks that stand still, and give the pixels and the
readings. Found are boresight, lever arm, leaning axis, encoder scale, backlash."""
_MOUNT_MORE = """examples:
  groundstation calibrate mount sightings.csv --landmarks landmarks.csv \\
      --rig rig.toml --out better.toml --report out/mount
  groundstation calibrate mount --pictures shots/ --board charuco:9x7:0.04:0.03 \\
      --rig rig.toml --out better.toml
  groundstation calibrate mount --pictures night/ --lamp --rig rig.toml \\
      --out better.toml --free backlash

sightings.csv: station, landmark, pan_deg, tilt_deg, u_px, v_px. landmarks.csv:
landmark, x_m, y_m, z_m; marks that are not in it are points of unknown place. Such
marks near the horizon, a lone lamp above all, do not determine the orientation:
refused, unless --free leaves the boresight out; a board, or one 40 deg up, does.
pictures.csv in the folder of --pictures: file, station, pan_deg, tilt_deg.

LIST, with commas, of boresight, lever, lean, scale, backlash, base (all of these
unless stated) and zero. What the sightings do not determine is held, with a note.

exit code: 0 done; 1 the sightings are at fault or do not determine it, and nothing
is written; 2 wrong usage"""


def add_mount(kinds: Commands) -> None:
    """Add `calibrate mount`."""
    mount = add_command(
        kinds,
        "mount",
        run_mount,
        "the camera on its pan-tilt head, from marks seen at many angles",
        _MOUNT,
        _MOUNT_MORE,
    )
    mount.add_argument("sightings", type=READ, nargs="?", metavar="SIGHTINGS", help="table of sightings")
    mount.add_argument("--landmarks", type=READ, metavar="FILE", help="table of the marks' places")
    mount.add_argument("--pictures", type=READ, metavar="DIR", help="pictures with pictures.csv, in place of SIGHTINGS")
    seen = mount.add_mutually_exclusive_group()
    seen.add_argument("--board", metavar="SPEC", help="the pictures show this board, as in calibrate intrinsics")
    seen.add_argument("--lamp", action="store_true", help="the pictures show one lamp")
    mount.add_argument("--rig", type=READ, required=True, metavar="RIG", help="rig file with the lenses")
    mount.add_argument("--free", default="", metavar="LIST", help="find only these")
    add_calibrated_rig(mount)


def run_mount(options: argparse.Namespace) -> int:
    """Calibrate mounts, print reports and what was written; returns the exit code."""
    from calibration.lens.boards import parse_board
    from calibration.mount.calibrate import calibrate_mounts, read_mount_tables, write_rig
    from calibration.mount.html_report import write_mount_page
    from calibration.mount.sightings_from_pictures import sightings_of_pictures
    from calibration.mount.text_report import format_mount
    from groundstation.rig.rig import load_rig

    _require_usage(options)
    with refused_as_usage():
        board = parse_board(options.board) if options.board else None
    rig = load_rig(options.rig)
    if options.pictures is not None:
        with ProgressLine(sys.stderr, "pictures", "picture") as line:
            found = sightings_of_pictures(options.pictures, rig, board, lambda n: line.update(n, None))
        for text in found.without:
            print(f"not used: {text}")
        seen, marks = found.seen, found.marks
    else:
        seen, marks = read_mount_tables(options.sightings, options.landmarks, rig)
    calibrated = calibrate_mounts(rig, seen, marks, options.free)
    print("\n\n".join(format_mount(one) for one in calibrated.stations))
    write_rig(options.out, calibrated)
    print(f"\nwrote {options.out}")
    if options.report is not None:
        print_files(write_mount_page(options.report, calibrated.stations))
    return 0


def _require_usage(options: argparse.Namespace) -> None:
    """Raise `UsageError` for a choice of inputs or outputs that cannot be, `InputError` for a folder as output."""
    from calibration.rig_output import require_toml_name

    if (options.sightings is None) == (options.pictures is None):
        got = "both" if options.sightings is not None else "neither"
        raise UsageError("SIGHTINGS, --pictures", got=got, wanted="one of them")
    if options.pictures is not None and options.landmarks is not None:
        raise UsageError("--landmarks", got="--pictures as well", wanted="sightings: pictures name no landmarks")
    if (options.board is not None or options.lamp) != (options.pictures is not None):
        got = "neither" if options.pictures is not None else "no --pictures"
        raise UsageError("--board, --lamp", got=got, wanted="one of them, with --pictures")
    require_toml_name(options.out)
