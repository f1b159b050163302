"""Every command in the documentation is run or, with a stated reason, accepted by the parser."""

import argparse
import ast
import os
import re
import shlex
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

from groundstation.cli.main import build_parser, main
from groundstation.viewer import viewer_process as rerun_viewer
from tests.docs.inputs import prepare
from tests.docs.pages import PAGES, ROOT, Block, arguments, blocks, spoken_commands, text_of

pytestmark = pytest.mark.usefixtures("unrendered_figures")

BLOCKS = {page: tuple(blocks(page)) for page in PAGES}
# every line of a shell that the pages show and that is not run here, and why
NOT_RUN = {
    ("airstrip.md", "groundstation cameras list"): "fails without a camera; tests/cli/test_cameras.py",
    ("airstrip.md", "groundstation ptu probe /dev/ttyUSB0"): "wants a unit; ptu.md runs it on a simulated one",
    ("airstrip.md", "groundstation check field.toml"): "wants cameras and units; tests/live/test_check_command.py",
    (
        "airstrip.md",
        "groundstation check field.toml --move",
    ): "wants cameras and units; tests/live/test_check_command.py",
    ("airstrip.md", "groundstation calibrate check today.csv --landmarks landmarks.csv --rig rig.toml"): (
        "calibration.md runs the same line"
    ),
    ("airstrip.md", "groundstation live field.toml --web"): "wants cameras and units; live.md runs it with simulated",
    ("bank.md", "groundstation bank validate.toml --out out/validate"): (
        "renders and replays for hours; tests/bank/test_bank_command.py"
    ),
    ("cameras.md", "groundstation cameras show"): "wants a camera at an address; the page runs it on a video",
    ("first-flight.md", ". .venv/bin/activate"): "changes the shell that it is typed into",
    ("learned-channel.md", "groundstation replay recordings/landing-1 --out out/classic --config classic.toml"): (
        "wants the file of the block above it; tests/replay/test_learned_replay.py"
    ),
    ("learned-channel.md", "groundstation train"): "trains for half an hour; tests/cli/test_train.py",
    (
        "learned-channel.md",
        "groundstation replay flights/one --weights",
    ): "wants own weights; tests/replay/test_learned_replay.py",
    ("rerun.md", "python - out/session.rrd 22.9 rerun.png <<'EOF'"): "wants a Vulkan driver and 12 s; compiled below",
    ("rerun.md", "python -c"): "reads that picture; compiled below",
}
# pages whose lines another file runs, to check their outputs as well
RUN_ELSEWHERE = {"reproduce.md": "tests/experiments/test_reproduce.py"}
RUN = [
    page for page in PAGES if any(not block.parsed_only for block in BLOCKS[page]) and page.name not in RUN_ELSEWHERE
]


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


def run_page(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, answered: list[str]) -> None:
    """Run what a page shows, from top to bottom, in a new folder; every command has to end well."""
    prepare(folder, ".")
    done = {"."}
    for block in BLOCKS[page]:
        if block.parsed_only:
            continue
        if block.folder not in done:
            prepare(folder, block.folder)
            done.add(block.folder)
        monkeypatch.chdir(folder / block.folder)
        run_block(block, answered)


@pytest.mark.usefixtures("unhurried_shutdown")
@pytest.mark.parametrize("page", RUN, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answered: list[str]) -> None:
    run_page(page, tmp_path, monkeypatch, answered)


def test_what_is_not_run_is_on_the_list() -> None:
    """Expected: no line of a shell on any page is neither run nor on the list, and nothing is there in vain."""
    left = set()
    for page in PAGES:
        for block in BLOCKS[page]:
            for line in block.commands:
                runs = line.startswith(("groundstation ", "make ")) and not block.parsed_only
                if not runs:
                    listed = [there for name, there in NOT_RUN if name == page.name and line.startswith(there)]
                    left.add((page.name, max(listed, key=len, default=line)))
    assert left == set(NOT_RUN)
    named = {name for why in NOT_RUN.values() for name in re.findall(r"tests/[\w/]+\.py", why)}
    assert all((ROOT / name).is_file() for name in named)
    for page, file in RUN_ELSEWHERE.items():
        assert f'run_page(ROOT / "docs" / "{page}", ' in text_of(ROOT / file)


def test_make_demo_and_make_test_match_the_pages() -> None:
    """Expected: the demo is the replay that the pages run, the test is what CI runs, and both build what they need."""
    assert "groundstation replay recordings/landing-1 --out" in dry_run("demo")
    assert all(word in dry_run("test") for word in ("-m pytest", "ruff check", "mypy"))
    assert "make test" in text_of(ROOT / ".ci" / "run")
    for words in (["replay", "recordings/landing-1"], ["replay", "flights/one"]):
        run = [arguments(line) for page in RUN for b in BLOCKS[page] if not b.parsed_only for line in b.commands]
        assert any(line[:2] == words for line in run)


def test_the_programs_of_the_pages_compile_and_their_imports_exist() -> None:
    programs = [program for page in PAGES for block in BLOCKS[page] for program in block.scripts]
    for page in PAGES:
        for block in BLOCKS[page]:
            programs += [shlex.split(line)[2] for line in block.commands if line.startswith("python -c ")]
    assert len(programs) == 2
    for program in programs:
        tree = ast.parse(program)
        found = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
        assert found
        for node in found:
            exec(compile(ast.Module([node], []), "a page", "exec"), {})


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
        for option in re.findall(r"(?<=[ \[])--[a-z][a-z0-9-]*", spoken):
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
