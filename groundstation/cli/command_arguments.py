"""What several commands share: the parser of a command, options of the same meaning, and the lines on results."""

import argparse
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol, TypeAlias

from groundstation.cli.number_arguments import parse_number, port
from groundstation.cli.path_arguments import READ, REPORT_FOLDER, WRITTEN_FILE, WrittenFolder
from groundstation.errors import InputError, UsageError

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
Run = Callable[[argparse.Namespace], int]

_MAX_SEED = 2**53
_MAX_RATE_HZ = 200.0
_MAX_WIND_M_S = 15.0


class VideoResult(Protocol):
    """The result of a command that processes one video."""

    @property
    def files(self) -> Iterable[Path]:
        """The files written."""

    @property
    def damage(self) -> str | None:
        """A line on damaged frames, if there were any."""

    @property
    def fault(self) -> InputError | None:
        """The fault that ended the video early, if any."""


def add_command(
    commands: Commands, name: str, run: Run, summary: str, description: str, epilog: str | None = None
) -> argparse.ArgumentParser:
    """Add a command that calls ``run`` with its options; description and epilog keep their line breaks."""
    parser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


# ---------------------------------------------------------------------------------------------- options
def add_result_folder(parser: argparse.ArgumentParser, names: tuple[str, ...]) -> None:
    """Add the required `--out`, a folder for files of these names (shell patterns)."""
    parser.add_argument(
        "--out",
        type=WrittenFolder(names),
        required=True,
        metavar="DIR",
        help="where the results go; made if missing",
    )


def add_calibrated_rig(parser: argparse.ArgumentParser) -> None:
    """Add the required `--out` for a rig file, and `--report`."""
    parser.add_argument("--out", type=WRITTEN_FILE, required=True, metavar="FILE", help="the rig file to write")
    add_report(parser)


def add_report(parser: argparse.ArgumentParser) -> None:
    """Add `--report`, a folder for a page and its pictures."""
    parser.add_argument("--report", type=REPORT_FOLDER, metavar="DIR", help="write report.html and its pictures there")


def refuse_own_rig(options: argparse.Namespace) -> None:
    """Raise `InputError` if `--out` is the rig file of the session itself."""
    if os.path.realpath(options.out) == os.path.realpath(options.session / "rig.toml"):
        wanted = "another file: a recording keeps the rig that it was made with"
        raise InputError(str(options.out), got="the session's own rig", wanted=wanted)


def add_runs(parser: argparse.ArgumentParser, purpose: str, out: str) -> None:
    """Add the sources of several runs, `--config`, `--rig` and `--out`.

    ``purpose`` is the help of the sources, ``out`` that of the folder.
    """
    parser.add_argument("sources", type=READ, nargs="+", metavar="SOURCE", help=f"{purpose}; see below")
    parser.add_argument(
        "--config", type=READ, action="append", default=[], metavar="FILE", help="tuning for what is replayed; repeat"
    )
    parser.add_argument("--rig", type=READ, metavar="FILE", help="another rig for what is replayed")
    parser.add_argument("--out", type=WrittenFolder(), metavar="DIR", help=out)


def add_port(parser: argparse.ArgumentParser) -> None:
    """Add `--port`, of the page that `--web` serves."""
    parser.add_argument("--port", type=port, metavar="PORT", help="with --web: the page's port (default: any free one)")


def require_web(options: argparse.Namespace) -> None:
    """Raise `UsageError` for a port without a page."""
    if options.port is not None and not options.web:
        raise UsageError("--port", got=f"{options.port} without --web", wanted="both: it is the page's port")


def add_simulated_flight(parser: argparse.ArgumentParser, rate_hz: float | None, condition: str = "") -> None:
    """Add the options of a simulated flight; ``condition`` stands before each one's help.

    ``rate_hz`` None is what the machine renders.
    """
    usual = "what this machine renders" if rate_hz is None else f"{rate_hz:g}"
    parser.add_argument(
        "--rate",
        type=_pairs_per_s,
        default=rate_hz,
        metavar="HZ",
        help=f"{condition}stereo pairs per s (default: {usual})",
    )
    parser.add_argument(
        "--seed", type=whole_number, default=0, metavar="N", help=f"{condition}of all random numbers (default: 0)"
    )
    parser.add_argument(
        "--wind",
        type=_wind_m_s,
        default=0.0,
        metavar="M_S",
        help=f"{condition}gusts as in such a wind, up to {_MAX_WIND_M_S:g} m/s (default: 0)",
    )
    parser.add_argument(
        "--aircraft",
        choices=("waves", "jsbsim"),
        default="waves",
        help=f"{condition}its motion in the wind: waves, or JSBSim's C172 in Milspec turbulence, an optional extra",
    )


def whole_number(text: str) -> int:
    """Return a whole number of 0 or more."""
    return int(parse_number(text, "a whole number from 0", lambda v: 0.0 <= v <= _MAX_SEED and v.is_integer()))


def _pairs_per_s(text: str) -> float:
    wanted = f"pairs per s, above 0, up to {_MAX_RATE_HZ:g}"
    return parse_number(text, wanted, lambda value: 0.0 < value <= _MAX_RATE_HZ)


def _wind_m_s(text: str) -> float:
    return parse_number(text, f"m/s from 0 to {_MAX_WIND_M_S:g}", lambda value: 0.0 <= value <= _MAX_WIND_M_S)


# ---------------------------------------------------------------------------------------------- results
def print_files(paths: Iterable[Path]) -> None:
    """Print a line for each file written."""
    for path in paths:
        print(f"wrote {path}")


def print_video_result(result: VideoResult, summary: str) -> None:
    """Print the summary and the files of a processed video, and its faults to stderr."""
    print(summary)
    print_files(result.files)
    if result.damage is not None:
        print(f"groundstation: {result.damage}", file=sys.stderr)
    if result.fault is not None:
        print(f"groundstation: fault in the video: {result.fault}", file=sys.stderr)


def add_weights_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--weights``, one's own weights of the learned channel."""
    parser.add_argument(
        "--weights",
        type=READ,
        metavar="ONNX",
        help="detect with the learned channel and one's own weights, of `groundstation train`",
    )
