"""Where the program begins: Ctrl-C ends it quietly from here on, also while it is still being read."""

import os
import sys

# as typing has it, whose import an interrupt would find before `main` stands ready for it
TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.cli.interrupts import Interrupts

# The libraries of linear algebra start a thread for each core, and those wait by counting. Matrices here have ten to
# some hundred rows, too few to share: the threads would only take cores from what has to be done in time.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "VECLIB_MAXIMUM_THREADS": "1"}


def main() -> int:
    """Run the command line; returns the exit code."""
    # what the user has set stays; it is read when numpy is first imported
    os.environ.update(ONE_THREAD | os.environ)
    try:
        from groundstation.cli.interpreter_exit import InterpreterExit, leave
        from groundstation.cli.interrupts import Interrupts

        end = InterpreterExit()
    except KeyboardInterrupt:
        return _interrupted()
    end.code = _run(Interrupts())
    if sys.argv[1:2] == ["live"]:
        # a station has closed all that it opened, and has a bounded time to end
        leave(end.code)
    return end.code


def _run(interrupts: "Interrupts") -> int:
    try:
        with interrupts:
            from groundstation.cli.main import main as run

            code = run()
    except KeyboardInterrupt:
        return _interrupted()
    except Exception:
        # what the interrupt has become in a module that was being imported
        if interrupts.received:
            return _interrupted()
        raise
    _forget_interrupt()
    return code


def _interrupted() -> int:
    """Report it; returns the exit code."""
    print("groundstation: interrupted", file=sys.stderr)
    _forget_interrupt()
    return 130


def _forget_interrupt() -> None:
    """Let the exit code count.

    After an interrupt within the execution of a text, as `dataclass` does it, `python -m` ends by the signal, whatever
    has become of it; the next text that is executed resets that.
    """
    exec("")
