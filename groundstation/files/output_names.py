"""Names from data as names of files: every writer that makes a path of such a name checks it here.

The name of a file or folder to write is fixed or comes from data (a station's, an attachment's, a run's, a
picture's). A name from data is one path component below the output on every system, or it is refused.
"""

from pathlib import Path

from groundstation.errors import InputError, printable

# NAME_MAX of the common file systems is 255; the rest is for suffixes and numbers that a writer adds
MAX_NAME_BYTES = 200
# https://learn.microsoft.com/windows/win32/fileio/naming-a-file: separators, streams, wildcards, redirection
_REFUSED_CHARACTERS = frozenset('/\\:*?"<>|')
# devices in every folder of Windows, whatever the suffix, in any case
_DEVICES = frozenset(
    {"con", "prn", "aux", "nul", "conin$", "conout$"}
    | {f"{port}{digit}" for port in ("com", "lpt") for digit in "0123456789¹²³"}
)
_SHOWN_CHARACTERS = 60


def name_fault(name: str) -> str | None:
    """Return in words why a name is not one plain component of a path, or None if it is one."""
    if not name:
        return "an empty name"
    shown = printable(name if len(name) <= _SHOWN_CHARACTERS else name[:_SHOWN_CHARACTERS] + "…")
    try:
        size = len(name.encode())
    except UnicodeEncodeError:
        return f"the name '{shown}', which is no Unicode"
    if size > MAX_NAME_BYTES:
        return f"a name of {size} bytes"
    if name in (".", "..") or not name.isprintable() or not _REFUSED_CHARACTERS.isdisjoint(name):
        return f"the name '{shown}'"
    if name != name.strip(" ") or name.endswith("."):
        # Windows drops them, so that two names are one file
        return f"the name '{shown}', which ends in a space or a dot or begins with a space"
    if name.partition(".")[0].rstrip(" ").lower() in _DEVICES:
        return f"the name '{shown}', a device on Windows"
    return None


def below(folder: Path, name: str) -> Path:
    """Return the path of ``name`` directly below ``folder``.

    Raises `InputError` unless the name is one path component, and for a symbolic link of that name: writing through it
    would change a file elsewhere.
    """
    fault = name_fault(name)
    if fault is not None:
        raise InputError(str(folder), got=fault, wanted="a plain file name, below this folder")
    path = folder / name
    if path.is_symlink():
        raise InputError(str(path), got="a symbolic link", wanted="a name of its own for what is written")
    return path
