"""Opening a recording in Rerun's viewer, as a program of its own."""

import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from groundstation.errors import GroundstationError

# a viewer that cannot start says so within this time
STARTUP_S = 2.0


class ViewerError(GroundstationError):
    """The viewer cannot be shown."""


def viewer_command(path: Path) -> list[str]:
    """Return the command that opens a recording; it listens to this machine alone."""
    return [sys.executable, "-m", "rerun", str(path), "--bind", "127.0.0.1", "--port", "auto"]


def viewer_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the caller's environment with the viewer's usage reports off, for this process only."""
    return {**environment, "RERUN_ANALYTICS": "0"}


def video_notice(environment: Mapping[str, str]) -> str:
    """Return what to tell a user whose desktop viewer will not show H.264 video, or nothing."""
    if shutil.which("ffmpeg", path=environment.get("PATH")):
        return ""
    return "the viewer shows H.264 video through ffmpeg, which is not installed: pictures will be missing"


def open_viewer(path: Path, environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    """Open a recording in the desktop viewer and return its process, which goes on by itself.

    ``environment`` is the caller's (os.environ). Raises `ViewerError` where there is no file, no display or
    the viewer stops at once.
    """
    if not path.is_file():
        raise ViewerError(f"{path}: no such recording")
    browser = f"in a browser: rerun --web-viewer --bind 127.0.0.1 {path}"
    if sys.platform.startswith("linux") and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        raise ViewerError(f"no display to show {path} on; on a desktop: rerun {path}; {browser}")
    process = subprocess.Popen(
        viewer_command(path),
        env=viewer_environment(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        code = process.wait(timeout=STARTUP_S)
    except subprocess.TimeoutExpired:
        return process
    if code != 0:
        raise ViewerError(f"the viewer stopped at once (exit code {code}); try it {browser}")
    return process
