"""Windows that are shown again: their truth goes with them, and an interrupted run is as one that was not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra train is not installed")
pytest.importorskip("onnx", reason="extra train is not installed")

import torch

from groundstation.simulation.world.draw_world import draw_world
from training.echo import EchoBuffer, moved
from training.filmed_targets import filmed_targets
from training.fit import FitSettings, fit
from training.losses import WindowBatch
from training.material import Material

COUNT = 64
SETTINGS = FitSettings(steps=7, batch=4, filmed_share=1.0, every=1, echo=3, kept=8)


def _spots() -> WindowBatch:
    """Windows with a round spot each, which is the target, its nose in its middle."""
    generator = np.random.default_rng(5)
    places = generator.uniform((45.0, 30.0), (82.0, 65.0), (COUNT, 2)).astype(np.float32)
    v, u = np.mgrid[0:96, 0:128]
    spots = np.exp(-0.5 * ((u - places[:, 0, None, None]) ** 2 + (v - places[:, 1, None, None]) ** 2) / 4.0**2)
    levels = np.rint(255.0 * spots).astype(np.uint8)
    return WindowBatch(
        windows=torch.from_numpy(np.repeat(levels[:, None], 3, axis=1)),
        shares=torch.from_numpy(np.stack([levels, np.zeros_like(levels)], axis=1)),
        noses=torch.from_numpy(places),
        kinds=tuple((str(k),) for k in range(COUNT)),
    )


def test_truth_goes_with_the_window() -> None:
    batch = _spots().on(torch.device("cpu"))
    shown = moved(batch, torch.Generator().manual_seed(3))
    weights = shown.shares[:, 0]
    v, u = torch.meshgrid(torch.arange(96.0), torch.arange(128.0), indexing="ij")
    centres = torch.stack([(weights * k).sum((1, 2)) / weights.sum((1, 2)) for k in (u, v)], dim=1)
    assert torch.allclose(centres, shown.noses, atol=0.05)
    assert torch.allclose(shown.windows[:, 1] / 255.0, weights, atol=1e-5)
    # some are only mirrored or the same, to the level; the others are at other places
    off = (shown.noses - batch.noses).abs().max(dim=1).values
    mirrored = (
        (shown.noses - torch.stack([127.0 - batch.noses[:, 0], batch.noses[:, 1]], dim=1)).abs().max(dim=1).values
    )
    same, turned = off < 1e-3, mirrored < 1e-3
    assert 0.1 < float(same.float().mean()) < 0.4
    assert 0.1 < float(turned.float().mean()) < 0.4
    assert torch.allclose(shown.windows[turned], batch.windows[turned].flip(-1), atol=0.02)


def test_a_nose_that_leaves_the_window_is_none() -> None:
    batch = _spots().on(torch.device("cpu"))
    edge = replace(batch, noses=torch.full((COUNT, 2), 0.0))
    shown = moved(edge, torch.Generator().manual_seed(3))
    inside = torch.isfinite(shown.noses).all(dim=1)
    assert 0 < int(inside.sum()) < COUNT
    assert bool((shown.noses[inside] > -0.5).all())


def test_the_oldest_batch_makes_room() -> None:
    buffer = EchoBuffer(1, 2, torch.device("cpu"))
    spots = _spots()
    for number in range(5):
        buffer.add(number, replace(spots, kinds=tuple((f"batch {number}",) for _ in range(COUNT))))
    shown = buffer.draw(0)
    assert {kind for kinds in shown.kinds for kind in kinds} == {"batch 3", "batch 4"}
    again = buffer.draw(0)
    assert torch.equal(shown.windows, again.windows)
    assert not torch.equal(shown.windows, buffer.draw(1).windows)
    assert float(shown.windows.min()) >= 0.0
    assert float(shown.windows.max()) <= 255.0


def test_an_echoed_run_that_was_interrupted_ends_as_one_that_was_not(tmp_path: Path) -> None:
    targets = tuple(filmed_targets(draw_world(11), 3, np.random.default_rng(7)))
    material = Material(aircraft=(), birds=(), backgrounds=(), filmed=targets)

    class StoppedError(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 5:
            raise StoppedError

    with pytest.raises(StoppedError):
        fit(material, (), SETTINGS, tmp_path / "one", stop)
    resumed, whole = (fit(material, (), SETTINGS, tmp_path / name).network for name in ("one", "two"))
    pairs = zip(resumed.state_dict().values(), whole.state_dict().values(), strict=True)
    assert all(bool(torch.equal(one, other)) for one, other in pairs)
    assert (tmp_path / "one" / "log.csv").read_text() == (tmp_path / "two" / "log.csv").read_text()
