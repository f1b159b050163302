"""The part of the command line that simulates: `groundstation simulate --out SESSION …`."""

import argparse
import sys

from groundstation.cli.number_arguments import parse_number
from groundstation.cli.path_arguments import NEW_FOLDER, READ
from groundstation.cli.progress import ProgressLine

_SIMULATE = """Fly an aircraft past two stations, film it, and write a session folder with exact truth,
as a laboratory would have it after a flight: videos, tables of frame times, PTU
angles and DGPS. Everything random comes from the seed."""
_MORE = """examples:
  groundstation simulate --out flights/one
  groundstation simulate --out flights/two --flight take-off --rate 30 --wind 5 --seed 7
  groundstation replay flights/two --out out/two

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
_FORMS = ("video", "lossless", "png")
_MAX_RATE_HZ = 200.0
_MAX_WIND_M_S = 15.0


def add_simulate(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `simulate`."""
    simulate = commands.add_parser(
        "simulate",
        help="a rendered flight with exact truth out, as a session to replay",
        description=_SIMULATE,
        epilog=_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    simulate.add_argument(
        "--out", type=NEW_FOLDER, required=True, metavar="SESSION", help="the folder to write; new or empty"
    )
    simulate.add_argument("--flight", choices=_FLIGHTS, default="landing", help="what is flown (default: landing)")
    simulate.add_argument("--seed", type=whole_number, default=0, metavar="N", help="of everything random (default: 0)")
    simulate.add_argument(
        "--rate", type=pairs_per_s, default=10.0, metavar="HZ", help="stereo pairs per s (default: 10)"
    )
    simulate.add_argument("--duration", type=_positive, metavar="S", help="only the first so many s of the flight")
    simulate.add_argument(
        "--wind", type=wind_m_s, default=0.0, metavar="M_S", help="gusts as in such a wind, up to 15 m/s (default: 0)"
    )
    simulate.add_argument(
        "--aircraft",
        choices=("waves", "jsbsim"),
        default="waves",
        help="what moves it in the wind: waves, or JSBSim's C172 in Milspec turbulence, an optional extra",
    )
    simulate.add_argument("--faults", type=READ, metavar="FILE", help="what fails when, TOML; see below")
    simulate.add_argument("--rig", type=READ, metavar="FILE", help="your own stations, rig.toml")
    simulate.add_argument(
        "--pictures",
        choices=_FORMS,
        default="video",
        help="video: JPEG frames of quality 95, .avi; lossless: FFV1, .mkv; png: folders (default: video)",
    )
    simulate.add_argument("--grey", action="store_true", help="cameras without colours")


def _positive(text: str) -> float:
    return parse_number(text, "a number of s above 0", lambda value: 0.0 < value <= 1e6)


def pairs_per_s(text: str) -> float:
    """Return the rate that --rate asks for, Hz."""
    return parse_number(
        text, f"pairs per s, above 0, up to {_MAX_RATE_HZ:g}", lambda value: 0.0 < value <= _MAX_RATE_HZ
    )


def wind_m_s(text: str) -> float:
    """Return the wind that --wind asks for, m/s."""
    return parse_number(text, f"m/s from 0 to {_MAX_WIND_M_S:g}", lambda value: 0.0 <= value <= _MAX_WIND_M_S)


def whole_number(text: str) -> int:
    """Return the whole number that --seed asks for."""
    return int(
        parse_number(text, "a whole number from 0", lambda value: 0.0 <= value <= 2.0**53 and value.is_integer())
    )


def run_simulate(options: argparse.Namespace) -> int:
    """Film one flight and print what was written; returns the exit code."""
    from groundstation.simulation.flights import FlightModelKind, FlightName
    from groundstation.simulation.render_flight import RenderRequest, render_flight
    from groundstation.simulation.rendered_session_folder import PictureFormat

    request = RenderRequest(
        out=options.out,
        name=FlightName(options.flight),
        seed=options.seed,
        rate_hz=options.rate,
        duration_s=options.duration,
        wind_m_s=options.wind,
        faults=options.faults,
        rig=options.rig,
        form=PictureFormat(options.pictures),
        grey=options.grey,
        aircraft=FlightModelKind(options.aircraft),
    )
    with ProgressLine(sys.stderr, "simulate") as line:
        result = render_flight(request, line.update)
    print(f"filmed {result.pairs} pairs in {result.duration_s:.1f} s of flight")
    print(f"wrote {result.out}")
    return 0
