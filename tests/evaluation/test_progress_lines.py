"""The progress display is closed when a comparison fails, so that its error is printed on a line of its own."""

import argparse
from collections.abc import Callable
from pathlib import Path

import pytest

import groundstation.replay.compare
from groundstation.cli import evaluate as cli_evaluate
from groundstation.cli.progress import ProgressDisplay
from groundstation.errors import InputError


def test_progress_is_closed_when_the_comparison_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []

    class Display(ProgressDisplay):
        def update(self, name: str, done: int, total: int | None) -> None:
            events.append(f"{name} {done}/{total}")

        def __exit__(self, *_: object) -> None:
            events.append("closed")

    def failing(request: object, progress: Callable[[str, int, int], None]) -> None:
        progress("one", 1, 2)
        progress("two", 1, 2)
        raise InputError("two", got="nothing", wanted="a session")

    monkeypatch.setattr(cli_evaluate, "ProgressDisplay", Display)
    monkeypatch.setattr(groundstation.replay.compare, "compare", failing)
    options = argparse.Namespace(
        sources=[tmp_path], out=tmp_path, config=[], rig=None, baseline=None, csv=None, json=None
    )
    with pytest.raises(InputError):
        cli_evaluate.run_evaluate(options)
    assert events == ["one 1/2", "two 1/2", "closed"]
