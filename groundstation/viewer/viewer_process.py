"""Opening a recording in Rerun's viewer, as a program of its own."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import rerun as rr

from groundstation.errors import GroundstationError, os_words

# a viewer that cannot start exits within this time
STARTUP_S = 2.0
_END_S = 10.0
# what a viewer that comes late may still see
_SERVER_MEMORY = "256MB"
# a server drops the oldest beyond its limit: a whole file has to be below it, with what is made of it
_SERVER_MARGIN, _SERVER_LEAST_BYTES = 2, 1_000_000_000
# a page in a browser can address 4 GB; 2 GB of videos took 3.3
MAX_BROWSER_BYTES = 2_000_000_000
# memory limit of a viewer that stays open all day; the oldest data are dropped beyond it
_LIVE_MEMORY = "1GB"


class ViewerError(GroundstationError):
    """The viewer cannot be shown."""


def viewer_command(path: Path) -> list[str]:
    """Return the command that opens a recording; it listens to this machine alone."""
    return [sys.executable, "-m", "rerun_cli", str(path), "--bind", "127.0.0.1", "--port", "auto"]


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
    if not has_display(environment):
        raise ViewerError(f"no display to show {path} on; on a desktop: rerun {path}; {browser}")
    process = _start(viewer_command(path), environment)
    code = _stopped(process)
    if code is not None and code != 0:
        raise ViewerError(f"the viewer stopped at once (exit code {code}); try it {browser}")
    return process


def web_viewer_command(path: Path, port: int, web_port: int) -> list[str]:
    """Return the command that serves a recording to browsers on this machine, and to no other."""
    command = [sys.executable, "-m", "rerun_cli", "--serve-web", "--bind", "127.0.0.1", "--port", str(port)]
    held = max(_SERVER_LEAST_BYTES, _SERVER_MARGIN * (path.stat().st_size if path.is_file() else 0))
    command += ["--web-viewer-port", str(web_port), "--server-memory-limit", f"{-(-held // 10**6)}MB"]
    return [*command, str(path)]


def browser_notice(path: Path) -> str:
    """Return what to tell a user whose recording may be too large for a browser, or nothing."""
    size = path.stat().st_size
    if size <= MAX_BROWSER_BYTES:
        return ""
    return (
        f"{size / 1e9:.1f} GB may be more than a browser holds ({MAX_BROWSER_BYTES / 1e9:g} GB it does): where the "
        "page stops, --view opens it without one, or show a part of it: groundstation replay SESSION --from S --to S"
    )


def serve_recording(
    path: Path, environment: Mapping[str, str], web_port: int | None = None
) -> tuple[str, subprocess.Popen[bytes]]:
    """Serve a recording to browsers on this machine alone; returns the address, and the server's process.

    ``web_port`` is the page's port; None takes any that is free. Raises `ViewerError` where there is no file, the port
    is not free or the server stops at once.
    """
    if not path.is_file():
        raise ViewerError(f"{path}: no such recording")
    port, web_port = free_port(), free_port(web_port)
    process = _start(web_viewer_command(path, port, web_port), environment)
    code = _stopped(process)
    if code is not None:
        raise ViewerError(f"the web viewer stopped at once (exit code {code})")
    return _web_address(port, web_port), process


def has_display(environment: Mapping[str, str]) -> bool:
    """Return whether the desktop viewer can be shown."""
    return not sys.platform.startswith("linux") or bool(
        environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")
    )


def live_viewer_command(port: int) -> list[str]:
    """Return the command that opens a viewer waiting for data on a port of this machine, and of no other."""
    command = [sys.executable, "-m", "rerun_cli", "--bind", "127.0.0.1", "--port", str(port), "--expect-data-soon"]
    return [*command, "--memory-limit", _LIVE_MEMORY]


def open_live_stream(application: str, environment: Mapping[str, str], instead: str) -> rr.RecordingStream:
    """Open the desktop viewer and return a stream that it shows as the data come.

    ``environment`` is the caller's (os.environ), ``instead`` what the user can do where it fails. Raises
    `ViewerError` where there is no display or the viewer stops at once.
    """
    if not has_display(environment):
        raise ViewerError(f"no display for --view; {instead}")
    port = free_port()
    code = _stopped(_start(live_viewer_command(port), environment))
    if code is not None:
        raise ViewerError(f"the viewer stopped at once (exit code {code}); {instead}")
    return _stream_to(application, port)


def open_web_stream(
    application: str, environment: Mapping[str, str], web_port: int | None = None
) -> tuple[rr.RecordingStream, str, subprocess.Popen[bytes]]:
    """Serve a viewer to browsers on this machine alone; returns a stream to it, its address, and its process.

    ``web_port`` as in `serve_recording`. Raises `ViewerError` where the port is not free or the server stops at once.
    """
    port, web_port = free_port(), free_port(web_port)
    command = [sys.executable, "-m", "rerun_cli", "--serve-web", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--web-viewer-port", str(web_port), "--server-memory-limit", _SERVER_MEMORY]
    process = _start(command, environment)
    code = _stopped(process)
    if code is not None:
        raise ViewerError(f"the web viewer stopped at once (exit code {code})")
    return _stream_to(application, port), _web_address(port, web_port), process


def _web_address(port: int, web_port: int) -> str:
    return f"http://127.0.0.1:{web_port}/?url=rerun%2Bhttp://127.0.0.1:{port}/proxy"


def stop_viewer(process: subprocess.Popen[bytes], within_s: float = _END_S) -> None:
    """End a viewer or server: Rerun's Python program is a shell around the one that works, and both have to go.

    What does not end within that time is killed.
    """
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(within_s)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(_END_S)


def free_port(port: int | None = None) -> int:
    """Return a free port of this machine, ``port`` if it is given; raises `ViewerError` if that is not free."""
    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            free.bind(("127.0.0.1", port or 0))
        except OSError as fault:
            raise ViewerError(f"--port: got {port}, which is in use ({os_words(fault)}); wanted a free one") from fault
        return int(free.getsockname()[1])


def _stream_to(application: str, port: int) -> rr.RecordingStream:
    stream = rr.RecordingStream(application, send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")
    return stream


def _start(command: list[str], environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        command,
        env=viewer_environment(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _stopped(process: subprocess.Popen[bytes]) -> int | None:
    """Return the exit code of a viewer that stops at once, None if it goes on."""
    try:
        return process.wait(timeout=STARTUP_S)
    except subprocess.TimeoutExpired:
        return None
