"""What the documentation's commands need that open a page for a browser."""

import os
import signal
import subprocess
import threading
import time
import urllib.request
from collections.abc import Mapping
from pathlib import Path

import pytest

from groundstation.viewer import viewer_process as rerun_viewer


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The page that `view --web` serves is requested, and kept here, and then Ctrl-C is pressed."""
    pages: list[str] = []
    serve, before = rerun_viewer.serve_recording, signal.getsignal(signal.SIGINT)

    def ask(address: str) -> None:
        deadline = time.monotonic() + 60.0
        while not pages and time.monotonic() < deadline:
            try:
                with urllib.request.urlopen(address, timeout=10.0) as page:
                    pages.append(page.read().decode())
            except OSError:
                time.sleep(0.05)
        while signal.getsignal(signal.SIGINT) is before and time.monotonic() < deadline:
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    def serve_and_ask(
        path: Path, environment: Mapping[str, str], web_port: int | None = None
    ) -> tuple[str, subprocess.Popen[bytes]]:
        address, process = serve(path, environment, web_port)
        threading.Thread(target=ask, args=(address,), daemon=True).start()
        return address, process

    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    # whether it stopped at once is seen by its answer
    monkeypatch.setattr(rerun_viewer, "STARTUP_S", 0.1)
    monkeypatch.setattr(rerun_viewer, "serve_recording", serve_and_ask)
    return pages
