"""The FLIR driver's traffic and reports are those of the traces that are kept, byte by byte and to 0.1 ms."""

import pytest

from tests.ptu_drivers.flir.wire_traces import FOLDER, SCENARIOS


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_traffic_and_reports_are_unchanged(name: str) -> None:
    kept = (FOLDER / f"{name}.txt").read_text(encoding="utf-8")
    assert SCENARIOS[name]().splitlines() == kept.splitlines()


def test_every_trace_has_its_scenario() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == set(SCENARIOS)
