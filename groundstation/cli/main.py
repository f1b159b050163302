"""The command line: `groundstation COMMAND …`."""

import argparse
import math
import os
import sys
from collections.abc import Mapping, MutableMapping, Sequence

from groundstation import __version__
from groundstation.cli.calibrate import add_calibrate, run_calibrate
from groundstation.cli.cameras import add_cameras, run_cameras
from groundstation.cli.evaluate import add_evaluate, run_evaluate
from groundstation.cli.import_session import add_import, run_import
from groundstation.cli.live import add_live, run_check, run_live
from groundstation.cli.number_arguments import parse_number, take_negative_numbers
from groundstation.cli.onboard import add_onboard, run_onboard
from groundstation.cli.path_arguments import READ, WRITTEN_FILE, WrittenFolder, check_paths
from groundstation.cli.progress import ProgressLine
from groundstation.cli.ptu import add_ptu, run_ptu
from groundstation.cli.recording import add_convert, add_recover, run_convert, run_recover
from groundstation.cli.reproduce import add_reproduce, run_reproduce
from groundstation.cli.simulate import add_simulate, run_simulate
from groundstation.cli.terminal import print_line
from groundstation.cli.time_span import add_span
from groundstation.cli.view import add_view, run_view
from groundstation.errors import GroundstationError, UsageError
from groundstation.replay.result_files import REPLAY_FILES

