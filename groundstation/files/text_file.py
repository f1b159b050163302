"""Small text files in a folder or inside another file; a `pathlib.Path` is one of them."""

from collections.abc import Mapping
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Protocol, TextIO


class TextFile(Protocol):
    """A file of text, which may not exist."""

    @property
    def name(self) -> str:
        """Return its name without folders."""

    def is_file(self) -> bool:
        """Return whether it exists."""

    def open(self, *, encoding: str, errors: str = "strict", newline: str | None = None) -> TextIO:
        """Open it for reading."""

    def read_bytes(self) -> bytes:
        """Return its content."""


def absence(file: TextFile) -> str:
    """Return in words why a path is no file: what it is instead, or that it is not there."""
    if not isinstance(file, Path):
        return "no such file"
    if file.is_dir():
        return "a folder"
    if file.is_symlink() and not file.exists():
        return "a link to what is not there"
    return "a pipe or a device" if file.exists() else "no such file"


def is_other_kind(file: TextFile) -> bool:
    """Return whether there is something of that name that is no file, or a link to nothing."""
    return isinstance(file, Path) and not file.is_file() and (file.exists() or file.is_symlink())


def is_utf16(begin: bytes) -> bool:
    """Return whether a file that begins so is text in UTF-16, as some editors and PowerShell write."""
    return begin[:2] in (b"\xff\xfe", b"\xfe\xff")


class TextFolder(Protocol):
    """A container of a session's files, by their names."""

    def __truediv__(self, name: str, /) -> TextFile:
        """Return the file of a name."""


class AttachedFiles:
    """Files that another file, ``place``, carries: by name their content."""

    def __init__(self, place: str, files: Mapping[str, bytes]) -> None:
        self._place = place
        self._files = files

    def __truediv__(self, name: str) -> "AttachedFile":
        return AttachedFile(name, self._place, self._files.get(name))

    def __str__(self) -> str:
        return self._place


class AttachedFile:
    """One attached file; ``content`` is None if there is no file of that name."""

    def __init__(self, name: str, place: str, content: bytes | None) -> None:
        self._name = name
        self._place = place
        self._content = content

    def __str__(self) -> str:
        return f"{self._place}: {self._name}"

    @property
    def name(self) -> str:
        """Return its name."""
        return self._name

    def is_file(self) -> bool:
        """Return whether it exists."""
        return self._content is not None

    def open(self, *, encoding: str, errors: str = "strict", newline: str | None = None) -> TextIO:
        """Open it for reading; raises `FileNotFoundError`."""
        return TextIOWrapper(BytesIO(self.read_bytes()), encoding=encoding, errors=errors, newline=newline)

    def read_bytes(self) -> bytes:
        """Return its content; raises `FileNotFoundError`."""
        if self._content is None:
            raise FileNotFoundError(2, "no such file", str(self))
        return self._content
