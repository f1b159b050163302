"""`groundstation onboard fly`: the aircraft's trajectory from its nose camera and IMU."""

import argparse
import sys
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_command, add_result_folder, print_video_result
from groundstation.cli.number_arguments import parse_number
from groundstation.cli.path_arguments import READ
from groundstation.cli.progress import ProgressLine
from groundstation.cli.wrong_usage import refuse_without
from groundstation.errors import UsageError

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
right, down); with roll_deg, pitch_deg, yaw_deg and a position as well, as for `onboard
edges`, the first edges are looked for by these, without by [start]

--ground-track: track.csv of a replay, or a TUM trajectory, on the same clock; it is
compared with the aircraft's own and never used for it

DIR gets track.csv, track.tum, pictures.csv, fly.mp4, fly.rrd, and with --ground-track
agreement.csv

exit code: 0 done; 1 an input is at fault, no picture's pose could be used (with the
reason), or the ground's track and the aircraft's own do not agree; 2 wrong usage;
130 interrupted"""
_FILES = ("track.csv", "track.tum", "pictures.csv", "fly.mp4", "fly.rrd", "agreement.csv")


def add_fly(kinds: Commands) -> None:
    """Add `onboard fly`."""
    fly = add_command(
        kinds, "fly", run_fly, "nose-camera video and IMU log in, the trajectory over the runway out", _FLY, _FLY_MORE
    )
    fly.add_argument("video", type=READ, metavar="VIDEO", help="any video file that OpenCV reads")
    fly.add_argument("--camera", type=READ, required=True, metavar="FILE", help="lens, runway, start, unit; TOML")
    fly.add_argument("--imu", type=READ, required=True, metavar="FILE", help="the inertial unit's samples, CSV")
    add_result_folder(fly, _FILES)
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


def run_fly(options: argparse.Namespace) -> int:
    """Follow the runway, print the summary and the paths; returns the exit code."""
    from groundstation.onboard.fly import FlyRequest, GroundTrack, fly_video, format_fly_summary
    from groundstation.onboard.visual_inertial.config import CornerMethod

    ground = None
    if options.ground_track is None:
        refuse_without(options, "--ground-track", {"threshold_m": (0.0, 0.0, 0.0), "ground_sigma_m": 1.0})
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
    print_video_result(result, format_fly_summary(result))
    if result.unused:
        print(f"groundstation: {result.unused}", file=sys.stderr)
    return 0 if result.fault is None and result.agrees and not result.unused else 1


def _runway(options: argparse.Namespace) -> tuple[Path, str, str] | None:
    if options.runways is None and options.runway is None:
        return None
    if options.runways is None or options.runway is None:
        missing = "--runways" if options.runways is None else "--runway"
        raise UsageError(missing, got="nothing", wanted="--runways FILE and --runway AIRPORT_RUNWAY together")
    airport, _, name = options.runway.partition("_")
    if not airport or not name:
        raise UsageError("--runway", got=options.runway, wanted="AIRPORT_RUNWAY, such as LFRS_03")
    return options.runways, airport, name
