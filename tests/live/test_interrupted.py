"""Ctrl-C while a station is being opened: nobody is left behind, and nobody complains."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from groundstation.live.child import deaf_to_ctrl_c
from groundstation.live.command import LiveRequest, live

ASKED = "import signal, sys; sys.exit(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"


def test_a_child_hears_nothing_and_its_parent_hears_again() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with deaf_to_ctrl_c():
        deaf = subprocess.run([sys.executable, "-S", "-c", ASKED], check=False).returncode
    hears = subprocess.run([sys.executable, "-S", "-c", ASKED], check=False).returncode
    assert (deaf, hears) == (1, signal.SIGINT in before)
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


def test_what_is_not_wanted_any_more_is_not_opened(tmp_path: Path) -> None:
    said: list[str] = []
    request = LiveRequest(station=None, out=tmp_path / "out", simulate=True)
    with pytest.raises(KeyboardInterrupt):
        live(request, lambda: True, lambda status: None, said.append)
    assert said == []
