"""The part of the command line that simulates: `groundstation simulate --out SESSION …`."""

import argparse
import sys
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_command, add_simulated_flight
from groundstation.cli.number_arguments import count, parse_number
from groundstation.cli.path_arguments import NEW_FOLDER, READ, READ_TEXT
from groundstation.cli.progress import ProgressLine
from groundstation.cli.wrong_usage import refuse_with

_SIMULATE = """Fly an aircraft past two stations, film it, and write a session folder with exact truth,
as a laboratory would have it after a flight: videos, tables of frame times, PTU
angles and DGPS. Everything random comes from the seed."""
_MORE = """examples:
  groundstation simulate --out flights/one
  groundstation simulate --out flights/two --flight take-off --rate 30 --wind 5 --seed 7
  groundstation simulate --out flights/drawn --world 17
  groundstation replay flights/two --out out/two
  groundstation simulate --out night --night 24

a world: airframe, scenery, sky, cameras, stations and flight drawn from a seed (0 to
2999999: the sets train, validate, test of a million each), or read from a world.toml
as every drawn session holds it; of the options only --rate and --duration go with a
seed, and none with a file

faults on a timetable, TOML, one table for each; times are session time:
  [[fault]]
  what = "camera_lost"     # or camera_frozen, camera_late, ptu_silent, ptu_spike, ptu_stuck,
                           # dgps_gap, camera_clock_step, ptu_clock_step, dgps_clock_step
  station = "left"         # not for dgps_…
  from_s = 10.0
  to_s = 12.0              # left out: to the end
                           # camera_late and the steps: by_s = 0.05; ptu_spike: by_deg = 0.5

exit code: 0 done; 1 rig, faults or folder are at fault; 2 wrong usage; 130
interrupted"""
_FLIGHTS = ("landing", "take-off", "weave")
_FORMS = ("video", "h264", "lossless", "png")
_RATE_HZ = 10.0
# options with their defaults: of a flight alone, and of a drawn world too
_OF_A_FLIGHT: dict[str, object] = {
    "flight": "landing",
    "wind": 0.0,
    "aircraft": "waves",
    "faults": None,
    "rig": None,
    "pictures": "video",
    "grey": False,
}
_OF_A_WORLD: dict[str, object] = {"rate": _RATE_HZ, "duration": None}


def add_simulate(commands: Commands) -> None:
    """Add `simulate`."""
    simulate = add_command(
        commands,
        "simulate",
        run_simulate,
        "a rendered flight with exact truth out, as a session to replay",
        _SIMULATE,
        _MORE,
    )
    simulate.add_argument(
        "--out", type=NEW_FOLDER, required=True, metavar="SESSION", help="the folder to write; new or empty"
    )
    simulate.add_argument("--flight", choices=_FLIGHTS, default="landing", help="what is flown (default: landing)")
    add_simulated_flight(simulate, rate_hz=_RATE_HZ)
    simulate.add_argument("--duration", type=_positive, metavar="S", help="only the first so many s of the flight")
    simulate.add_argument("--faults", type=READ, metavar="FILE", help="what fails when, TOML; see below")
    simulate.add_argument("--rig", type=READ, metavar="FILE", help="your own stations, rig.toml")
    simulate.add_argument(
        "--pictures",
        choices=_FORMS,
        default="video",
        help="video: JPEG frames of quality 95, .avi; h264: .mp4, with groundstation[world]; lossless: FFV1, .avi; "
        "png: folders (default: video)",
    )
    simulate.add_argument(
        "--world", type=READ_TEXT, metavar="SEED|FILE", help="draw the whole world from a seed, or read it; see below"
    )
    simulate.add_argument("--grey", action="store_true", help="cameras without colours")
    simulate.add_argument(
        "--night",
        type=count,
        metavar="N",
        help="no flight: N pictures of the stars by each of two heads, for calibrate stars; only --seed holds",
    )


def _positive(text: str) -> float:
    return parse_number(text, "a number of s above 0, at most 1e6", lambda value: 0.0 < value <= 1e6)


def run_simulate(options: argparse.Namespace) -> int:
    """Film one flight and print what was written; returns the exit code."""
    if options.night is not None:
        refuse_with(options, "--night", {"world": None, **_OF_A_FLIGHT, **_OF_A_WORLD}, "only --seed holds for a night")
        return _run_night(options)
    if options.world is not None:
        refuse_with(options, "--world", {"seed": 0, **_OF_A_FLIGHT}, "a world has its own")
        if not options.world.isdecimal():
            refuse_with(options, f"--world {options.world}", _OF_A_WORLD, "the file states it")
        return _run_world(options)
    from groundstation.simulation.flights import FlightModelKind, FlightName
    from groundstation.simulation.picture_writer import PictureFormat
    from groundstation.simulation.render_flight import RenderRequest, render_flight

    request = RenderRequest(
        out=options.out,
        name=FlightName(options.flight),
        seed=options.seed,
        rate_hz=options.rate,
        duration_s=options.duration,
        wind_m_s=options.wind,
        faults=options.faults,
        rig=options.rig,
        form=PictureFormat("jpeg" if options.pictures == "video" else options.pictures),
        grey=options.grey,
        aircraft=FlightModelKind(options.aircraft),
    )
    with ProgressLine(sys.stderr, "simulate") as line:
        result = render_flight(request, line.update)
    print(f"filmed {result.pairs} pairs in {result.duration_s:.1f} s of flight")
    print(f"wrote {result.out}")
    return 0


def _run_world(options: argparse.Namespace) -> int:
    """Film a drawn or a stated world; returns the exit code."""
    from groundstation.simulation.world.draw_world import DURATION_S, draw_world
    from groundstation.simulation.world.render_world import render_world
    from groundstation.simulation.world.world_file import load_world

    text: str = options.world
    if text.isdecimal():
        duration = DURATION_S if options.duration is None else options.duration
        world = draw_world(int(text), duration_s=duration, frame_hz=options.rate)
    else:
        world = load_world(Path(text))
    with ProgressLine(sys.stderr, "simulate") as line:
        result = render_world(world, options.out, line.update)
    print(f"filmed {result.pairs} pairs in {result.duration_s:.1f} s of flight")
    print(f"wrote {result.folder}")
    return 0


def _run_night(options: argparse.Namespace) -> int:
    """Write a drawn night's pictures with the table, the rig as it is known, the site, and the true rig."""
    from calibration.stars.simulated.night_draw import draw_night
    from calibration.stars.simulated.night_folder import write_night
    from groundstation.simulation.session_folder import new_session_folder

    night = draw_night(options.seed, options.night)
    with ProgressLine(sys.stderr, "night", "picture") as line, new_session_folder(options.out) as draft:
        write_night(draft, night, options.seed, line.update)
    out = options.out
    print(f"wrote {out}: {sum(len(own) for own in night.pictures.values())} pictures; the true rig is truth.toml")
    print(f"groundstation calibrate stars --rig {out}/rig.toml --site {out}/site.toml --from {out} --out stars.toml")
    return 0
