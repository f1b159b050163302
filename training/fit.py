"""Fitting the network: steps that depend on seed and number alone, a log, and checkpoints from which a run goes on."""

import copy
import csv
import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from training.echo import EchoBuffer
from training.hard_examples import draw_shares
from training.losses import WindowBatch, loss_of
from training.material import Material
from training.network import ChannelNetwork
from training.recorded_windows import RecordedTarget
from training.window_stream import WindowSource, WindowStream
from training.windows import WindowDrawer

CHECKPOINT, LOG = "checkpoint.pt", "log.csv"
_COLUMNS = ("step", "windows", "loss", "classes", "nose", "rate")
_WARM_STEPS = 100


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
    echo : steps for each batch that is drawn: beyond one, a step learns from ``batch`` of the windows that were drawn
        last, changed.
    kept : so many of these are kept, rounded down to whole batches.
    hard : whether filmed targets are drawn more often on which the first weights err; needs ``start``.
    leave_out : kinds of airframe, scenery or sky; for each a further network is fitted on the windows without it.
    every : steps between lines of the log and checkpoints.
    """

    seed: int = 1
    steps: int = 4000
    batch: int = 64
    rate: float = 3e-3
    recorded_share: float = 0.1
    picture_share: float = 0.25
    filmed_share: float = 0.5
    echo: int = 1
    kept: int = 32768
    hard: bool = False
    leave_out: tuple[str, ...] = ()
    every: int = 50


class Trainee:
    """A network, and how it is fitted.

    Parameters
    ----------
    network : what is fitted, on the device where the batches are.
    settings : of the run.
    without : kinds whose windows it is not shown.
    """

    def __init__(self, network: ChannelNetwork, settings: FitSettings, without: frozenset[str] = frozenset()) -> None:
        self.network, self.without, self._settings = network, without, settings
        self.optimizer = torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-4)

    def step(self, number: int, batch: WindowBatch) -> dict[str, Tensor]:
        """Learn from the batch of a step, float32 on the network's device; returns the loss and its parts.

        Nothing is learned, and nothing returned, where each window shows a kind that is left out.
        """
        batch = batch.without(self.without)
        if not batch.kinds:
            return {}
        rate = rate_of(number, self._settings)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        device = batch.windows.device.type
        with torch.autocast(device, dtype=torch.bfloat16, enabled=device == "cuda"):
            maps = self.network(batch.windows)
        loss, terms = loss_of(maps.float(), batch)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimizer.step()
        return {"loss": loss.detach(), **terms}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted:
    """The network, and those that were not shown one kind, by its name."""

    network: ChannelNetwork
    without: dict[str, ChannelNetwork]


@dataclass(slots=True)
class _Run:
    trainees: list[Trainee]
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
    workers: int = 0,
) -> Fitted:
    """Train, or go on with what a folder's checkpoint holds; the same on one machine, interrupted or not.

    ``pictures`` are one's own, ``start`` has the weights to begin with, for fine-tuning; ``workers`` processes draw
    the windows, 0 for this one. Raises `InputError` for a checkpoint of other settings, recordings, pictures, filmed
    targets or first weights, and for ``hard`` without first weights.
    """
    if settings.hard and start is None:
        raise InputError(
            "hard examples", got="no first weights", wanted="weights to begin with, which show what is hard"
        )
    device = fitting_device()
    inputs = _digest(start, recorded, pictures, filmed=material.filmed)
    trainees = [_trainee(start, settings, device, without) for without in ((), *((k,) for k in settings.leave_out))]
    ends = np.cumsum(draw_shares(trainees[0].network, material.filmed)) if settings.hard else None
    run = _Run(trainees, inputs)
    folder.mkdir(parents=True, exist_ok=True)
    _resume(run, settings, folder, device)
    stream = window_stream(material, recorded, settings, pictures=pictures, filmed_ends=ends)
    parts: list[dict[str, Tensor]] = []
    for batch in _batches(stream, settings, run.step, device, workers):
        terms = [trainee.step(run.step, batch) for trainee in run.trainees]
        parts.append(terms[0])
        run.step += 1
        if run.step % settings.every == 0 or run.step == settings.steps:
            run.rows.append(
                [run.step, run.step * settings.batch, *means_of(parts), f"{rate_of(run.step - 1, settings):.3g}"]
            )
            parts.clear()
            _keep(run, settings, folder)
            progress(run.step, settings.steps)
    first, *others = (trainee.network for trainee in run.trainees)
    return Fitted(network=first, without=dict(zip(settings.leave_out, others, strict=True)))


def _batches(
    stream: WindowStream, settings: FitSettings, first: int, device: torch.device, workers: int
) -> Iterator[WindowBatch]:
    """Yield the batches of the steps from ``first`` on, on a device: as they are drawn, or echoed."""
    if settings.echo == 1:
        for batch in stream.batches(first, settings.steps, workers):
            yield batch.on(device)
        return
    batches = max(settings.kept // settings.batch, 1)
    buffer = EchoBuffer(settings.seed, batches, device)
    # what a run that was interrupted had kept is drawn again
    begin = max(first // settings.echo - batches + 1, 0)
    draws = math.ceil(settings.steps / settings.echo)
    for number, batch in enumerate(stream.batches(begin, draws, workers), begin):
        buffer.add(number, batch)
        for step in range(max(number * settings.echo, first), min((number + 1) * settings.echo, settings.steps)):
            yield buffer.draw(step)


def fitting_device() -> torch.device:
    """Return a GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def _trainee(
    start: ChannelNetwork | None, settings: FitSettings, device: torch.device, without: tuple[str, ...]
) -> Trainee:
    """Return a network to fit: a copy of ``start``, or random weights, the same for each."""
    torch.manual_seed(settings.seed)
    network = ChannelNetwork() if start is None else copy.deepcopy(start)
    network.to(device=device, memory_format=torch.channels_last)
    return Trainee(network.train(), settings, frozenset(without))