_REPLAY = """Replay a recorded session: find the aircraft in every camera, track it in 3-D,
compare with DGPS and truth, and write track.csv, triangulation.csv,
detections.csv, track.tum, summary.json, report.html and session.rrd into the
output folder."""
_REPLAY_MORE = """example:
  groundstation replay recordings/landing-1 --out out/landing-1 --from 20

exit code: 0 done; 1 the recording is at fault, and what came before the fault
is written; 2 wrong usage; 130 interrupted"""
_TRACK = """Try the detector on any video of one camera, without calibration: find the aircraft,
follow it, find it again after a loss, and write its pixel in each frame."""
_TRACK_MORE = """example:
  groundstation track approach.mp4 --out approach.csv --save-video approach-seen.mp4

FILE has one row for each frame: frame,t_s,u_px,v_px,x_px,y_px,w_px,h_px,status

exit code: 0 done; 1 the video is at fault, and what came before the fault is
written; 2 wrong usage; 130 interrupted"""
_PLAN = """Plan a site: which accuracy to expect at which range, from stations, lens,
pan-tilt units, the quality of the calibration, and the aircraft; before anyone
drives out."""
_PLAN_MORE = """example:
  groundstation plan docs/site-example.toml --out out/plan

DIR gets plan.csv, and the picture plan.png and plan.svg

exit code: 0 done; 1 the site's file is at fault; 2 wrong usage; 130 interrupted"""
_CONFIG = """Print the whole tuning as TOML, with every default that FILE does not change: a file to start from for
replay's --config."""
# FFmpeg and OpenCV write directly to the terminal; the program prints its own message
_QUIET = {"OPENCV_FFMPEG_LOGLEVEL": "-8", "OPENCV_LOG_LEVEL": "ERROR"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 the input stopped it, 2 wrong usage, 130 interrupted."""
    parser = build_parser()
    options = parser.parse_args(arguments)
    if options.command is None:
        parser.print_help(sys.stderr)
        return 2
    _silence(os.environ, _QUIET)
    try:
        check_paths(parser, options)
        return _COMMANDS[options.command](options)
    except BrokenPipeError:
        # whoever read our output has gone, as in `… | head`; nothing more can be said there
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except GroundstationError as error:
        print_line(f"groundstation: {error}", sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:
        # a full disk or a pulled cable: a traceback would not help
        print_line(f"groundstation: {error}", sys.stderr)
        return 1
    except KeyboardInterrupt:
        print_line("groundstation: interrupted; the tables hold what was done until then", sys.stderr)
        return 130


def _silence(environment: MutableMapping[str, str], defaults: Mapping[str, str]) -> None:
    """Set the libraries' log levels unless the user has set them; they are read at first use."""
    for name, value in defaults.items():
        environment.setdefault(name, value)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line; the documentation prints its help."""
    parser = argparse.ArgumentParser(
        prog="groundstation",
        description="Where is the approaching aircraft, in 3-D, from two cameras on pan-tilt units; without GNSS.",
    )
    parser.add_argument("--version", action="version", version=f"groundstation {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    _add_replay(commands)
    _add_track(commands)
    _add_plan(commands)
    add_calibrate(commands)
    add_import(commands)
    add_recover(commands)
    add_convert(commands)
    add_cameras(commands)
    add_live(commands)
    add_onboard(commands)
    add_ptu(commands)
    add_simulate(commands)
    add_view(commands)
    add_evaluate(commands)
    add_reproduce(commands)
    config = commands.add_parser("config", help="print the tuning with its defaults, as TOML", description=_CONFIG)
    config.add_argument("--config", type=READ, metavar="FILE", help="what differs from the defaults, TOML")
    return parser


def _add_replay(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    replay = commands.add_parser(
        "replay",
        help="recorded stereo session in, scored 3-D track out",
        description=_REPLAY,
        epilog=_REPLAY_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    replay.add_argument(
        "session", type=READ, metavar="SESSION", help="session folder (session.toml, rig.toml, videos …) or .mcap"
    )
    replay.add_argument(
        "--out",
        type=WrittenFolder(REPLAY_FILES),
        required=True,
        metavar="DIR",
        help="where the results go; made if missing",
    )
    replay.add_argument("--rig", type=READ, metavar="FILE", help="another rig than the session's rig.toml")
    replay.add_argument(
        "--config",
        type=READ,
        metavar="FILE",
        help="tuning, TOML; what it leaves out keeps its default (all of them: groundstation config)",
    )
    add_span(replay)
    replay.add_argument(
        "--learn-until",
        type=_seconds,
        metavar="S",
        help="let DGPS teach the filter the rig's errors up to this DGPS time, s; after it DGPS only compares",
    )
    replay.add_argument(
        "--smooth", action="store_true", help="also smooth over the whole flight: smoothed.csv, a row in the accuracy"
    )
    replay.add_argument(
        "--record", type=WRITTEN_FILE, metavar="FILE.mcap", help="also record what was consumed and answered"
    )
    recording = replay.add_mutually_exclusive_group()
    recording.add_argument("--view", action="store_true", help="open the Rerun recording when done")
    recording.add_argument("--no-rerun", action="store_true", help="do not write session.rrd")


def _add_track(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    track = commands.add_parser(
        "track",
        help="one video of one camera in, the aircraft's pixel in each frame out",
        description=_TRACK,
        epilog=_TRACK_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
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
    track.add_argument("--view", action="store_true", help="show it live in the Rerun viewer")
    track.add_argument(
        "--save-video", type=WRITTEN_FILE, metavar="FILE.mp4", help="write the pictures with what was found"
    )


def _add_plan(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    plan = commands.add_parser(
        "plan",
        help="a site on paper in, the accuracy to expect over range out",
        description=_PLAN,
        epilog=_PLAN_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    plan.add_argument("site", type=READ, metavar="SITE", help="the site, TOML (example: docs/site-example.toml)")
    plan.add_argument(
        "--out",
        type=WrittenFolder(("plan.csv", "plan.png", "plan.svg")),
        metavar="DIR",
        help="where table and picture go; made if missing",
    )


def _seconds(text: str) -> float:
    """Return a finite time."""
    return parse_number(text, "a time in s")


def _box(text: str) -> tuple[float, float, float, float]:
    """Return the four numbers of --init."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError:
        x = y = w = h = math.nan
    if not all(math.isfinite(v) for v in (x, y, w, h)) or w <= 0 or h <= 0:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted X,Y,W,H in px, W and H above 0")
    return x, y, w, h


def _track(options: argparse.Namespace) -> int:
    """Track, print the summary and the paths; 1 if the video was cut short by a fault."""
    from groundstation.single_camera.track_video import TrackRequest, format_track_summary, track_video

    request = TrackRequest(
        video=options.video,
        out=options.out,
        init=options.init,
        from_frame=options.from_frame,
        to_frame=options.to_frame,
        save_video=options.save_video,
        view=options.view,
    )
    with ProgressLine(sys.stderr, "track", "frame") as line:
        result = track_video(request, line.update, os.environ)
    print(format_track_summary(result))
    for path in result.files:
        print(f"wrote {path}")
    if result.start_confirmed is False:
        print("groundstation: nothing was found in the box of --init: the whole picture was searched", file=sys.stderr)
    if result.damage is not None:
        print(f"groundstation: {result.damage}", file=sys.stderr)
    if result.fault is not None:
        print(f"groundstation: fault in the video: {result.fault}", file=sys.stderr)
    return 0 if result.fault is None else 1


def _plan(options: argparse.Namespace) -> int:
    """Print the forecast and the paths."""
    from groundstation.planning.plan import plan
    from groundstation.planning.plan_table import format_plan

    result = plan(options.site, options.out)
    print(format_plan(result.site, result.forecast))
    if result.files:
        print()
    for path in result.files:
        print(f"wrote {path}")
    return 0


def _config(options: argparse.Namespace) -> int:
    """Print the resolved tuning."""
    from groundstation.tracking.config import config_to_mapping, config_to_toml, load_config

    print(config_to_toml(config_to_mapping(load_config(options.config))))
    return 0


def _replay(options: argparse.Namespace) -> int:
    """Replay, print the table and the paths; 1 if the recording was cut short by a fault."""
    # imported here, so that --help and usage errors respond without delay
    from groundstation.evaluation.accuracy_table import format_accuracy_table
    from groundstation.replay.replay import ReplayRequest, replay
    from groundstation.viewer.viewer_process import open_viewer, video_notice

    request = ReplayRequest(
        session=options.session,
        out=options.out,
        rig=options.rig,
        config=options.config,
        from_s=options.from_s,
        to_s=options.to_s,
        learn_until_s=options.learn_until,
        rerun=not options.no_rerun,
        record=options.record,
        smooth=options.smooth,
    )
    with ProgressLine(sys.stderr, "replay") as line:
        result = replay(request, line.update)
    print(format_accuracy_table(result.evaluation.summary))
    print()
    if result.output_comparison is not None:
        print(f"{result.output_comparison.line()}\n")
    for path in result.files:
        print(f"wrote {path}")
    if result.fault is not None:
        print(f"groundstation: fault in the recording: {result.fault}", file=sys.stderr)
    if options.view:
        notice = video_notice(os.environ)
        if notice:
            print(f"groundstation: {notice}", file=sys.stderr)
        open_viewer(options.out / "session.rrd", os.environ)
    return 0 if result.fault is None else 1


_COMMANDS = {
    "replay": _replay,
    "track": _track,
    "plan": _plan,
    "calibrate": run_calibrate,
    "import": run_import,
    "recover": run_recover,
    "convert": run_convert,
    "simulate": run_simulate,
    "view": run_view,
    "evaluate": run_evaluate,
    "reproduce": run_reproduce,
    "cameras": run_cameras,
    "live": run_live,
    "check": run_check,
    "onboard": run_onboard,
    "ptu": run_ptu,
    "config": _config,
}
