"""Fitting the network: steps that depend on seed and number alone, a log, and checkpoints from which a run goes on."""

import csv
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from training.hard_examples import draw_shares
from training.losses import WindowBatch, loss_of
from training.material import Material
from training.network import ChannelNetwork
from training.recorded_windows import RecordedTarget, recorded_window
from training.windows import LabelledWindow, WindowDrawer

CHECKPOINT, LOG = "checkpoint.pt", "log.csv"
_COLUMNS = ("step", "windows", "loss", "classes", "nose", "rate")
_WARM_STEPS = 100
_WINDOW_STREAM = 607


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """How long and how fast.

    Attributes
    ----------
    seed : of weights and windows.
    steps : of ``batch`` windows each.
    rate : largest learning rate; it falls to zero as a half cosine.
    recorded_share, picture_share, filmed_share : of the windows, those of recordings, of labelled pictures and of
        worlds as filmed, where there are such; the rest are drawn.
    hard : whether filmed targets are drawn more often on which the first weights err; needs ``start``.
    every : steps between lines of the log and checkpoints.
    """

    seed: int = 1
    steps: int = 4000
    batch: int = 64
    rate: float = 3e-3
    recorded_share: float = 0.1
    picture_share: float = 0.25
    filmed_share: float = 0.5
    hard: bool = False
    every: int = 50


@dataclass(frozen=True, slots=True, eq=False)
class _Source:
    """Targets, their share of all windows, and where (n,) from 0 to 1 the part of each ends; None is uniform."""

    targets: Sequence[RecordedTarget]
    share: float
    ends: FloatArray | None = None

    def draw(self, generator: np.random.Generator) -> RecordedTarget:
        if self.ends is None:
            return self.targets[int(generator.integers(len(self.targets)))]
        number = int(np.searchsorted(self.ends, float(generator.uniform()), side="right"))
        return self.targets[min(number, len(self.targets) - 1)]


@dataclass(slots=True)
class _Run:
    network: ChannelNetwork
    optimizer: torch.optim.Optimizer
    inputs: str
    step: int = 0
    rows: list[list[Any]] = field(default_factory=list)


def fit(
    material: Material,
    recorded: Sequence[RecordedTarget],
    settings: FitSettings,
    folder: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    pictures: Sequence[RecordedTarget] = (),
    start: ChannelNetwork | None = None,
) -> ChannelNetwork:
    """Train, or go on with what a folder's checkpoint holds; the same on one machine, interrupted or not.

    ``pictures`` are one's own, ``start`` has the weights to begin with, for fine-tuning. Raises `InputError` for a
    checkpoint of other settings, recordings, pictures, filmed targets or first weights, and for ``hard`` without
    first weights.
    """
    if settings.hard and start is None:
        raise InputError(
            "hard examples", got="no first weights", wanted="weights to begin with, which show what is hard"
        )
    torch.manual_seed(settings.seed)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = ChannelNetwork() if start is None else start
    inputs = _digest(start, recorded, pictures, filmed=material.filmed)
    network.to(device=device, memory_format=torch.channels_last)
    ends = np.cumsum(draw_shares(network, material.filmed)) if settings.hard else None
    run = _Run(network, torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-4), inputs)
    folder.mkdir(parents=True, exist_ok=True)
    _resume(run, settings, folder, device)
    drawer = WindowDrawer(material.aircraft, material.birds, material.backgrounds)
    sources = (
        _Source(recorded, settings.recorded_share),
        _Source(pictures, settings.picture_share),
        _Source(material.filmed, settings.filmed_share, ends),
    )
    parts: list[dict[str, float]] = []
    network.train()
    while run.step < settings.steps:
        rate = _rate(run.step, settings)
        for group in run.optimizer.param_groups:
            group["lr"] = rate
        batch = batch_of([_window(drawer, sources, settings, run.step, k) for k in range(settings.batch)], device)
        loss, terms = loss_of(network(batch.windows), batch)
        run.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        run.optimizer.step()
        run.step += 1
        parts.append({"loss": float(loss.detach()), **terms})
        if run.step % settings.every == 0 or run.step == settings.steps:
            means = {name: float(np.mean([p[name] for p in parts])) for name in ("loss", "classes", "nose")}
            run.rows.append([run.step, run.step * settings.batch, *(f"{v:.5g}" for v in means.values()), f"{rate:.3g}"])
            parts.clear()
            _keep(run, settings, folder)
            progress(run.step, settings.steps)
    return network


