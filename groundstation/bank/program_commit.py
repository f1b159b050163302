"""The commit of the program that runs, where it runs from a git checkout."""

import subprocess
from pathlib import Path

import groundstation

_TIMEOUT_S = 10.0
UNKNOWN = "unknown"


def program_commit() -> str:
    """Return the commit's first 12 digits, with ``+changes`` where files differ from it; ``unknown`` outside of git."""
    folder = Path(groundstation.__file__).parent.parent
    commit, changes = _git(folder, "rev-parse", "--short=12", "HEAD"), _git(folder, "status", "--porcelain", "-uno")
    if not commit:
        return UNKNOWN
    return commit + ("+changes" if changes else "")


def _git(folder: Path, *arguments: str) -> str:
    """Return what a git command prints, stripped; empty where it fails."""
    try:
        done = subprocess.run(
            ["git", *arguments], cwd=folder, capture_output=True, text=True, check=False, timeout=_TIMEOUT_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
