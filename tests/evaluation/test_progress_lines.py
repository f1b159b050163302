"""Progress lines are ended when a comparison fails, so that its error stands on a line of its own."""

import argparse
from pathlib import Path

import pytest

import groundstation.replay.compare
from groundstation.cli import evaluate as cli_evaluate
from groundstation.errors import InputError


def test_lines_are_ended_when_the_comparison_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []

    class Line:
        def __init__(self, stream: object, name: str) -> None:
            self.name = name

        def update(self, done: int, total: int) -> None:
            events.append(f"{self.name} {done}/{total}")

        def __exit__(self, *exception: object) -> None:
            events.append(f"{self.name} ended")

    def failing(request: object, progress: object) -> None:
        progress("one", 1, 2)
        progress("two", 1, 2)
        raise InputError("two", got="nothing", wanted="a session")

    monkeypatch.setattr(cli_evaluate, "ProgressLine", Line)
    monkeypatch.setattr(groundstation.replay.compare, "compare", failing)
    options = argparse.Namespace(
        sources=[tmp_path], out=tmp_path, config=[], rig=None, baseline=None, csv=None, json=None
    )
    with pytest.raises(InputError):
        cli_evaluate.run_evaluate(options)
    assert events == ["one 1/2", "two 1/2", "one ended", "two ended"]
