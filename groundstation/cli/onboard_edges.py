"""`groundstation onboard edges`: the runway's edges in a nose camera's video."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_command, add_result_folder, print_video_result
from groundstation.cli.path_arguments import READ
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


def add_edges(kinds: Commands) -> None:
    """Add `onboard edges`."""
    edges = add_command(
        kinds, "edges", run_edges, "nose-camera video in, the runway's edges in each frame out", _EDGES, _EDGES_MORE
    )
    edges.add_argument("video", type=READ, metavar="VIDEO", help="any video file that OpenCV reads")
    edges.add_argument("--camera", type=READ, required=True, metavar="FILE", help="lens, runway and start, TOML")
    edges.add_argument("--imu", type=READ, metavar="FILE", help="position and attitude over the video's time, CSV")
    add_result_folder(edges, ("edges.csv", "edges.mp4", "edges.rrd"))
    edges.add_argument("--no-rerun", action="store_true", help="do not write edges.rrd")


def run_edges(options: argparse.Namespace) -> int:
    """Track, print the summary and the paths; 1 if the video was cut short by a fault."""
    from groundstation.onboard.video import EdgesRequest, format_edges_summary, track_edges

    request = EdgesRequest(
        video=options.video, camera=options.camera, imu=options.imu, out=options.out, rerun=not options.no_rerun
    )
    with ProgressLine(sys.stderr, "edges", "frame") as line:
        result = track_edges(request, line.update)
    print_video_result(result, format_edges_summary(result))
    return 0 if result.fault is None else 1
