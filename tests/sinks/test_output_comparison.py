"""Answers meet their recorded counterparts, whichever comes first."""

import json
from types import SimpleNamespace

import pytest

from groundstation.sinks import output_comparison
from groundstation.sinks.output_comparison import OutputComparisonSink


def report(epoch: int, x_m: float) -> SimpleNamespace:
    return SimpleNamespace(states=[], estimates=[SimpleNamespace(epoch=epoch, values={"epoch": epoch, "x_m": x_m})])


def recorded(epoch: int, x_m: float) -> bytes:
    return json.dumps({"epoch": epoch, "x_m": x_m, "latency_s": 0.1}).encode()


def test_answers_and_recorded_ones_meet_in_either_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output_comparison, "estimate_values", lambda estimate: estimate.values)
    sink = OutputComparisonSink()
    sink.recorded(recorded(1, 0.5))
    sink.write(report(1, 0.5))
    sink.write(report(2, 0.5))
    sink.recorded(recorded(2, 0.25))
    sink.write(report(3, 0.5))
    sink.recorded(recorded(4, 0.5))
    result = sink.result()
    assert (result.compared, result.differing, result.first_epoch, result.alone) == (2, 1, 2, 2)
