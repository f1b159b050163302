"""Every command that the documentation shows is run, or, where it says why not, accepted by the parser."""

import argparse
import os
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from groundstation.cli import build_parser, main
from groundstation.sinks import rerun_viewer
from tests.docs.inputs import prepare
from tests.docs.pages import PAGES, ROOT, Block, arguments, blocks, spoken_commands, text_of

BLOCKS = {page: tuple(blocks(page)) for page in PAGES}
RUN = [page for page in PAGES if any(not block.parsed_only for block in BLOCKS[page])]


def leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    kinds = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for child in (child for kind in kinds for child in kind.choices.values()):
        yield from leaves(child)
    if not kinds:
        yield parser


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


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What `view --web` serves is asked for its page, which is kept here, and then Ctrl-C is pressed."""
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

    def serve_and_ask(path: Path, environment: Mapping[str, str]) -> tuple[str, subprocess.Popen[bytes]]:
        address, process = serve(path, environment)
        threading.Thread(target=ask, args=(address,), daemon=True).start()
        return address, process

    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    # whether it stopped at once is seen by its answer
    monkeypatch.setattr(rerun_viewer, "STARTUP_S", 0.1)
    monkeypatch.setattr(rerun_viewer, "serve_recording", serve_and_ask)
    return pages


def run_block(block: Block, answered: list[str]) -> None:
    behind: list[list[str]] = []
    lines = [line for line in block.commands if line.startswith("groundstation ")]
    for line in lines:
        words = arguments(line, block.extra)
        if line.endswith("&"):
            behind.append(words)
            continue
        where = f"{block.page.name}:{block.line}: {line}"
        if behind:
            with in_background(behind[0]):
                assert main(words) == 0, where
        else:
            assert main(words) == 0, where
            if words[0] == "view":
                assert "<title>Rerun Viewer</title>" in answered.pop(), where


@pytest.mark.parametrize("page", RUN, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answered: list[str]) -> None:
    prepare(tmp_path, ".")
    done = {"."}
    for block in BLOCKS[page]:
        if block.parsed_only:
            continue
        if block.folder not in done:
            prepare(tmp_path, block.folder)
            done.add(block.folder)
        monkeypatch.chdir(tmp_path / block.folder)
        run_block(block, answered)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_parse(page: Path) -> None:
    for block in BLOCKS[page]:
        for line in block.commands:
            if line.startswith("groundstation ") and "--version" not in line:
                build_parser().parse_args(arguments(line))


@pytest.mark.parametrize("parser", list(leaves(build_parser())), ids=lambda p: p.prog)
def test_examples_of_the_help_parse(parser: argparse.ArgumentParser) -> None:
    text = (parser.epilog or "").replace("\\\n", " ")
    for line in re.findall(r"^ +(groundstation .+)$", text, re.MULTILINE):
        build_parser().parse_args(arguments(line))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_in_sentences_exist(page: Path) -> None:
    known = {parser.prog: set(parser._option_string_actions) for parser in leaves(build_parser())}
    for spoken in spoken_commands(page):
        words = re.match(r"groundstation( [a-z][a-z-]*)*", spoken)
        assert words is not None
        name = words[0]
        own = [options for prog, options in known.items() if (prog + " ").startswith(name + " ")]
        own += [options for prog, options in known.items() if (name + " ").startswith(prog + " ")]
        if name == "groundstation":
            own = [{"--help", "--version"}]
        assert own, f"no such command: {spoken}"
        for option in re.findall(r"(?<=[ \[])--[a-z][a-z-]*", spoken):
            assert any(option in options for options in own), f"{spoken}: no {option}"


def test_every_command_is_on_the_page_of_commands() -> None:
    spoken = set(spoken_commands(ROOT / "docs" / "commands.md"))
    assert {parser.prog for parser in leaves(build_parser())} <= spoken


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_targets_and_benchmarks_exist(page: Path) -> None:
    targets = set(re.findall(r"^([a-z]+):", text_of(ROOT / "Makefile"), re.MULTILINE))
    for block in BLOCKS[page]:
        for line in block.commands:
            if line.startswith("make "):
                assert line.split()[1] in targets
    for name in re.findall(r"benchmarks/\w+\.py", text_of(page)):
        assert (ROOT / name).exists(), name
