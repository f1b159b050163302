"""The rig of a script."""

from pathlib import Path

from groundstation.rig.rig import Rig
from groundstation.rig.rig import load_rig as load


def load_rig(path: str | Path) -> Rig:
    """Read a rig file: the calibrated stations. Raises `InputError` with file, station and key of the first fault."""
    return load(Path(path))
