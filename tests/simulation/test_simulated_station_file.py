"""The station file of a simulated range."""

from pathlib import Path

from groundstation.simulation.simulated_station_file import simulated_station_file
from ptu_drivers.flir import setup


def test_its_units_are_waited_for_on_a_busy_computer(tmp_path: Path) -> None:
    """Expected: as long as a true unit that homes is deaf for is too long, and a true one's patience is too short."""
    heads = [station.head for station in simulated_station_file(tmp_path, 10.0, None).stations]
    assert len(heads) == 2
    for head in heads:
        assert head is not None
        assert 20.0 <= head.options["patience_s"] <= setup._HOMING_S
