"""Hard examples: what a network errs on is drawn more often, and nothing is left out."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra train is not installed")
pytest.importorskip("onnx", reason="extra train is not installed")

from pathlib import Path

from groundstation.errors import InputError
from groundstation.files.channel_weights import WEIGHTS
from groundstation.simulation.world.draw_world import draw_world
from training.export import load_onnx
from training.filmed_targets import filmed_targets
from training.fit import FitSettings, fit
from training.hard_examples import draw_shares
from training.material import Material


def test_what_a_network_errs_on_is_drawn_more_often() -> None:
    targets = list(filmed_targets(draw_world(11), 8, np.random.default_rng(7)))
    # labelled as if the aircraft were not there
    wrong = [replace(target, cover=np.zeros_like(target.cover)) for target in targets[::2]]
    network = load_onnx(WEIGHTS)
    shares = draw_shares(network, [*targets, *wrong])
    assert shares.sum() == pytest.approx(1.0)
    assert shares.min() >= 0.5 / len(shares)
    right, labelled_wrong = shares[: len(targets)], shares[len(targets) :]
    assert labelled_wrong.mean() > 2.0 * right.mean()
    assert network.training
    assert draw_shares(network, []).size == 0


def test_a_run_goes_on_with_the_same_filmed_targets_only(tmp_path: Path) -> None:
    targets = tuple(filmed_targets(draw_world(11), 4, np.random.default_rng(7)))
    material = Material(aircraft=(), birds=(), backgrounds=(), filmed=targets)
    settings = FitSettings(steps=2, batch=2, filmed_share=1.0, hard=True, every=1)
    network = fit(material, (), settings, tmp_path, start=load_onnx(WEIGHTS)).network
    again = fit(material, (), settings, tmp_path, start=load_onnx(WEIGHTS)).network
    for one, other in zip(network.state_dict().values(), again.state_dict().values(), strict=True):
        np.testing.assert_array_equal(one.cpu().numpy(), other.cpu().numpy())
    with pytest.raises(InputError, match="filmed targets"):
        fit(replace(material, filmed=targets[1:]), (), settings, tmp_path, start=load_onnx(WEIGHTS))
    with pytest.raises(InputError, match="hard"):
        fit(material, (), settings, tmp_path / "other")
