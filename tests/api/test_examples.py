"""The examples and the notebook run, print what they say, and use public names only."""

import ast
import json
import re
import runpy
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

import groundstation

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
NOTEBOOK = json.loads((ROOT / "examples" / "landing.ipynb").read_text(encoding="utf-8"))
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
CELLS = ["".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
# a line that each script must print, which shows that it has found its aircraft
PRINTED = {
    "compare_tunings.py": r"apart in [1-9]\d* pairs: median 0\.\d\d m",
    "own_detector.py": r"own detector: [1-9]\d* of 40 pairs tracked",
    "pixels_with_sigma.py": r" 4\.00 s tracking: error \[",
    "plot_track.py": r"wrote track\.png: [1-9]\d* pairs",
    "replay_to_arrays.py": r"landing-1: [1-9]\d* of 40 pairs tracked",
    "track_event_by_event.py": r"acquiring → tracking(.|\n)*in 0\.12 s \[",
}


@pytest.fixture(scope="module")
def kept() -> dict[tuple[float, float], groundstation.ReplayedSession]:
    """Replays of seconds of the bundled landing with the program's own detector and tuning."""
    return {}


@pytest.fixture
def replayed_once(
    kept: dict[tuple[float, float], groundstation.ReplayedSession],
    landing_1: Path,
    landing_from_20_s: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of those that replay the same seconds the first does, from the bundled landing's copy; others have its run."""
    replay = groundstation.replay_session

    def once(path: str | Path, **options: Any) -> groundstation.ReplayedSession:
        assert any(Path(path).samefile(known) for known in (landing_1, landing_from_20_s))
        given = {name: value for name, value in options.items() if value is not None}
        if set(given) != {"from_s", "to_s"}:
            return replay(landing_from_20_s, **given)
        span = given["from_s"], given["to_s"]
        if span not in kept:
            kept[span] = replay(landing_from_20_s, **given)
        return kept[span]

    monkeypatch.setattr(groundstation, "replay_session", once)


def test_there_are_six_and_the_page_names_each() -> None:
    assert {path.name for path in SCRIPTS} == set(PRINTED)
    listed = set(re.findall(r"`([\w.]+\.(?:py|ipynb))`", (ROOT / "examples" / "README.md").read_text(encoding="utf-8")))
    assert listed == {*PRINTED, "landing.ipynb"}


@pytest.mark.usefixtures("replayed_once")
@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_runs(
    path: Path,
    landing_from_20_s: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Expected: one finds the bundled landing by itself, as all do; the others are given a copy."""
    monkeypatch.chdir(tmp_path)
    session = [] if path.stem == "plot_track" else ["--session", str(landing_from_20_s)]
    monkeypatch.setattr(sys, "argv", [str(path), *session])
    with np.printoptions():
        runpy.run_path(str(path), run_name="__main__")
    assert re.search(PRINTED[path.name], capsys.readouterr().out)
    assert [each.name for each in tmp_path.iterdir()] == (["track.png"] if path.stem == "plot_track" else [])


@pytest.mark.parametrize(
    "path", [path for path in SCRIPTS if "--session" in path.read_text(encoding="utf-8")], ids=lambda path: path.stem
)
def test_a_wrong_session_is_one_line(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the program's own line, exit code 1 (Python's for a text), no traceback."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path), "--session", "nowhere"])
    with np.printoptions(), pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    assert re.fullmatch(
        r"groundstation: nowhere(/rig\.toml)?: got no such (folder|file); wanted .*", str(ended.value.code)
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("source", [*(path.read_text(encoding="utf-8") for path in SCRIPTS), *CELLS])
def test_only_public_names_are_used(source: str) -> None:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            assert not str(node.module).startswith("groundstation")
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "groundstation":
            assert node.attr in groundstation.__all__


@pytest.mark.usefixtures("replayed_once")
def test_the_notebook_runs_and_prints_what_it_shows(
    landing_from_20_s: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Counts as committed, figures to their last digit but one; the picture is there."""
    monkeypatch.chdir(landing_from_20_s.parents[1])
    assert (NOTEBOOK["nbformat"], NOTEBOOK["nbformat_minor"]) == (4, 5)
    names: dict[str, object] = {"__name__": "__main__"}
    shown = []
    with mpl.rc_context({"backend": "agg"}):
        for source in CELLS:
            exec(compile(source, "landing.ipynb", "exec"), names)
            shown.append(capsys.readouterr().out)
    outputs = [cell["outputs"] for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
    for printed, kept in zip(shown, outputs, strict=True):
        text = "".join("".join(output["text"]) for output in kept if output["output_type"] == "stream")
        numbers, expected = (re.findall(r"\d+(?:\.\d+)?", each) for each in (printed, text))
        assert re.sub(r"\d+(\.\d+)?", "#", printed) == re.sub(r"\d+(\.\d+)?", "#", text)
        np.testing.assert_allclose([float(n) for n in numbers], [float(n) for n in expected], rtol=0.1, atol=0.02)
    assert any("image/png" in output.get("data", {}) for kept in outputs for output in kept)


@pytest.mark.usefixtures("replayed_once")
@pytest.mark.parametrize("code", re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
def test_the_page_s_blocks_run(
    code: str, landing_from_20_s: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(landing_from_20_s.parents[1])
    exec(compile(code, "python.md", "exec"), {"__name__": "__main__"})
    assert re.search(r"landing-1|\d\d\.\d\d s tracking", capsys.readouterr().out)


def test_the_reference_lists_every_public_name() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. auto(?:class|function|exception):: (\w+)$", page, re.MULTILINE)
    assert sorted([*listed, "__version__"]) == sorted(groundstation.__all__)


@pytest.mark.parametrize("name", [name for name in groundstation.__all__ if name != "__version__"])
def test_a_public_docstring_gives_units_or_shapes_of_its_fields(name: str) -> None:
    """Every field of a record, or parameter of a function, is named in the docstring of its class or function."""
    thing = getattr(groundstation, name)
    fields = getattr(thing, "__dataclass_fields__", {})
    assert thing.__doc__, name
    # what means the same in every record is explained once
    common = {"t_s", "station", "epoch", "status", "u_px", "v_px", "events", "cameras", "kinematics", "image", "result"}
    missing = [field for field in fields if field not in thing.__doc__ and field not in common]
    assert not missing
