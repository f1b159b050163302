"""Live cameras on the command line: `groundstation cameras list` and `show`."""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.number_arguments import finite_number, positive_number
from groundstation.cli.path_arguments import READ_TEXT, WRITTEN_FILE
from groundstation.cli.terminal import print_table
from groundstation.errors import InputError, UsageError
from groundstation.files.whole_file import write_whole

if TYPE_CHECKING:
    from groundstation.picture import Picture

_PICTURES = (".png", ".jpg", ".tif")

_LIST = """Look for cameras: GigE Vision on every network (extra gige), GenTL producers
(extra genicam), video devices of Linux."""
_LIST_MORE = """example:
  groundstation cameras list --cti /opt/vendor/producer.cti

exit code: 0 there are cameras; 1 there is none; 2 wrong usage"""
_SHOW = """Open a camera as `live` would, and print its settings, how fast and how
regularly its frames come, and how well its clock is known."""
_SHOW_MORE = """examples:
  groundstation cameras show gige:192.168.1.10 --seconds 10 --exposure-ms 4
  groundstation cameras show "genicam:12345678?cti=/opt/vendor/producer.cti"
  groundstation cameras show rtsp://192.168.1.20/stream1 --save picture.png

URL: genicam:SERIAL?cti=FILE, gige:ADDRESS, opencv:0, opencv:/dev/video0,
rtsp://..., http://..., file:PATH. A setting that is not given stays as the camera has
it; one that the camera does not keep is an error. More: docs/cameras.md

exit code: 0 frames came; 1 none came, or the camera is not there or refuses a
setting; 2 wrong usage; 130 interrupted"""


def add_cameras(commands: Commands) -> None:
    """Add `cameras` and its subcommands."""
    cameras = commands.add_parser("cameras", help="which live cameras there are, and what one delivers")
    kinds = cameras.add_subparsers(dest="cameras", metavar="WHAT", required=True)
    listing = add_command(kinds, "list", run_list, "which cameras there are", _LIST, _LIST_MORE)
    listing.add_argument(
        "--cti", type=READ_TEXT, action="append", default=[], metavar="FILE", help="a GenTL producer; may be repeated"
    )
    show = add_command(kinds, "show", run_show, "settings, rate, jitter and clock of one", _SHOW, _SHOW_MORE)
    show.add_argument("url", type=READ_TEXT, metavar="URL", help="which camera, see below")
    show.add_argument("--seconds", type=positive_number, default=5.0, metavar="S", help="how long to look (default: 5)")
    show.add_argument("--exposure-ms", type=positive_number, metavar="MS", help="exposure")
    show.add_argument("--gain", type=finite_number, metavar="G", help="gain, in the camera's unit")
    show.add_argument("--roi", type=_region, metavar="X,Y,W,H", help="region of the sensor, px")
    show.add_argument("--trigger", metavar="INPUT", help="off, or the input that triggers, as Line1")
    show.add_argument("--format", dest="pixel_format", metavar="NAME", help="pixel format, as BayerRG8")
    show.add_argument("--rate", type=positive_number, metavar="HZ", help="frames per second")
    show.add_argument(
        "--stamp", choices=("start", "middle", "end"), default="start", help="what the camera's stamp means"
    )
    show.add_argument(
        "--save", type=WRITTEN_FILE, metavar="FILE", help="write the last picture there: .png, .jpg, .tif"
    )


def run_list(options: argparse.Namespace) -> int:
    """Print the cameras that were found."""
    from groundstation.sources.cameras.listing import list_cameras

    found = list_cameras(options.cti, os.environ, Path("/dev"))
    print_table(found.cameras)
    for notice in found.notices:
        print(f"groundstation: {notice}", file=sys.stderr)
    if not found.cameras:
        print("groundstation: no camera found", file=sys.stderr)
    return 0 if found.cameras else 1


def run_show(options: argparse.Namespace) -> int:
    """Open a camera, measure for a while, print settings and rate."""
    from groundstation.sources.cameras.camera import CameraEvent, CameraSettings, CameraTiming, StampPoint
    from groundstation.sources.cameras.open_camera import open_camera
    from groundstation.sources.cameras.rate_report import (
        FrameTimes,
        format_rate,
        format_settings,
        frame_times,
        rate_report,
    )

    if options.save is not None:
        _check_writable(options.save)
    settings = CameraSettings(
        exposure_s=None if options.exposure_ms is None else options.exposure_ms * 1e-3,
        gain=options.gain,
        roi_px=options.roi,
        trigger=options.trigger,
        pixel_format=options.pixel_format,
        rate_hz=options.rate,
    )
    start = time.monotonic()

    def tell(event: CameraEvent) -> None:
        print(f"{event.t_s - start:8.2f} s  {event.kind}: {event.text}", file=sys.stderr)

    frames: list[FrameTimes] = []
    picture = None
    timing = CameraTiming(stamp=StampPoint(options.stamp))
    with open_camera(options.url, settings, clock=time.monotonic, on_event=tell, timing=timing) as camera:
        end = time.monotonic() + options.seconds
        while not camera.ended and time.monotonic() < end:
            frame = camera.read(0.2)
            if frame is not None:
                frames.append(frame_times(frame))
                picture = frame.picture
        found, counts, clock = camera.read_back, camera.counts, camera.clock_state
    if found is not None:
        print(format_settings(found))
    print(format_rate(rate_report(frames), counts, clock))
    if picture is None:
        print("groundstation: no frame came", file=sys.stderr)
        return 1
    if options.save is not None:
        _save(options.save, picture)
        print(f"wrote {options.save}")
    return 0


def _check_writable(path: Path) -> None:
    """Raise `InputError` before the camera is opened, if the picture could not be written."""
    if path.suffix.lower() not in _PICTURES:
        raise UsageError(str(path), got=f"ending {path.suffix!r}", wanted=", ".join(_PICTURES))
    if not path.parent.is_dir():
        raise InputError(str(path), got="no such folder", wanted="a folder that exists")


def _save(path: Path, picture: "Picture") -> None:
    """Write a picture in colour."""
    import cv2

    good, data = cv2.imencode(path.suffix.lower(), picture.whole())
    if not good:
        raise InputError(str(path), got="a picture that cannot be coded so", wanted=", ".join(_PICTURES))
    write_whole(path, data.tobytes())


def _region(text: str) -> tuple[int, int, int, int]:
    try:
        x, y, w, h = (int(part) for part in text.split(","))
    except ValueError:
        x = y = w = h = -1
    if min(x, y) < 0 or min(w, h) <= 0:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted X,Y,W,H in whole px")
    return x, y, w, h
