"""Every error that the drivers raise on purpose: one root; the text is one line that a user can act upon."""

import errno
import os
import re

# the operating system's words within a library's: "[Errno 2] No such file or directory: 'x'", "(25, 'No terminal')"
_OWN_WORDS = re.compile(r".*\[Errno -?\d+\] ([^:]+)|\(\d+, '([^']+)'\)")


class PtuError(Exception):
    """Root of all errors of this package."""


class LineError(PtuError):
    """The line cannot be opened, or it is gone (unplugged, closed by the other side)."""

    def __init__(self, url: str, *, got: str, wanted: str) -> None:
        self.url = url
        self.got = got
        self.wanted = wanted
        super().__init__(f"{url}: got {_line(got)}; wanted {wanted}")


class NoAnswerError(PtuError):
    """A command had no valid reply within the stated time; its effect is unknown.

    Parameters
    ----------
    command : the command.
    waited_s : waiting time, s.
    got : the received bytes.
    """

    def __init__(self, command: str, *, waited_s: float, got: str) -> None:
        self.command = command
        self.waited_s = waited_s
        super().__init__(f"{command}: got {_line(got)} in {waited_s:.2f} s; wanted an answer")


class ProtocolError(PtuError):
    """Bytes that are not a message of the protocol, or a unit that does not use it."""

    def __init__(self, where: str, *, got: str, wanted: str) -> None:
        self.where = where
        self.got = got
        self.wanted = wanted
        super().__init__(f"{where}: got {_line(got)}; wanted {wanted}")


class RefusedError(PtuError):
    """The unit understood the command and refused it."""

    def __init__(self, command: str, *, reported: str) -> None:
        self.command = command
        self.reported = reported
        super().__init__(f"{command}: the unit refused it: {_line(reported)}")


class LimitError(PtuError):
    """A command beyond a limit: refused before anything was sent, never clipped.

    Parameters
    ----------
    axis : "pan" or "tilt".
    limit : the limit's name: "lower limit", "upper limit", "maximum speed", "minimum speed".
    got, bound : the requested value and the limit, rad or rad/s.
    origin : origin of the limit: "unit" or "settings".
    """

    def __init__(self, axis: str, limit: str, *, got: float, bound: float, origin: str) -> None:
        self.axis = axis
        self.limit = limit
        self.got = got
        self.bound = bound
        self.origin = origin
        unit = "deg/s" if "speed" in limit else "deg"
        got_deg, bound_deg = got * _DEG, bound * _DEG
        super().__init__(f"{axis}: got {got_deg:.4f} {unit}; the {limit} is {bound_deg:.4f} {unit} ({origin})")


class UnsupportedError(PtuError):
    """The unit, or this protocol, does not support the request (see `UnitDescription.capabilities`)."""

    def __init__(self, unit: str, *, got: str) -> None:
        super().__init__(f"{unit}: got {got}, which it cannot do")


class MissingPackageError(PtuError):
    """A package that this protocol needs is not installed; ``requirement`` is what pip is to be given."""

    def __init__(self, part: str, requirement: str) -> None:
        super().__init__(f"{part} needs a package that is not installed: pip install {requirement}")


_DEG = 57.29577951308232


def os_words(fault: BaseException) -> str:
    """Return what went wrong in words, without the operating system's number; pyserial has its own ways to state it."""
    said = str(fault) or type(fault).__name__
    if type(fault).__module__.partition(".")[0] != "serial" and isinstance(fault, OSError) and fault.errno is not None:
        # asyncio adds its own to the words; a negative number is a resolver's, which has words of its own
        said = os.strerror(fault.errno) if fault.errno > 0 else fault.strerror or said
    if (found := _OWN_WORDS.search(said)) is not None:
        said = found[1] or found[2]
    return "a device that is no serial line" if said == os.strerror(errno.ENOTTY) else said


def _line(text: str) -> str:
    """Return the text in one printable line, whatever the unit sent."""
    shown = text if text.isprintable() else ascii(text)
    return shown if len(shown) <= 120 else shown[:117] + "..."
