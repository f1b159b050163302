"""The command line: `groundstation COMMAND …`."""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import closing, contextmanager
from functools import cache

from groundstation import __version__
from groundstation.cli.autopilot import add_autopilot
from groundstation.cli.bank import add_bank
from groundstation.cli.calibrate import add_calibrate
from groundstation.cli.cameras import add_cameras
from groundstation.cli.check import add_check
from groundstation.cli.command_arguments import Commands
from groundstation.cli.completion import add_completion
from groundstation.cli.config import add_config
from groundstation.cli.convert import add_convert
from groundstation.cli.evaluate import add_evaluate
from groundstation.cli.import_session import add_import
from groundstation.cli.kernel_cache import kernel_cache
from groundstation.cli.left_files import INTERRUPTED, left_by
from groundstation.cli.live import add_live
from groundstation.cli.onboard import add_onboard
from groundstation.cli.path_arguments import check_paths
from groundstation.cli.plan import add_plan
from groundstation.cli.progress import CompilationLog
from groundstation.cli.ptu import add_ptu
from groundstation.cli.recover import add_recover
from groundstation.cli.replay import add_replay
from groundstation.cli.reproduce import add_reproduce
from groundstation.cli.simulate import add_simulate
from groundstation.cli.suggesting_parser import SuggestingParser
from groundstation.cli.terminal import print_line
from groundstation.cli.terminated import TERMINATED, Terminated
from groundstation.cli.track import add_track
from groundstation.cli.train import add_train
from groundstation.cli.train_proposals import add_train_proposals
from groundstation.cli.view import add_view
from groundstation.compilation import compilation_watched, listen
from groundstation.errors import GroundstationError, UsageError, os_words

# in the order of the help
_COMMANDS: tuple[Callable[[Commands], None], ...] = (
    *(add_replay, add_track, add_plan, add_calibrate, add_import, add_recover, add_convert, add_cameras, add_live),
    *(
        add_check,
        add_onboard,
        add_ptu,
        add_autopilot,
        add_simulate,
        add_bank,
        add_train,
        add_train_proposals,
        add_view,
        add_evaluate,
        add_reproduce,
        add_config,
        add_completion,
    ),
)
# what they do needs no numba, whose import takes a third of a second
_WITHOUT_KERNELS = frozenset({"autopilot", "cameras", "completion", "config", "import", "ptu", "recover", "view"})
# FFmpeg and OpenCV write directly to the terminal; the program prints its own message
_QUIET = {"OPENCV_FFMPEG_LOGLEVEL": "-8", "OPENCV_LOG_LEVEL": "ERROR"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 the input stopped it, 2 wrong usage, 130 interrupted.

    A `replay` ended by SIGTERM returns 143.
    """
    parser = build_parser()
    options = parser.parse_args(arguments)
    options.words = tuple(sys.argv[1:] if arguments is None else arguments)
    if options.command is None:
        parser.print_help(sys.stderr)
        return 2
    _silence(os.environ, _QUIET)
    began_s = time.time()
    try:
        check_paths(parser, options)
        run: Callable[[argparse.Namespace], int] = options.run
        with _compilation_shown(options.command):
            return run(options)
    except BrokenPipeError:
        # the reader of the output has ended, as in `… | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except GroundstationError as error:
        print_line(f"groundstation: {error}", sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:
        # a full disk or an unplugged device: a traceback would not help
        what = os_words(error) if error.filename is None else f"{error.filename}: {os_words(error)}"
        print_line(f"groundstation: {what}{left_by(options, began_s)}", sys.stderr)
        return 1
    except KeyboardInterrupt as end:
        words = "; ".join((f"interrupted{left_by(options, began_s)}", *getattr(end, "__notes__", ())))
        print_line(f"groundstation: {words}", sys.stderr)
        return TERMINATED if isinstance(end, Terminated) else INTERRUPTED


@contextmanager
def _compilation_shown(command: str) -> Iterator[None]:
    """Show what a command compiles, by lines where it shows no progress of its own."""
    if command in _WITHOUT_KERNELS:
        yield
        return
    os.environ.update(kernel_cache(os.environ))
    listen()
    log = CompilationLog(sys.stderr)
    with closing(log), compilation_watched(log.compiling):
        yield


def _silence(environment: MutableMapping[str, str], defaults: Mapping[str, str]) -> None:
    """Set the libraries' log levels unless the user has set them; they are read at first use."""
    for name, value in defaults.items():
        environment.setdefault(name, value)


@cache
def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line; the documentation prints its help."""
    parser: argparse.ArgumentParser = SuggestingParser(
        prog="groundstation",
        description="Track an approaching aircraft in 3-D with two cameras on pan-tilt units, without GNSS.",
    )
    parser.add_argument("--version", action="version", version=f"groundstation {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    for add in _COMMANDS:
        add(commands)
    return parser
