"""Blocks of the documentation's commands, run in a folder of prepared inputs."""

import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from groundstation.cli.main import main
from tests.docs.inputs import prepare
from tests.docs.pages import ROOT, Block, arguments


@contextmanager
def in_background(command: list[str]) -> Iterator[None]:
    """Run a command of a line that ends in &, until the page is done."""
    link = Path(command[command.index("--link") + 1])
    with subprocess.Popen([sys.executable, "-m", "groundstation", *command], stdout=subprocess.DEVNULL) as process:
        while not link.exists():
            assert process.poll() is None, f"{command} ended"
            time.sleep(0.05)
        yield
        process.terminate()


def run_block(block: Block, answered: list[str]) -> None:
    behind: list[list[str]] = []
    for line in block.commands:
        where = f"{block.page.name}:{block.line}: {line}"
        if line.startswith("make "):
            # what it would do: what `demo` and `test` are made of is run elsewhere
            assert dry_run(line.split()[1]), where
        if not line.startswith("groundstation "):
            continue
        words = arguments(line, block.extra)
        if line.endswith("&"):
            behind.append(words)
            continue
        if behind:
            with in_background(behind[0]):
                assert main(words) == 0, where
        elif words == ["--version"]:
            with pytest.raises(SystemExit) as ended:
                main(words)
            assert ended.value.code == 0, where
        else:
            assert main(words) == 0, where
            if words[0] == "view":
                assert "<title>Rerun Viewer</title>" in answered.pop(), where


def dry_run(target: str) -> str:
    """What make would do for a target, by make itself."""
    make = subprocess.run(["make", "-n", "-C", ROOT, target], capture_output=True, text=True, check=True)
    return make.stdout


def run_blocks(chosen: Iterable[Block], folder: Path, monkeypatch: pytest.MonkeyPatch, answered: list[str]) -> None:
    """Run blocks of a page, from top to bottom, in a new folder; every command has to end well."""
    prepare(folder, ".")
    done = {"."}
    for block in chosen:
        if block.folder not in done:
            prepare(folder, block.folder)
            done.add(block.folder)
        monkeypatch.chdir(folder / block.folder)
        run_block(block, answered)
