"""What the simulated range keeps of the truth, and its end while it is built."""

import multiprocessing as mp
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest

from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation.device_simulator import DeviceSimulator, DeviceSimulatorConfig
from groundstation.simulation.nose_truth import NoseTruth
from tests.simulation.small_site import small_rig, straight


def test_the_truth_of_each_picture_is_kept_in_order() -> None:
    truth = NoseTruth()
    assert truth.rows().shape == (0, 3)
    truth.add(0, 1.5, 10.0, 20.0)
    truth.add(1, 1.6, float("nan"), float("nan"))
    np.testing.assert_array_equal(truth.rows(), [[1.5, 10.0, 20.0], [1.6, np.nan, np.nan]])
    assert truth.missing == 0


def test_pictures_that_did_not_come_are_counted() -> None:
    """Expected: from the first picture that came; a picture that comes again is none that is missing."""
    truth = NoseTruth()
    for number in (5, 6, 9, 9, 10, 20):
        truth.add(number, 0.1 * number, 1.0, 2.0)
    assert truth.missing == 2 + 9


def test_an_interrupt_while_the_range_is_built_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Expected: its process, which hears nothing meanwhile, is ended at once and has no last words."""
    (tmp_path / "rig.toml").write_text(rig_to_toml(small_rig()), encoding="utf-8")
    begun = []

    def interrupted(*_: object) -> bool:
        begun.extend(mp.active_children())
        raise KeyboardInterrupt

    monkeypatch.setattr(Connection, "poll", interrupted)
    flight = straight((0.0, 300.0, 30.0))
    simulator = DeviceSimulator(DeviceSimulatorConfig(rig=tmp_path / "rig.toml", folder=tmp_path, flight=flight))
    with pytest.raises(KeyboardInterrupt), simulator:
        pass
    assert begun
    assert not set(begun) & set(mp.active_children())
    assert capfd.readouterr().err == ""


def test_a_stop_while_the_range_is_built_ends_it(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Expected: it is not waited for; its process has ended before the caller goes on, and leaves no word."""
    (tmp_path / "rig.toml").write_text(rig_to_toml(small_rig()), encoding="utf-8")
    before = set(mp.active_children())
    config = DeviceSimulatorConfig(rig=tmp_path / "rig.toml", folder=tmp_path, flight=straight((0.0, 300.0, 30.0)))
    with pytest.raises(KeyboardInterrupt), DeviceSimulator(config, stop=lambda: True):
        pass
    assert set(mp.active_children()) <= before
    assert capfd.readouterr().err == ""
