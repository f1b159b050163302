"""The part of the command line that shows runs: `groundstation view FILE|SESSION…`."""

import argparse
import os
import signal
import sys
import tempfile
import threading
import webbrowser
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_command, add_port, add_runs, require_web
from groundstation.cli.path_arguments import WRITTEN_FILE
from groundstation.cli.progress import ProgressDisplay
from groundstation.errors import InputError, UsageError

_VIEW = """Look at a run in Rerun: scene, pictures with what was seen in them, errors,
consistency, log. Several at once, such as two flights or one flight with two
tunings, are shown side by side on one runway."""
_MORE = """examples:
  groundstation view out/landing-1
  groundstation view out/monday out/tuesday --align touchdown
  groundstation view recordings/landing-1 --config soft.toml --config stiff.toml
  groundstation view out/a out/b --save both.rrd

SOURCE is the output folder of a replay, its session.rrd, a session folder, a
recording (.mcap) or a live run's folder with its flight.mcap; the last three are
replayed first. A run without an estimate, or a
session that cannot be replayed yet, shows what it has, and a note lists what is missing.

exit code: 0 done; 1 a source is at fault, or there is no display; 2 wrong usage;
130 interrupted"""
_ALIGN = ("none", "start", "touchdown")


def add_view(commands: Commands) -> None:
    """Add `view`."""
    view = add_command(commands, "view", run_view, "look at one run, or at several side by side", _VIEW, _MORE)
    add_runs(view, "what to look at", "keep what is replayed there, a folder for each run")
    view.add_argument(
        "--align",
        choices=_ALIGN,
        help="what is at the same time in every run: its first estimate, its touchdown, or nothing "
        "(default: none; start where the runs have no time in common)",
    )
    where = view.add_mutually_exclusive_group()
    where.add_argument("--view", action="store_true", help="in the desktop viewer (default where there is a display)")
    where.add_argument("--web", action="store_true", help="in a browser, served to this machine alone")
    add_port(view)
    view.add_argument(
        "--save", type=WRITTEN_FILE, metavar="FILE.rrd", help="write it to a file; opens it only with the above"
    )


def run_view(options: argparse.Namespace) -> int:
    """Prepare the recording and show it until the viewer is closed, or Ctrl-C; returns the exit code."""
    from groundstation.replay.view import ViewRequest, names_line, prepare_view
    from groundstation.viewer.merge_recordings import RunAlignment
    from groundstation.viewer.viewer_process import ViewerError, free_port, has_display

    if options.save is not None and options.save.suffix != ".rrd":
        raise UsageError("--save", got=str(options.save), wanted="a name that ends in .rrd, which the viewer opens")
    require_web(options)
    for source in options.sources:
        if not source.exists():
            raise InputError(str(source), got="no such file or folder", wanted="a run to look at")
    shows = options.view or options.web or options.save is None
    if shows and not options.web and not has_display(os.environ):
        # before the replays, which take minutes
        raise ViewerError("no display: --web shows it in a browser on this machine, --save FILE.rrd writes a file")
    if options.port is not None:
        free_port(options.port)
    with tempfile.TemporaryDirectory(prefix="groundstation-view-") as folder:
        request = ViewRequest(
            sources=tuple(options.sources),
            work=options.out or Path(folder),
            configs=tuple(options.config),
            rig=options.rig,
            align=None if options.align is None else RunAlignment(options.align),
            save=options.save,
        )
        with ProgressDisplay(sys.stderr) as progress:
            result = prepare_view(request, progress.update)
        for note in result.notes:
            print(f"note: {note}", file=sys.stderr)
        if options.save is not None:
            print(f"wrote {options.save}")
        if shows:
            print(names_line(result, options.sources), flush=True)
            _show(result.recording, web=options.web, port=options.port)
    return 0


def _show(recording: Path, *, web: bool, port: int | None) -> None:
    """Show it and wait for the end of the viewer or of the user's patience."""
    from groundstation.viewer import viewer_process as rerun_viewer
    from groundstation.viewer.viewer_process import has_display, open_viewer, serve_recording, stop_viewer

    notice = rerun_viewer.browser_notice(recording) if web else rerun_viewer.video_notice(os.environ)
    if notice:
        print(f"groundstation: {notice}", file=sys.stderr)
    if web:
        address, process = serve_recording(recording, os.environ, port)
        print(f"open {address}\nCtrl-C ends it", flush=True)
        if has_display(os.environ):
            webbrowser.open(address)
    else:
        process = open_viewer(recording, os.environ)
        print("close the viewer, or Ctrl-C, to end", flush=True)
    asked = threading.Event()
    before = {s: signal.signal(s, lambda *_: asked.set()) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        while process.poll() is None and not asked.wait(0.2):
            pass
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        stop_viewer(process)
