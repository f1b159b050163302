"""Types of path arguments: each declares whether a command reads or writes the path.

Before a command starts, `check_paths` compares the outputs with the inputs and asks whether they can be written, so
that no command needs a check of its own.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from groundstation.errors import InputError
from groundstation.files.overwriting import Output, leads_to_itself, refuse_overwriting
from groundstation.files.right_to_write import require_right_to_write

_FILE_ADDRESS = "file:"


def _path(text: str) -> Path:
    # of a variable that is not set; the path of no text is the current folder
    if not text:
        raise argparse.ArgumentTypeError("got ''; wanted a path")
    path = Path(text)
    if not text.startswith("~/"):
        return path
    # shells leave it as it is in --out=~/x
    try:
        return path.expanduser()
    except RuntimeError:
        # a user without an entry, as in a container, and no HOME
        raise argparse.ArgumentTypeError(f"got {text!r}, and this user has no home; wanted a path") from None


@dataclass(frozen=True, slots=True)
class ReadPath:
    """An input file or folder."""

    def __call__(self, text: str) -> Path:
        """Return the path; raises `ArgumentTypeError` for an empty text."""
        return _path(text)


@dataclass(frozen=True, slots=True)
class ReadText:
    """A text that may be an input path: the name of a run, or an address ``file:PATH``."""

    def __call__(self, text: str) -> str:
        """Return the text."""
        return text


@dataclass(frozen=True, slots=True)
class WrittenFile:
    """An output file, written or extended."""

    def __call__(self, text: str) -> Path:
        """Return the path; raises `ArgumentTypeError` for an empty text."""
        return _path(text)


@dataclass(frozen=True, slots=True)
class WrittenFolder:
    """An output folder for files of these names (shell patterns).

    Without names the command itself chooses and checks the folders inside.
    """

    names: tuple[str, ...] = ()

    def __call__(self, text: str) -> Path:
        """Return the path; raises `ArgumentTypeError` for an empty text."""
        return _path(text)


READ = ReadPath()
READ_TEXT = ReadText()
WRITTEN_FILE = WrittenFile()
# a folder that has to be new or empty; the command reports one that is not
NEW_FOLDER = WrittenFolder(("*",))
REPORT_FOLDER = WrittenFolder(("report.html", "*.png"))
PATH_TYPES = (ReadPath, ReadText, WrittenFile, WrittenFolder)


def check_paths(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Raise `InputError` for a link that leads to itself, for an output that is an input or cannot be written."""
    read: list[Path] = []
    written: list[Output] = []
    places: list[tuple[Path, str]] = []
    for action in _actions(parser, options):
        option = action.option_strings[0] if action.option_strings else str(action.metavar or action.dest)
        for value in _values(getattr(options, action.dest, None)):
            if isinstance(value, Path) and leads_to_itself(value):
                raise InputError(str(value), got="a link that leads to itself", wanted="a file or a folder")
            if isinstance(action.type, ReadPath | ReadText):
                read.append(Path(str(value).removeprefix(_FILE_ADDRESS)))
            elif isinstance(action.type, WrittenFile):
                written.append(Output(path=Path(value), option=option))
                places.append((Path(value), "a file in a folder that can be written"))
            elif isinstance(action.type, WrittenFolder):
                written.append(Output(path=Path(value), option=option, names=action.type.names))
                places.append((Path(value), "a folder that can be written"))
    refuse_overwriting(read, written)
    for path, wanted in places:
        require_right_to_write(path, wanted)


def _actions(parser: argparse.ArgumentParser, options: argparse.Namespace) -> Iterator[argparse.Action]:
    """Yield the arguments of the selected command and of its subcommands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            chosen = action.choices.get(str(getattr(options, action.dest, "")))
            if chosen is not None:
                yield from _actions(chosen, options)
        else:
            yield action


def _values(value: object) -> Iterator[str | Path]:
    if isinstance(value, str | Path):
        yield value
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _values(one)
