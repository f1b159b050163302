"""Ctrl-C while the program is still being read."""

import subprocess
import sys
from pathlib import Path

import pytest

import groundstation.cli
from groundstation.cli_start import main

ROOT = Path(__file__).resolve().parents[1]
# whoever imports the command line is interrupted
INTERRUPTED = """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "groundstation.cli":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Finder())
from groundstation.cli_start import main
sys.exit(main())
"""


def test_interrupted_while_it_is_read_it_ends_quietly() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "groundstation: interrupted\n")


def test_else_it_is_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(groundstation.cli, "main", lambda: 7)
    assert main() == 7
