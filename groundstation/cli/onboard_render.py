"""`groundstation onboard render`: a rendered approach with exact truth."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_command, add_result_folder, print_files
from groundstation.cli.progress import ProgressLine
from groundstation.cli.wrong_usage import refuse_with

_RENDER = """Render a nose camera's video of an approach, with the inertial unit's log and the exact
truth, for `onboard fly` and `onboard edges` to be tried on."""
_RENDER_MORE = """examples:
  groundstation onboard render --scene dusk --seed 3 --out out/flight
  groundstation onboard render --world 17 --out out/drawn

DIR gets nose.avi (no loss), nose.toml, imu.csv and truth.csv; one that is there already
is left as it is, and nothing is rendered

a world: runway, ground, light, camera with its mount, flight and unit drawn from a seed
(0 to 2999999: the sets train, validate, test of a million each); nose.toml names what
was drawn, and has the width as announced, which may be wrong

exit code: 0 done; 1 the folder or --motion is at fault; 2 wrong usage; 130 interrupted"""
SCENES = ("day", "haze", "dusk", "night", "short-final")
_MOST_SEED_DIGITS = 9
MOST_WORLD = 2_999_999
FRAMES, WORLD_FRAMES = 130, 24


def add_render(kinds: Commands) -> None:
    """Add `onboard render`."""
    render = add_command(
        kinds, "render", run_render, "a rendered approach with exact truth, to try the others on", _RENDER, _RENDER_MORE
    )
    add_result_folder(render, ("nose.avi", "nose.toml", "imu.csv", "truth.csv"))
    render.add_argument("--scene", choices=SCENES, default="day", help="airfield and light (default day)")
    render.add_argument("--seed", type=_seed, default=1, metavar="N", help="of gusts, sensors and noise (default 1)")
    render.add_argument(
        "--motion",
        choices=("waves", "jsbsim"),
        default="waves",
        help="how it flies: smooth waves about the glide path (default), or JSBSim's C172 in turbulence",
    )
    render.add_argument(
        "--frames", type=_count, metavar="N", help="pictures (default 130, at 10 Hz; 24 of a world, at 2 to 10 Hz)"
    )
    render.add_argument(
        "--world", type=_world, metavar="SEED", help="draw all of it instead; only --frames holds; see below"
    )


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or len(text) > _MOST_SEED_DIGITS:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a whole number from 0 to 999999999")
    return int(text)


def _world(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or len(text) > _MOST_SEED_DIGITS or int(text) > MOST_WORLD:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a whole number from 0 to {MOST_WORLD}")
    return int(text)


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or not 2 <= int(text) <= 130:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a number from 2 to 130")
    return int(text)


def run_render(options: argparse.Namespace) -> int:
    """Render and write; returns the exit code."""
    from groundstation.onboard.render import render_flight, render_world

    if options.world is not None:
        refuse_with(options, "--world", {"scene": "day", "seed": 1, "motion": "waves"}, "all of a world is drawn")
    scene = SCENES.index(options.scene)
    with ProgressLine(sys.stderr, "render", "frame") as line:
        if options.world is not None:
            files = render_world(options.out, options.world, options.frames or WORLD_FRAMES, line.update)
        else:
            frames = options.frames or FRAMES
            files = render_flight(options.out, scene, options.seed, frames, options.motion, line.update)
    print_files(files)
    return 0
