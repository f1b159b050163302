"""Where a Rerun recording is written until it is whole; does not import Rerun."""

import os
from contextlib import suppress
from pathlib import Path


def draft_of(path: Path) -> Path:
    """Return where this process writes what is to become ``path``."""
    return path.with_name(f".{os.getpid()}.part.{path.name}")


def remove_draft(path: Path) -> None:
    """Delete what this process has written of a recording that never got its name."""
    with suppress(OSError):
        draft_of(path).unlink(missing_ok=True)
