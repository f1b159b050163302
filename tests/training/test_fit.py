"""Fitting: the same with any number of processes, and a network that is not shown a kind."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra train is not installed")
pytest.importorskip("onnx", reason="extra train is not installed")

import torch

from groundstation.simulation.world.draw_world import draw_world
from training.filmed_targets import filmed_targets
from training.fit import FitSettings, Fitted, fit, window_stream
from training.material import Material
from training.network import ChannelNetwork

SETTINGS = FitSettings(steps=4, batch=6, filmed_share=1.0, every=2)


@pytest.fixture(scope="module")
def material() -> Material:
    """Two worlds of different kinds; the second one's windows are named so."""
    found = []
    for seed in (11, 1):
        found += [
            replace(target, kinds=(f"kind-{seed}",))
            for target in filmed_targets(draw_world(seed), 3, np.random.default_rng(7))
        ]
    return Material(aircraft=(), birds=(), backgrounds=(), filmed=tuple(found))


def _same(one: ChannelNetwork, other: ChannelNetwork) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(bool(torch.equal(first, second)) for first, second in pairs)


def _fit(material: Material, folder: Path, settings: FitSettings = SETTINGS, workers: int = 0) -> Fitted:
    return fit(material, (), settings, folder, workers=workers)


def test_windows_are_the_same_with_any_number_of_processes(material: Material) -> None:
    stream = window_stream(material, (), SETTINGS)
    for one, two in zip(stream.batches(0, 3, 0), stream.batches(0, 3, 2), strict=True):
        for name in ("windows", "shares", "noses"):
            assert torch.equal(torch.nan_to_num(getattr(one, name)), torch.nan_to_num(getattr(two, name)))
        assert one.kinds == two.kinds


def test_an_interrupted_run_ends_as_one_that_was_not(material: Material, tmp_path: Path) -> None:
    class StoppedError(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise StoppedError

    settings = replace(SETTINGS, leave_out=("kind-1",))
    with pytest.raises(StoppedError):
        fit(material, (), settings, tmp_path / "one", stop)
    resumed, whole = _fit(material, tmp_path / "one", settings), _fit(material, tmp_path / "two", settings)
    assert _same(resumed.network, whole.network)
    assert _same(resumed.without["kind-1"], whole.without["kind-1"])
    assert (tmp_path / "one" / "log.csv").read_text() == (tmp_path / "two" / "log.csv").read_text()


def test_a_network_that_leaves_a_kind_out_is_not_shown_it(material: Material, tmp_path: Path) -> None:
    fitted = _fit(material, tmp_path / "both", replace(SETTINGS, leave_out=("kind-1", "no such")))
    alone = _fit(material, tmp_path / "alone")
    # the others do not change the first
    assert _same(fitted.network, alone.network)
    assert _same(fitted.without["no such"], fitted.network)
    assert not _same(fitted.without["kind-1"], fitted.network)
    batch = next(iter(window_stream(material, (), SETTINGS).batches(0, 1, 0)))
    shown = batch.without(frozenset({"kind-1"}))
    assert 0 < len(shown.kinds) < len(batch.kinds)
    kept = [k for k, kinds in enumerate(batch.kinds) if kinds != ("kind-1",)]
    assert torch.equal(shown.windows, batch.windows[kept])
    assert torch.equal(shown.shares, batch.shares[kept])


def test_a_network_without_any_window_left_stays_as_it_began(material: Material, tmp_path: Path) -> None:
    one = replace(material, filmed=tuple(each for each in material.filmed if each.kinds == ("kind-1",)))
    fitted = _fit(one, tmp_path, replace(SETTINGS, leave_out=("kind-1",)))
    torch.manual_seed(SETTINGS.seed)
    begun = ChannelNetwork()
    assert _same(fitted.without["kind-1"], begun)
    assert not _same(fitted.network, begun)
