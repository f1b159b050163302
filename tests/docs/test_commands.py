"""Every command in the documentation is run or, with a stated reason, accepted by the parser."""

import argparse
import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundstation.cli.main import build_parser
from tests.docs.long_blocks import BLOCKS, LONG, is_long, run_by_docs_check, run_by_test
from tests.docs.pages import PAGES, ROOT, arguments, spoken_commands, text_of
from tests.docs.run_blocks import dry_run, run_blocks

pytestmark = pytest.mark.usefixtures("unrendered_figures")

# every line of a shell that the pages show and that is not run here, and why
NOT_RUN = {
    ("autopilot.md", "$ pip install 'groundstation[autopilot]'"): "installs",
    (
        "autopilot.md",
        "$ groundstation autopilot check udpin:14550 --mode gps_input --out vehicle.parm",
    ): "a vehicle; tests/autopilot/test_parameters.py",
    (
        "autopilot.md",
        "$ groundstation live field.toml --site landing-site.toml --autopilot udpout:192.168.0.7:14550 "
        "--autopilot-mode gps_input",
    ): "devices; tests/approach/test_approach_replay.py",
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
    ("calibration.md", "pip install 'groundstation[stars]'"): "installs",
    ("calibration.md", "groundstation calibrate stars field.toml"): (
        "wants heads under a night sky; tests/calibration/stars/test_stars_command.py"
    ),
    ("calibration.md", "groundstation calibrate panorama swing"): (
        "wants two sessions of one place; tests/calibration/panorama/test_panorama.py"
    ),
    ("calibration.md", "groundstation replay flight --panorama panorama.npz"): "wants the panorama of the line above",
    ("calibration.md", "groundstation calibrate combine"): (
        "wants rigs of several sources; tests/calibration/combination/test_combination.py"
    ),
    ("calibration.md", "groundstation calibrate sky"): (
        "wants a receiver and airliners; tests/calibration/sky/test_sky_fit.py"
    ),
    ("calibration.md", "groundstation calibrate sightings field.toml left"): (
        "wants cameras and units; tests/calibration/landmarks/test_sightings_command.py"
    ),
    ("cameras.md", "groundstation cameras show"): "wants a camera at an address; the page runs it on a video",
    ("detection.md", "groundstation train --out out/echoed"): "wants a GPU and sixteen cores; tests/cli/test_train.py",
    ("first-flight.md", ". .venv/bin/activate"): "changes the shell that it is typed into",
    ("learned-channel.md", "groundstation replay recordings/landing-1 --out out/classic --config classic.toml"): (
        "wants the file of the block above it; tests/replay/test_learned_replay.py"
    ),
    ("learned-channel.md", "groundstation train"): "trains for half an hour; tests/cli/test_train.py",
    ("learned-channel.md", "groundstation train-proposals --out"): "trains for an hour; tests/cli/test_train.py",
    (
        "learned-channel.md",
        "groundstation replay flights/one --weights",
    ): "wants own weights; tests/replay/test_learned_replay.py",
    ("rerun.md", "python - out/session.rrd 22.9 rerun.png <<'EOF'"): "wants a Vulkan driver and 12 s; compiled below",
    ("rerun.md", "python -c"): "reads that picture; compiled below",
}
# pages whose lines another file runs, to check their outputs as well
RUN_ELSEWHERE = {"reproduce.md": "tests/experiments/test_reproduce.py"}
RUN = [page for page in PAGES if run_by_test(page) and page.name not in RUN_ELSEWHERE]


def leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    kinds = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for child in (child for kind in kinds for child in kind.choices.values()):
        yield from leaves(child)
    if not kinds:
        yield parser


@pytest.mark.usefixtures("unhurried_shutdown")
@pytest.mark.parametrize("page", RUN, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answered: list[str]) -> None:
    run_blocks(run_by_test(page), tmp_path, monkeypatch, answered)


def test_each_block_is_run_by_one_of_the_two() -> None:
    """Expected: each line of the list names one block that is run, and docs-check runs those and no others."""
    for name, line in LONG:
        named = [b for page in PAGES for b in BLOCKS[page] if b.page.name == name and b.commands[0].startswith(line)]
        assert len(named) == 1, f"{name}: {line}"
        assert is_long(named[0])
        assert not named[0].parsed_only
        assert name not in RUN_ELSEWHERE
    for page in PAGES:
        both = [*run_by_test(page), *run_by_docs_check(page)]
        assert sorted(b.line for b in both) == [b.line for b in BLOCKS[page] if not b.parsed_only]
    assert sum(len(run_by_docs_check(page)) for page in PAGES) == len(LONG)
    assert "-m pytest tests/docs/check_long_commands.py\n" in dry_run("docs-check")
    assert "run_by_docs_check(page)" in text_of(ROOT / "tests" / "docs" / "check_long_commands.py")


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
        assert f'run_by_test(ROOT / "docs" / "{page}")' in text_of(ROOT / file)


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
    targets = set(re.findall(r"^([a-z-]+):", text_of(ROOT / "Makefile"), re.MULTILINE))
    for block in BLOCKS[page]:
        for line in block.commands:
            if line.startswith("make "):
                assert line.split()[1] in targets
    for name in re.findall(r"benchmarks/\w+\.py", text_of(page)):
        assert (ROOT / name).exists(), name
