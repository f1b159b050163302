"""`groundstation track`: a video of one camera in, the aircraft's pixel in each frame out."""

import argparse
import math
import os
import sys

from groundstation.box import Box, box_of_size
from groundstation.cli.command_arguments import Commands, add_command, print_video_result
from groundstation.cli.number_arguments import take_negative_numbers
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine

_TRACK = """Try the detector on any video of one camera, without calibration: find the aircraft,
follow it, find it again after a loss, and write its pixel in each frame."""
_TRACK_MORE = """example:
  groundstation track approach.mp4 --out approach.csv --save-video approach-seen.mp4

FILE has one row for each frame: frame,t_s,u_px,v_px,x_px,y_px,w_px,h_px,status

exit code: 0 done; 1 the video is at fault, and what came before the fault is
written; 2 wrong usage; 130 interrupted"""


def add_track(commands: Commands) -> None:
    """Add `track`."""
    track = add_command(
        commands,
        "track",
        run_track,
        "one video of one camera in, the aircraft's pixel in each frame out",
        _TRACK,
        _TRACK_MORE,
    )
    # a box may begin beyond the left border: "-5,20,40,30"
    take_negative_numbers(track)
    track.add_argument("video", type=READ, metavar="VIDEO", help="any video file that OpenCV reads")
    track.add_argument("--out", type=WRITTEN_FILE, required=True, metavar="FILE", help="the table to write, CSV")
    track.add_argument(
        "--init", type=_box, metavar="X,Y,W,H", help="the aircraft is in this box of the first frame, px"
    )
    track.add_argument("--from-frame", type=int, default=0, metavar="N", help="start at this frame, counted from 0")
    track.add_argument("--to-frame", type=int, metavar="M", help="stop after this frame")
    track.add_argument(
        "--detector",
        choices=("learned", "classic"),
        default="learned",
        help="classic: by contrast alone, in half the time; learned: with the learned channel",
    )
    track.add_argument("--view", action="store_true", help="show it live in the Rerun viewer")
    track.add_argument(
        "--save-video", type=WRITTEN_FILE, metavar="FILE.mp4", help="write the pictures with what was found"
    )


def _box(text: str) -> Box[float]:
    """Return the four numbers of --init."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError:
        x = y = w = h = math.nan
    if not all(math.isfinite(v) for v in (x, y, w, h)) or w < 1 or h < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted X,Y,W,H in px, W and H at least 1")
    return box_of_size(x, y, w, h)


def run_track(options: argparse.Namespace) -> int:
    """Track, print the summary and the paths; 1 if the video was cut short by a fault."""
    from groundstation.detection.config import DetectorKind
    from groundstation.single_camera.track_video import TrackRequest, format_track_summary, track_video

    request = TrackRequest(
        video=options.video,
        out=options.out,
        init=options.init,
        from_frame=options.from_frame,
        to_frame=options.to_frame,
        save_video=options.save_video,
        view=options.view,
        detector=DetectorKind(options.detector),
    )
    with ProgressLine(sys.stderr, "track", "frame") as line:
        result = track_video(request, line.update, os.environ)
    print_video_result(result, format_track_summary(result))
    if result.start_confirmed is False:
        print("groundstation: nothing was found in the box of --init: the whole picture was searched", file=sys.stderr)
    return 0 if result.fault is None else 1
