"""Where a calibration writes: the name of a rig file, and whether file and report can be written at all."""

import os
from pathlib import Path

from groundstation.errors import InputError, UsageError


def require_toml_name(out: Path) -> None:
    """Raise `UsageError` for a name that is none of a TOML file, `InputError` for a folder of that name."""
    if out.suffix != ".toml":
        raise UsageError(str(out), got="no name of a TOML file", wanted="--out rig.toml")
    if out.is_dir():
        raise InputError(str(out), got="a folder", wanted="--out rig.toml, a file")


def require_writable(out: Path, report: Path | None = None) -> None:
    """Raise `InputError` where a file, or a report's folder, cannot be written: before hours of work, not after."""
    wanted = {out: "a file in a folder that can be written"}
    if report is not None:
        wanted[report / "report.html"] = "a folder that can be written"
    for path, what in wanted.items():
        there = path.parent
        while not there.exists() and there != there.parent:
            there = there.parent
        if not there.is_dir():
            raise InputError(str(path), got=f"{there}, a file", wanted=what)
        if not os.access(path if path.exists() else there, os.W_OK):
            raise InputError(str(path), got="no permission to write", wanted=what)
