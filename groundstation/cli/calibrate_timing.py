"""`groundstation calibrate timing`: the clocks of cameras and PTUs."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_calibrated_rig, add_command, print_files, refuse_own_rig
from groundstation.cli.path_arguments import READ
from groundstation.cli.progress import ProgressLine
from groundstation.cli.time_span import add_span, require_span
from groundstation.errors import UsageError

_TIMING = """The offset between each camera's clock and its PTU's: swing the PTU before a scene that
stands still and has texture all over (a sine of 5 deg at 0.3 Hz or so, 20 s), record it
as a session; the pictures' motion against the readings gives the offset. Any session
whose heads turn will do, if less well."""
_TIMING_MORE = """examples:
  groundstation calibrate timing SESSION --rig rig.toml --out timed.toml \\
      --report out/timing
  groundstation calibrate timing SESSION --from-flight \\
      --detections out/detections.csv --out timed.toml

--from-flight finds the clocks from the aircraft's DGPS track and the pixels that
saw it, as calibrate flight does, with nothing else free; with --pictures as well
both methods are run and compared, and the pictures' result is written.

exit code: 0 done; 1 the session does not determine it; nothing is written;
2 wrong usage; 130 interrupted"""


def add_timing(kinds: Commands) -> None:
    """Add `calibrate timing`."""
    timing = add_command(
        kinds,
        "timing",
        run_timing,
        "clocks of cameras and PTUs, from a swinging PTU or a flight",
        _TIMING,
        _TIMING_MORE,
    )
    timing.add_argument("session", type=READ, metavar="SESSION", help="session folder with pictures and ptu.csv")
    timing.add_argument("--rig", type=READ, metavar="RIG", help="another rig than the session's rig.toml")
    add_calibrated_rig(timing)
    add_span(timing)
    timing.add_argument("--from-flight", action="store_true", help="by the aircraft's track instead of the pictures")
    timing.add_argument("--pictures", action="store_true", help="with --from-flight: by the pictures too, compared")
    timing.add_argument("--detections", type=READ, metavar="FILE", help="with --from-flight: a replay's detections.csv")
    timing.add_argument(
        "--one-ptu-clock", action="store_true", help="one clock stamps all PTUs: what differs is the cameras'"
    )


def run_timing(options: argparse.Namespace) -> int:
    """Calibrate clocks, print the report and what was written; returns the exit code."""
    from calibration.clocks.calibrate import TimingRequest, calibrate_timing
    from calibration.clocks.text_report import format_timing

    require_span(options)
    refuse_own_rig(options)
    if options.pictures and not options.from_flight:
        wanted = "both, to compare, or neither: by the pictures alone is what is done without"
        raise UsageError("--pictures", got="no --from-flight", wanted=wanted)
    if options.detections is not None and not options.from_flight:
        raise UsageError("--detections", got="no --from-flight", wanted="it, pictures need no detections")
    request = TimingRequest(
        session=options.session,
        out=options.out,
        rig=options.rig,
        detections=options.detections,
        from_s=options.from_s,
        to_s=options.to_s,
        pictures=options.pictures or not options.from_flight,
        flight=options.from_flight,
        one_ptu_clock=options.one_ptu_clock,
    )
    with ProgressLine(sys.stderr, "pictures", "frame") as line:
        found = calibrate_timing(request, lambda n: line.update(n, None))
    print(format_timing(found))
    print(f"\nwrote {options.out}")
    if options.report is not None:
        from calibration.clocks.html_report import write_timing_page

        print_files(write_timing_page(options.report, found))
    return 0
