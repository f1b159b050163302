"""`groundstation calibrate panorama`: the ground around each head, for head angles from the picture."""

import argparse
import math
import sys

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.number_arguments import count, finite_number
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.cli.time_span import add_span, require_span

_PANORAMA = """A panorama of the ground around each head, from pictures that it takes while it
turns. With it a replay takes each frame's pan and tilt from the picture itself:
encoders' noise, steps and periodic error no longer count."""
_MORE = """example:
  groundstation calibrate panorama swing --out panorama.npz
  groundstation replay flight --panorama panorama.npz --out out/flight

how: turn each head slowly over what it will look at, and record it as a session;
any flight of the same day does as well. Pictures are laid where the encoders say,
and brought to fit each other. What is higher than --highest is left out: clouds
move. The heads have to stand where they stood; where a frame shows too little
ground or does not fit, its angles are the encoders', and the replay says how
often and why.

exit code: 0 done; 1 the session is at fault or shows too little; 2 wrong usage;
130 interrupted"""


def add_panorama(kinds: Commands) -> None:
    """Add `calibrate panorama`."""
    parser = add_command(
        kinds, "panorama", run_calibrate_panorama, "the ground around, for angles from the picture", _PANORAMA, _MORE
    )
    parser.add_argument("session", type=READ, metavar="SESSION", help="session folder with videos and ptu.csv")
    parser.add_argument("--rig", type=READ, metavar="FILE", help="another rig than the session's rig.toml")
    parser.add_argument("--out", type=WRITTEN_FILE, required=True, metavar="FILE.npz", help="the file to write")
    parser.add_argument("--every", type=count, default=8, metavar="N", help="use every Nth frame (8)")
    parser.add_argument(
        "--highest", type=finite_number, default=3.0, metavar="DEG", help="leave out what is higher, deg (3)"
    )
    add_span(parser)


def run_calibrate_panorama(options: argparse.Namespace) -> int:
    """Make the panoramas and write them."""
    from calibration.panorama.calibrate import PanoramaChoice, make_panoramas
    from calibration.rig_output import require_writable
    from groundstation.session import load_session
    from groundstation.sources.panorama_file import write_panoramas

    require_span(options)
    require_writable(options.out)
    session = load_session(options.session, options.rig)
    choice = PanoramaChoice(from_s=options.from_s, to_s=options.to_s, every=options.every, highest_deg=options.highest)
    with ProgressLine(sys.stderr, "panorama") as line:
        found = make_panoramas(session, choice, lambda done: line.update(done, 0))
    for name, mosaic in found.items():
        h, w = mosaic.panorama.grey.shape
        step = math.degrees(mosaic.panorama.step_rad)
        moved = math.degrees(mosaic.moved_rad)
        print(
            f"{name}: {mosaic.registered} frames fit each other, {w * step:.1f} by {h * step:.1f} deg; the last round"
            f" moved them by {moved:.4f} deg"
        )
    write_panoramas(options.out, {name: mosaic.panorama for name, mosaic in found.items()})
    print(f"wrote {options.out}")
    return 0
