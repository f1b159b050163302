"""The name under which a calibration writes a rig file."""

from pathlib import Path

from groundstation.errors import InputError, UsageError


def require_toml_name(out: Path) -> None:
    """Raise `UsageError` for a name that is none of a TOML file, `InputError` for a folder of that name."""
    if out.suffix != ".toml":
        raise UsageError(str(out), got="no name of a TOML file", wanted="--out rig.toml")
    if out.is_dir():
        raise InputError(str(out), got="a folder", wanted="--out rig.toml, a file")
