"""`groundstation onboard fly` and `onboard render`: a trajectory by nose camera and IMU, a flight to try it on."""

import argparse
import sys
from pathlib import Path

from groundstation.cli.number_arguments import parse_number
from groundstation.cli.path_arguments import READ, WrittenFolder
from groundstation.cli.progress import ProgressLine
from groundstation.errors import InputError

_FLY = """Where the aircraft flew, relative to the runway, from the video of its nose camera and
its inertial unit: edges are followed, corners measured, each picture's pose found by
unit dual quaternion, and an inertial filter carries it through what is not seen."""
_FLY_MORE = """example:
  groundstation onboard render --out out/flight
  groundstation onboard fly out/flight/nose.avi --camera out/flight/nose.toml \\
      --imu out/flight/imu.csv --out out/fly

the camera file: as for `onboard edges`; [runway] width_m and length_m must be there and
be those of the runway, or name a surveyed one by --runways and --runway. [imu]
camera_in_body_m and noise are optional

the IMU table: t_s, force_x_m_s2 … force_z_m_s2, rate_x_deg_s … rate_z_deg_s (forward,
right, down); with roll_deg, pitch_deg, yaw_deg and a place besides, as for `onboard
edges`, the first edges are looked for by these, without by [start]

--ground-track: track.csv of a replay, or a TUM trajectory, on the same clock; it is
compared with the aircraft's own and never used for it

DIR gets track.csv, track.tum, pictures.csv, fly.mp4, fly.rrd, and with --ground-track
agreement.csv

exit code: 0 done; 1 an input is at fault, no picture's pose could be used (why is
said), or the ground's track and the aircraft's own do not agree; 2 wrong usage;
130 interrupted"""
_FILES = ("track.csv", "track.tum", "pictures.csv", "fly.mp4", "fly.rrd", "agreement.csv")
_RENDER = """Render a nose camera's video of an approach, with the inertial unit's log and the exact
truth, for `onboard fly` and `onboard edges` to be tried on."""
_RENDER_MORE = """example:
  groundstation onboard render --scene dusk --seed 3 --out out/flight

DIR gets nose.avi (no loss), nose.toml, imu.csv and truth.csv; one that is there already
is left as it is, and nothing is rendered

exit code: 0 done; 1 the folder or --motion is at fault; 2 wrong usage; 130 interrupted"""
SCENES = ("day", "haze", "dusk", "night", "short-final")
_MOST_SEED_DIGITS = 9