def batch_of(windows: Sequence[LabelledWindow], device: torch.device) -> WindowBatch:
    """Return windows as a batch on a device."""
    images = torch.from_numpy(np.stack([w.image for w in windows])).permute(0, 3, 1, 2)
    shares = torch.from_numpy(np.stack([np.stack([w.aircraft, w.other]) for w in windows]))
    noses = torch.from_numpy(np.stack([w.nose_px for w in windows]).astype(np.float32))
    like = {"device": device, "memory_format": torch.channels_last}
    return WindowBatch(windows=images.float().to(**like), shares=shares.to(device), noses=noses.to(device))


def _window(
    drawer: WindowDrawer,
    sources: Sequence[_Source],
    settings: FitSettings,
    step: int,
    number: int,
) -> LabelledWindow:
    generator = np.random.default_rng([settings.seed, _WINDOW_STREAM, step, number])
    draw = float(generator.uniform())
    for source in sources:
        if not source.targets:
            continue
        if draw < source.share:
            return recorded_window(source.draw(generator), generator)
        draw -= source.share
    return drawer.draw(generator)


def _rate(step: int, settings: FitSettings) -> float:
    warm = min((step + 1) / _WARM_STEPS, 1.0)
    return settings.rate * warm * 0.5 * (1.0 + math.cos(math.pi * step / settings.steps))


def _keep(run: _Run, settings: FitSettings, folder: Path) -> None:
    state = {
        "settings": repr(settings),
        "inputs": run.inputs,
        "step": run.step,
        "network": run.network.state_dict(),
        "optimizer": run.optimizer.state_dict(),
        "rows": run.rows,
    }
    part = folder / f"{CHECKPOINT}.part"
    torch.save(state, part)
    part.replace(folder / CHECKPOINT)
    with (folder / LOG).open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([_COLUMNS, *run.rows])


def _resume(run: _Run, settings: FitSettings, folder: Path, device: torch.device) -> None:
    path = folder / CHECKPOINT
    if not path.exists():
        return
    state = torch.load(path, map_location=device, weights_only=True)
    if state["settings"] != repr(settings):
        raise InputError(str(path), got=f"a run of {state['settings']}", wanted=f"{settings}, or an empty folder")
    if state["inputs"] != run.inputs:
        got = "a run with other recordings, pictures, filmed targets or first weights"
        wanted = "an empty folder for this one"
        raise InputError(str(path), got=got, wanted=wanted)
    run.network.load_state_dict(state["network"])
    run.optimizer.load_state_dict(state["optimizer"])
    run.step, run.rows = state["step"], state["rows"]


def _digest(
    start: ChannelNetwork | None, *targets: Sequence[RecordedTarget], filmed: Sequence[RecordedTarget] = ()
) -> str:
    """Return a hash of the first weights, of what recordings and pictures show, and of where filmed targets are."""
    found = hashlib.sha256()
    for name, value in () if start is None else start.state_dict().items():
        found.update(name.encode())
        found.update(value.cpu().numpy().tobytes())
    for group in targets:
        found.update(len(group).to_bytes(8, "little"))
        for target in group:
            found.update(target.image.tobytes())
            found.update(target.cover.tobytes())
            found.update(np.array([*target.middle_px, target.width_px, *target.nose_px]).tobytes())
    for target in filmed:
        found.update(np.array([*target.middle_px, target.width_px, *target.nose_px]).tobytes())
    return found.hexdigest()
