"""`groundstation onboard pose`: where a camera was, from the corners of a runway in its pictures."""

import argparse
import math
import sys
from collections.abc import Iterator

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.number_arguments import parse_number
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.errors import InputError, UsageError

_POSE = """Where the camera was when each picture was taken, from the four corners of the runway
in it, by unit dual quaternion; no first guess is needed. The frame: origin in the
middle of the near threshold, y along the runway towards the aircraft, z up."""
_POSE_MORE = """example:
  groundstation onboard pose --corners corners.csv --runways runways_database.json \\
      --camera nose.toml --out poses.csv

corners.csv has filename, x_A, y_A … x_D, y_D in px, in any order; file names start
with AIRPORT_RUNWAY_, as in LFRS_03_35_10.jpeg. The runways are JSON: airport,
runway, corners A to D with latitude, longitude and altitude. nose.toml has
image_size_px, focal_px, principal_point_px and distortion; that of `onboard
edges` and `onboard fly` will do.

poses.csv has filename,x_m,y_m,z_m,qw,qx,qy,qz,range_m,reprojection_px,status;
the quaternion is runway_from_camera; status is ok, uncertain (the corners
hardly determine it), residual (a pose that does not fit the corners' noise), rolled (it
fits, with the aircraft rolled by more than 60 deg), no_pose or no_corners (empty cells)

--rerun poses.rrd also draws them: the runway, and picture by picture the camera,
its range and how well it fits; rerun --bind 127.0.0.1 poses.rrd opens it

exit code: 0 done; 1 a file is at fault, or most pictures are rolled; 2 wrong usage"""


def add_pose(kinds: Commands) -> None:
    """Add `onboard pose`."""
    pose = add_command(kinds, "pose", run_pose, "from the four corners of a runway in each picture", _POSE, _POSE_MORE)
    pose.add_argument("--corners", type=READ, required=True, metavar="FILE", help="table of corners, CSV")
    pose.add_argument("--runways", type=READ, required=True, metavar="FILE", help="the runways, JSON")
    pose.add_argument("--camera", type=READ, required=True, metavar="FILE", help="the camera's lens, TOML")
    pose.add_argument("--out", type=WRITTEN_FILE, required=True, metavar="FILE", help="the table to write, CSV")
    pose.add_argument(
        "--rerun", type=WRITTEN_FILE, metavar="FILE.rrd", help="also draw the poses: a Rerun recording to write"
    )
    pose.add_argument(
        "--sigma-px",
        type=_sigma,
        default=1.0 / math.sqrt(12.0),
        metavar="PX",
        help="noise of a corner, 1 sigma (default 0.29: whole pixels)",
    )


def _sigma(text: str) -> float:
    """Return a standard deviation in px."""
    return parse_number(text, "a number above 0 to 1000 in px", lambda value: 1e-6 <= value <= 1e3)


def run_pose(options: argparse.Namespace) -> int:
    """Solve every picture, write the table, draw it if asked, print how many of each status; returns the exit code."""
    # imported here: --help and a wrong option answer at once
    from calibration.lens.lens_files import read_lens
    from groundstation.onboard.edges.camera_file import is_camera_file, load_nose_camera
    from groundstation.onboard.edges.pose import Attitude
    from groundstation.onboard.pose.camera_roll import is_rolled, roll_doubt, roll_of
    from groundstation.onboard.pose.corner_labelling import solve_corners
    from groundstation.onboard.pose.pose_files import Runways, read_corners, write_poses
    from groundstation.onboard.pose.pose_solver import PoseStatus, RunwayPose
    from groundstation.onboard.pose.runway import Runway

    if options.out.is_dir():
        raise InputError(str(options.out), got="a folder", wanted="--out with a file's name")
    if options.rerun is not None:
        if options.rerun.suffix != ".rrd":
            wanted = "a name that ends in .rrd, which the viewer opens"
            raise UsageError("--rerun", got=str(options.rerun), wanted=wanted)
        if options.rerun.is_dir():
            raise InputError(str(options.rerun), got="a folder", wanted="--rerun with a file's name")
    nose = load_nose_camera(options.camera) if is_camera_file(options.camera) else None
    lens, mount = (read_lens(options.camera).lens, Attitude()) if nose is None else (nose.lens, nose.mount)
    runways = Runways(options.runways)
    outside = 0
    rolls: list[float | None] = []
    solved: list[tuple[str, Runway | None, RunwayPose | None, str]] = []

    def rows() -> Iterator[tuple[str, RunwayPose | None, str]]:
        nonlocal outside
        for row in read_corners(options.corners):
            outside += row.pixels is not None and bool(((row.pixels < -1.0) | (row.pixels > lens.image_size_px)).any())
            runway, pose, status = None, None, "no_corners"
            if row.pixels is not None:
                runway = runways.find(row.airport, row.runway, row.where)
                found = solve_corners(runway, row.pixels, lens, options.sigma_px)
                pose, status = found.pose, found.status.value
            if pose is not None:
                rolls.append(roll_of(pose, mount))
                status = "rolled" if status == PoseStatus.OK.value and is_rolled(rolls[-1]) else status
            if options.rerun is not None:
                solved.append((row.filename, runway, pose, status))
            yield row.filename, pose, status

    counts = write_poses(options.out, rows())
    total = sum(counts.values())
    print(f"{total} pictures: " + (", ".join(f"{n} {status}" for status, n in sorted(counts.items())) or "none"))
    doubt = roll_doubt(rolls)
    if not doubt and 2 * outside > max(total - counts.get("no_corners", 0), 0):
        w, h = lens.image_size_px
        doubt = f"{outside} pictures have corners outside of {w}×{h} px: is the camera of another resolution?"
    if doubt:
        print(f"groundstation: {options.corners}: {doubt}", file=sys.stderr)
    print(f"wrote {options.out}")
    if options.rerun is not None:
        from groundstation.onboard.pose_sinks import DrawnPose, draw_poses

        drawn = (DrawnPose(filename=name, runway=on, pose=pose, status=word) for name, on, pose, word in solved)
        draw_poses(options.rerun, lens, drawn)
        print(f"wrote {options.rerun}")
    return 1 if roll_doubt(rolls) else 0