def add_fly(kinds: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `onboard fly` and `onboard render`."""
    fly = kinds.add_parser(
        "fly",
        help="nose-camera video and IMU log in, the trajectory over the runway out",
        description=_FLY,
        epilog=_FLY_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    fly.add_argument("video", type=READ, metavar="VIDEO", help="any video file that OpenCV reads")
    fly.add_argument("--camera", type=READ, required=True, metavar="FILE", help="lens, runway, start, unit; TOML")
    fly.add_argument("--imu", type=READ, required=True, metavar="FILE", help="the inertial unit's samples, CSV")
    fly.add_argument(
        "--out", type=WrittenFolder(_FILES), required=True, metavar="DIR", help="where the results go; made if missing"
    )
    fly.add_argument("--runways", type=READ, metavar="FILE", help="surveyed runways, JSON, as for `onboard pose`")
    fly.add_argument("--runway", metavar="AIRPORT_RUNWAY", help="which of them, such as LFRS_03")
    fly.add_argument(
        "--corners",
        choices=("edges", "sides", "susan"),
        default="edges",
        help="how corners are measured: tracked edges with measured thresholds (default), all four sides, or SUSAN",
    )
    fly.add_argument("--ground-track", type=READ, metavar="FILE", help="the ground station's track, to compare with")
    fly.add_argument(
        "--threshold-m",
        type=_place,
        default=(0.0, 0.0, 0.0),
        metavar="X,Y,Z",
        help="the near threshold's middle in the ground track's frame, m (default 0,0,0)",
    )
    fly.add_argument(
        "--ground-sigma-m",
        type=_sigma,
        default=1.0,
        metavar="M",
        help="of each coordinate of a ground track that has no covariance (default 1)",
    )
    fly.add_argument("--no-rerun", action="store_true", help="do not write fly.rrd")
    fly.set_defaults(run_onboard=run_fly)
    render = kinds.add_parser(
        "render",
        help="a rendered approach with exact truth, to try the others on",
        description=_RENDER,
        epilog=_RENDER_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    render.add_argument(
        "--out",
        type=WrittenFolder(("nose.avi", "nose.toml", "imu.csv", "truth.csv")),
        required=True,
        metavar="DIR",
        help="where the files go; made if missing",
    )
    render.add_argument("--scene", choices=SCENES, default="day", help="airfield and light (default day)")
    render.add_argument("--seed", type=_seed, default=1, metavar="N", help="of gusts, sensors and noise (default 1)")
    render.add_argument(
        "--motion",
        choices=("waves", "jsbsim"),
        default="waves",
        help="how it flies: smooth waves about the glide path (default), or JSBSim's C172 in turbulence",
    )
    render.add_argument("--frames", type=_count, default=130, metavar="N", help="pictures at 10 Hz (default 130)")
    render.set_defaults(run_onboard=run_render)


def _place(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted three numbers, as in -5.4,120,0.3") from None
    if not all(abs(value) < 1e6 for value in (x, y, z)):
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted three numbers of m")
    return x, y, z


def _sigma(text: str) -> float:
    return parse_number(text, "a number above 0 in m", lambda value: 1e-4 <= value <= 1e4)


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or len(text) > _MOST_SEED_DIGITS:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a whole number from 0 to 999999999")
    return int(text)


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or not 2 <= int(text) <= 130:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a number from 2 to 130")
    return int(text)


def run_fly(options: argparse.Namespace) -> int:
    """Follow the runway, print the summary and the paths; returns the exit code."""
    from groundstation.onboard.fly import FlyRequest, GroundTrack, fly_video, format_fly_summary
    from groundstation.onboard.visual_inertial.config import CornerMethod

    ground = None
    if options.ground_track is not None:
        ground = GroundTrack(path=options.ground_track, threshold_m=options.threshold_m, sigma_m=options.ground_sigma_m)
    request = FlyRequest(
        video=options.video,
        camera=options.camera,
        imu=options.imu,
        out=options.out,
        runway=_runway(options),
        corners=CornerMethod(options.corners),
        ground=ground,
        rerun=not options.no_rerun,
    )
    with ProgressLine(sys.stderr, "fly", "frame") as line:
        result = fly_video(request, line.update)
    print(format_fly_summary(result))
    for path in result.files:
        print(f"wrote {path}")
    if result.damage is not None:
        print(f"groundstation: {result.damage}", file=sys.stderr)
    if result.fault is not None:
        print(f"groundstation: fault in the video: {result.fault}", file=sys.stderr)
    if result.unused:
        print(f"groundstation: {result.unused}", file=sys.stderr)
    return 0 if result.fault is None and result.agrees and not result.unused else 1


def _runway(options: argparse.Namespace) -> tuple[Path, str, str] | None:
    if options.runways is None and options.runway is None:
        return None
    if options.runways is None or options.runway is None:
        missing = "--runways" if options.runways is None else "--runway"
        raise InputError(missing, got="nothing", wanted="--runways FILE and --runway AIRPORT_RUNWAY together")
    airport, _, name = options.runway.partition("_")
    if not airport or not name:
        raise InputError("--runway", got=options.runway, wanted="AIRPORT_RUNWAY, such as LFRS_03")
    return options.runways, airport, name


def run_render(options: argparse.Namespace) -> int:
    """Render and write; returns the exit code."""
    from groundstation.onboard.render import render_flight

    scene = SCENES.index(options.scene)
    with ProgressLine(sys.stderr, "render", "frame") as line:
        files = render_flight(options.out, scene, options.seed, options.frames, options.motion, line.update)
    for path in files:
        print(f"wrote {path}")
    return 0
