"""Every error that Groundstation raises on purpose: one root, and what was got against what was wanted."""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# how Python writes an error's number in front of its words
_NUMBER = re.compile(r"\[(?:Errno|WinError) -?\d+\] ?")


def printable(text: str) -> str:
    """Return a text with what cannot be printed, line ends too, written as Python's escapes."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def os_words(fault: BaseException) -> str:
    """Return what went wrong in words, without the number that the operating system has for it, or the file's name.

    Of an error that is none of the operating system's: its text, in one line.
    """
    if isinstance(fault, OSError) and fault.errno is not None:
        words = fault.strerror or os.strerror(fault.errno)
    else:
        words = str(fault) or type(fault).__name__
    return printable(_NUMBER.sub("", words.strip().partition("\n")[0]))


class GroundstationError(Exception):
    """Root of all errors of this package; its text is one line that a user can act upon."""


class InputError(GroundstationError):
    """A file, a folder or a value that the user gave is not what is needed.

    Parameters
    ----------
    where : file (and row, key or column) of the fault.
    got, wanted : what stood there, and what was needed.
    """

    def __init__(self, where: str, *, got: str, wanted: str) -> None:
        self.where = where
        self.got = got
        self.wanted = wanted
        # it may contain text of a damaged file or a strange file name; an error is one line all the same
        super().__init__(printable(_NUMBER.sub("", f"{where}: got {got}; wanted {wanted}")))

    def __reduce__(self) -> tuple[Callable[..., "InputError"], tuple[type["InputError"], str, str, str]]:
        # arguments by name are not what pickle calls a class with
        return _input_error, (type(self), self.where, self.got, self.wanted)


def _input_error(kind: type[InputError], where: str, got: str, wanted: str) -> InputError:
    """Return an error as another process raised it."""
    return kind(where, got=got, wanted=wanted)


class UsageError(InputError):
    """Options that do not go together: wrong usage, exit code 2."""


class RigError(InputError):
    """A rig file is not usable."""


class SessionError(InputError):
    """A session folder is not usable."""


class RecordingError(InputError):
    """A recording (.mcap) is damaged, or is none of ours."""


class ConfigError(InputError):
    """A configuration file is not usable."""


class SiteError(InputError):
    """A description of a planned site is not usable."""


class ScenarioError(InputError):
    """A simulated flight cannot be made as it is asked for."""


class MissingExtraError(GroundstationError):
    """An optional part was asked for and its packages are not installed."""

    def __init__(self, part: str, extra: str) -> None:
        super().__init__(f"{part} needs an optional part; install it with: pip install 'groundstation[{extra}]'")


class LogError(SessionError):
    """A position log of a receiver or an autopilot is not usable."""


@contextmanager
def ending_noted(words: Callable[[], str]) -> Iterator[None]:
    """Add to an interrupt how far the results reach, for the command's last line."""
    try:
        yield
    except KeyboardInterrupt as end:
        end.add_note(words())
        raise
