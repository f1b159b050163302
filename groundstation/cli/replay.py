"""`groundstation replay`: a recorded session in, its track and evaluation out."""

import argparse
import os
import sys
from datetime import datetime
from typing import TYPE_CHECKING

from groundstation.cli.approach_arguments import add_approach, approach_options
from groundstation.cli.command_arguments import (
    Commands,
    add_command,
    add_result_folder,
    add_weights_option,
    print_files,
)
from groundstation.cli.number_arguments import parse_number
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.cli.terminated import ended_in_order
from groundstation.cli.time_span import add_span, require_span
from groundstation.errors import UsageError
from groundstation.replay.result_files import REPLAY_FILES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from groundstation.session import Session
    from groundstation.tracking.registered_heads import AnglesFromPicture

_REPLAY = """Replay a recorded session: find the aircraft in every camera, track it in 3-D,
compare with DGPS and truth, and write track.csv, triangulation.csv,
detections.csv, track.tum, summary.json, report.html and session.rrd into the
output folder; with [origin] in session.toml also track.kml and track.geojson."""
_REPLAY_MORE = """example:
  groundstation replay recordings/landing-1 --out out/landing-1 --from 20

exit code: 0 done, also where nothing was tracked; 1 the recording is at fault
(what came before the fault is written), its inputs contradict each other, or
the disk had no room for session.rrd, which comes last; 2 wrong usage; 130
interrupted; 143 ended by SIGTERM"""


def add_replay(commands: Commands) -> None:
    """Add `replay`."""
    replay = add_command(
        commands, "replay", run_replay, "recorded stereo session in, scored 3-D track out", _REPLAY, _REPLAY_MORE
    )
    replay.add_argument(
        "session",
        type=READ,
        metavar="SESSION",
        help="session folder (session.toml, rig.toml, videos …), .mcap, or the folder of a live run",
    )
    add_result_folder(replay, REPLAY_FILES)
    replay.add_argument("--rig", type=READ, metavar="FILE", help="another rig than the session's rig.toml")
    replay.add_argument(
        "--config",
        type=READ,
        metavar="FILE",
        help="tuning, TOML; what it leaves out keeps its default (all of them: groundstation config)",
    )
    add_weights_option(replay)
    replay.add_argument(
        "--panorama", type=READ, metavar="FILE.npz", help="head angles from the picture, by calibrate panorama's file"
    )
    replay.add_argument(
        "--stars", type=_moment, metavar="UTC", help="head angles by the stars; UTC: the moment of session time 0"
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
    replay.add_argument("--realtime", action="store_true", help="at the speed of the recording, as streams need it")
    add_approach(replay, "[origin]")
    recording = replay.add_mutually_exclusive_group()
    recording.add_argument("--view", action="store_true", help="open the Rerun recording when done")
    recording.add_argument("--no-rerun", action="store_true", help="do not write session.rrd")


def _seconds(text: str) -> float:
    """Return a finite time."""
    return parse_number(text, "a time in s")


def _moment(text: str) -> datetime:
    """Return a moment in UTC, of ISO 8601."""
    try:
        moment: datetime | None = datetime.fromisoformat(text)
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is None:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a moment with its zone, as 2026-05-17T21:30:00Z")
    return moment


def _by_stars(moment: datetime) -> "Callable[[Session], Mapping[str, AnglesFromPicture]]":
    """Return what makes of a session what takes its heads' angles from stars."""
    from calibration.stars.star_angles import star_angles

    return lambda session: star_angles(session, moment.timestamp())


def run_replay(options: argparse.Namespace) -> int:
    """Replay, print the table and the paths; 1 if the recording was cut short by a fault."""
    # imported here, so that --help and usage errors respond without delay
    from groundstation.evaluation.accuracy_table import format_accuracy_table
    from groundstation.replay.replay import ReplayRequest, replay
    from groundstation.viewer.viewer_process import open_viewer, video_notice

    if options.record is not None and options.record.suffix != ".mcap":
        raise UsageError("--record", got=str(options.record), wanted="a name that ends in .mcap")
    require_span(options)
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
        weights=options.weights,
        panorama=options.panorama,
        stars=None if options.stars is None else _by_stars(options.stars),
        command=options.words,
        approach=approach_options(options),
        realtime=options.realtime,
    )
    with ended_in_order(), ProgressLine(sys.stderr, "replay") as line:
        result = replay(request, line.update)
    print(format_accuracy_table(result.evaluation.summary))
    print()
    if result.output_comparison is not None:
        print(f"{result.output_comparison.line()}\n")
    if result.approach is not None and result.approach.text:
        print(f"{result.approach.text}\n")
    print_files(result.files)
    if result.fault is not None:
        hint = "; `groundstation recover` keeps what is whole" if options.session.suffix == ".mcap" else ""
        print(f"groundstation: fault in the recording: {result.fault}{hint}", file=sys.stderr)
    for lost, why in result.given_up.items():
        print(f"groundstation: {lost} was given up: {why}; the results are whole", file=sys.stderr)
    if options.view and options.out / "session.rrd" not in result.given_up:
        notice = video_notice(os.environ)
        if notice:
            print(f"groundstation: {notice}", file=sys.stderr)
        open_viewer(options.out / "session.rrd", os.environ)
    contradictions = result.evaluation.summary["contradictions"]
    for line in contradictions:
        print(f"groundstation: inputs that cannot be right: {line}", file=sys.stderr)
    whole = result.fault is None and not result.given_up and not contradictions
    return 0 if whole else 1