def window_stream(
    material: Material,
    recorded: Sequence[RecordedTarget],
    settings: FitSettings,
    *,
    pictures: Sequence[RecordedTarget] = (),
    filmed_ends: FloatArray | None = None,
) -> WindowStream:
    """Return the windows of a run; ``filmed_ends`` (n,) say how often each filmed target is drawn."""
    return WindowStream(
        drawer=WindowDrawer(material.aircraft, material.birds, material.backgrounds),
        sources=(
            WindowSource(recorded, settings.recorded_share),
            WindowSource(pictures, settings.picture_share),
            WindowSource(material.filmed, settings.filmed_share, filmed_ends),
        ),
        seed=settings.seed,
        batch=settings.batch,
    )


def means_of(parts: Sequence[dict[str, Tensor]]) -> list[str]:
    """Return the means of loss, classes and nose over some steps, as the log has them."""
    return [f"{float(torch.stack([p[name] for p in parts]).mean()):.5g}" for name in _COLUMNS[2:5]]


def rate_of(step: int, settings: FitSettings) -> float:
    """Return the learning rate of a step."""
    warm = min((step + 1) / _WARM_STEPS, 1.0)
    return settings.rate * warm * 0.5 * (1.0 + math.cos(math.pi * step / settings.steps))


def _keep(run: _Run, settings: FitSettings, folder: Path) -> None:
    state = {
        "settings": repr(settings),
        "inputs": run.inputs,
        "step": run.step,
        "networks": [trainee.network.state_dict() for trainee in run.trainees],
        "optimizers": [trainee.optimizer.state_dict() for trainee in run.trainees],
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
    for trainee, network, optimizer in zip(run.trainees, state["networks"], state["optimizers"], strict=True):
        trainee.network.load_state_dict(network)
        trainee.optimizer.load_state_dict(optimizer)
    run.step, run.rows = state["step"], state["rows"]


def _labels(target: RecordedTarget) -> bytes:
    """Return what is stated about a target's picture."""
    places = np.array([*target.middle_px, target.width_px, *target.nose_px])
    return b"".join((target.cover.tobytes(), target.other.tobytes(), places.tobytes(), " ".join(target.kinds).encode()))


def _digest(
    start: ChannelNetwork | None, *targets: Sequence[RecordedTarget], filmed: Sequence[RecordedTarget] = ()
) -> str:
    """Return a hash of the first weights, of what recordings and pictures show, and of filmed targets' labels."""
    found = hashlib.sha256()
    for name, value in () if start is None else start.state_dict().items():
        found.update(name.encode())
        found.update(value.cpu().numpy().tobytes())
    for group in targets:
        found.update(len(group).to_bytes(8, "little"))
        for target in group:
            found.update(target.image.tobytes())
            found.update(_labels(target))
    for target in filmed:
        found.update(_labels(target))
    return found.hexdigest()
