"""The tables of runway edges without a filter: each scene's own error, and all together."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.experiments import onboard_energies, onboard_segmentation
from groundstation.experiments.onboard_energies import SCENES, EnergyApproach, _rms, _table
from groundstation.experiments.onboard_segmentation import _carried_table


def alone(scene: str, size_px: float) -> EnergyApproach:
    errors = {method: np.full((3, 4), size_px) for method in onboard_energies._PAPERS}
    return EnergyApproach(scene=scene, seed=1, last=None, truth=(np.zeros(2), np.zeros(2)), errors=errors)


def test_the_root_mean_square_of_several_and_of_none() -> None:
    assert _rms([np.array([3.0, 3.0]), np.array([4.0, 4.0])]) == pytest.approx(np.sqrt(12.5))
    assert _rms([]) == 0.0


def test_each_scene_has_its_own_column(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onboard_energies, "order_words", lambda every, variant: variant)
    table = _table([alone(SCENES[0], 1.0), alone(SCENES[1], 2.0), alone(SCENES[1], 4.0)])
    for row in table.rows:
        assert row[1:4] == pytest.approx([1.0, np.sqrt(10.0), 0.0])
        assert row[6] == pytest.approx(np.sqrt(7.0))
        assert row[7] == pytest.approx(2.0)


def test_what_segmentation_carries_is_compared_with_the_true_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = np.array([10.0, 20.0, 30.0, 40.0])
    monkeypatch.setattr(onboard_segmentation, "true_edges", lambda sequence, truth: (wanted + truth, None))
    frames = [SimpleNamespace(truth=float(k)) for k in range(3)]
    found = np.array([wanted, wanted + 3.0, wanted + 2.0 + 1e6])
    seen = SimpleNamespace(sequence=SimpleNamespace(name="day"), frames=frames, carried={"flat": found})
    (row,) = _carried_table([seen]).rows
    most = float(onboard_segmentation.LOST_PX)
    assert row == ["day", "flat", 3, pytest.approx(np.sqrt((0.0 + 4.0 + most**2) / 3.0)), pytest.approx(2.0), most]
