"""What an argument's path is for: each command declares here what it reads and what it writes.

An argument that takes a path has one of these as its type. Before a command begins, `check_paths` holds what is written
against what is read; so no command has a check of its own, and none can be without.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from groundstation.files.overwriting import Output, refuse_overwriting

_FILE_ADDRESS = "file:"


@dataclass(frozen=True, slots=True)
class ReadPath:
    """A file or a folder that is read."""

    def __call__(self, text: str) -> Path:
        """Return the path."""
        return Path(text)


@dataclass(frozen=True, slots=True)
class ReadText:
    """A text that may name a file or a folder: the name of a run, or an address ``file:PATH``."""

    def __call__(self, text: str) -> str:
        """Return the text."""
        return text


@dataclass(frozen=True, slots=True)
class WrittenFile:
    """A file that is written, or added to."""

    def __call__(self, text: str) -> Path:
        """Return the path."""
        return Path(text)


@dataclass(frozen=True, slots=True)
class WrittenFolder:
    """A folder in which files of these names are written; patterns as a shell has them.

    Without a name it is one for folders that the command names itself, and checks itself.
    """

    names: tuple[str, ...] = ()

    def __call__(self, text: str) -> Path:
        """Return the path."""
        return Path(text)


READ = ReadPath()
READ_TEXT = ReadText()
WRITTEN_FILE = WrittenFile()
# a folder that has to be new or empty: the command says so
NEW_FOLDER = WrittenFolder(("*",))
REPORT_FOLDER = WrittenFolder(("report.html", "*.png"))
PATH_TYPES = (ReadPath, ReadText, WrittenFile, WrittenFolder)


def check_paths(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Raise `InputError` where the command that was asked for would write onto what it reads."""
    read: list[Path] = []
    written: list[Output] = []
    for action in _actions(parser, options):
        option = action.option_strings[0] if action.option_strings else str(action.metavar or action.dest)
        for value in _values(getattr(options, action.dest, None)):
            if isinstance(action.type, ReadPath | ReadText):
                read.append(Path(str(value).removeprefix(_FILE_ADDRESS)))
            elif isinstance(action.type, WrittenFile):
                written.append(Output(path=Path(value), option=option))
            elif isinstance(action.type, WrittenFolder):
                written.append(Output(path=Path(value), option=option, names=action.type.names))
    refuse_overwriting(read, written)


def _actions(parser: argparse.ArgumentParser, options: argparse.Namespace) -> Iterator[argparse.Action]:
    """Yield the arguments of the command that was asked for, and of the kinds below it."""
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
