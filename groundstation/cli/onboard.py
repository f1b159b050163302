"""The part of the command line for the aircraft's own camera: `groundstation onboard WHAT …`."""

import argparse
import sys
from collections.abc import Callable

from groundstation.cli.onboard_fly import add_fly
from groundstation.cli.onboard_pose import add_pose
from groundstation.cli.path_arguments import READ, WrittenFolder
from groundstation.cli.progress import ProgressLine

_EDGES = """Find and track the runway's edges in the video of an aircraft's nose camera."""
_EDGES_MORE = """example:
  groundstation onboard edges nose.mp4 --camera nose.toml --imu imu.csv --out out/nose

the camera file: a station's lens keys (image_size_px, focal_px,
principal_point_px, distortion), mount_deg, [runway] width_m, length_m,
heading_deg, lat_deg, lon_deg, alt_m, and without --imu [start] height_m,
distance_m, roll_deg, pitch_deg, yaw_deg; motion then comes from the pictures

the IMU table: t_s, roll_deg, pitch_deg, yaw_deg, and lat_deg, lon_deg, alt_m or
x_m, y_m, z_m from the threshold (y back along the approach, z up)

DIR gets edges.csv, edges.mp4 and edges.rrd

exit code: 0 done; 1 an input is at fault, and what came before the fault is
written; 2 wrong usage; 130 interrupted"""


def add_onboard(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `onboard` with what it can do."""
    onboard = commands.add_parser("onboard", help="the aircraft's own camera: runway edges, runway pose, trajectory")
    kinds = onboard.add_subparsers(dest="what", metavar="WHAT", required=True)
    edges = kinds.add_parser(
        "edges",
        help="nose-camera video in, the runway's edges in each frame out",
        description=_EDGES,
        epilog=_EDGES_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    edges.add_argument("video", type=READ, metavar="VIDEO", help="any video file that OpenCV reads")
    edges.add_argument("--camera", type=READ, required=True, metavar="FILE", help="lens, runway and start, TOML")
    edges.add_argument("--imu", type=READ, metavar="FILE", help="position and attitude over the video's time, CSV")
    edges.add_argument(
        "--out",
        type=WrittenFolder(("edges.csv", "edges.mp4", "edges.rrd")),
        required=True,
        metavar="DIR",
        help="where the results go; made if missing",
    )
    edges.add_argument("--no-rerun", action="store_true", help="do not write edges.rrd")
    edges.set_defaults(run_onboard=_run_edges)
    add_pose(kinds)
    add_fly(kinds)


def run_onboard(options: argparse.Namespace) -> int:
    """Run one of them."""
    run: Callable[[argparse.Namespace], int] = options.run_onboard
    return run(options)


def _run_edges(options: argparse.Namespace) -> int:
    """Track, print the summary and the paths; 1 if the video was cut short by a fault."""
    from groundstation.onboard.video import EdgesRequest, format_edges_summary, track_edges

    request = EdgesRequest(
        video=options.video, camera=options.camera, imu=options.imu, out=options.out, rerun=not options.no_rerun
    )
    with ProgressLine(sys.stderr, "edges", "frame") as line:
        result = track_edges(request, line.update)
    print(format_edges_summary(result))
    for path in result.files:
        print(f"wrote {path}")
    if result.damage is not None:
        print(f"groundstation: {result.damage}", file=sys.stderr)
    if result.fault is not None:
        print(f"groundstation: fault in the video: {result.fault}", file=sys.stderr)
    return 0 if result.fault is None else 1
