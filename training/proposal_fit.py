"""Fitting the proposal network: steps that depend on seed and number alone, a log, a checkpoint to go on from."""

import csv
import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from groundstation.errors import InputError
from training.filmed_pictures import FilmedPicture
from training.fit import CHECKPOINT, LOG, fitting_device
from training.proposal_crops import LabelledCrop, crops_of
from training.proposal_network import ProposalNetwork

_STREAM = 613
_COLUMNS = ("step", "crops", "loss", "marks", "places", "rate")
_WARM_STEPS, _AHEAD = 100, 4
# of the loss: a bird's middle counts less than an aircraft's, which are fewer; and place and width against both
_BIRD_WEIGHT, _PLACE_WEIGHT = 0.4, 0.5
# exponents of the focal loss, as CenterNet (Zhou et al. 2019) has them
_FOCAL, _AROUND_MARK = 2, 4
_LEAST_MARKS = 4.0
CropBatch = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalSettings:
    """How long and how fast.

    Attributes
    ----------
    seed : of weights and crops.
    steps : of ``batch`` crops each, ``crops`` of each picture.
    rate : largest learning rate; it falls to zero as a half cosine.
    clip_share : of the pictures, those of real clips, where there are such.
    every : steps between lines of the log and checkpoints.
    """

    seed: int = 1
    steps: int = 8000
    batch: int = 64
    crops: int = 8
    rate: float = 3e-3
    clip_share: float = 0.12
    every: int = 100

    def __post_init__(self) -> None:
        if self.batch < self.crops or self.batch % self.crops:
            raise InputError("batch", got=f"{self.batch} crops", wanted=f"a multiple of {self.crops}")


class _StepCrops(Dataset[CropBatch]):
    """The crops of some steps, by their place among these."""

    def __init__(
        self, pictures: Sequence[FilmedPicture], clips: Sequence[FilmedPicture], settings: ProposalSettings, first: int
    ) -> None:
        self._pictures, self._clips, self._settings, self._first = pictures, clips, settings, first

    def __len__(self) -> int:
        return self._settings.steps - self._first

    def __getitem__(self, place: int) -> CropBatch:
        settings = self._settings
        crops: list[LabelledCrop] = []
        for number in range(settings.batch // settings.crops):
            generator = np.random.default_rng([settings.seed, _STREAM, self._first + place, number])
            real = bool(self._clips) and float(generator.uniform()) < settings.clip_share
            pool = self._clips if real or not self._pictures else self._pictures
            crops += crops_of(pool[int(generator.integers(len(pool)))], settings.crops, generator)
        planes, marks, counts, places, near = (
            torch.from_numpy(np.stack([getattr(crop, name) for crop in crops]))
            for name in ("planes", "marks", "counts", "places", "near")
        )
        return planes, marks, counts, places, near


def crop_batches(
    pictures: Sequence[FilmedPicture],
    clips: Sequence[FilmedPicture],
    settings: ProposalSettings,
    first: int,
    workers: int,
) -> Iterator[CropBatch]:
    """Yield the crops of the steps from ``first`` on, drawn by so many processes; 0 for this one."""
    loader: DataLoader[CropBatch] = DataLoader(
        _StepCrops(pictures, clips, settings, first),
        batch_size=None,
        num_workers=workers,
        prefetch_factor=_AHEAD if workers else None,
        multiprocessing_context="fork" if workers else None,
    )
    return iter(loader)


def proposal_loss(maps: Tensor, batch: CropBatch) -> tuple[Tensor, Tensor, Tensor]:
    """Return the loss of maps (n, 5, 32, 32), and its parts of marks and of places."""
    _, marks, counts, places, near = batch
    share = torch.sigmoid(maps[:, :2]).clamp(1e-5, 1.0 - 1e-5)
    middle = (marks == 1.0).to(maps.dtype) * counts
    weights = torch.tensor([1.0, _BIRD_WEIGHT], device=maps.device)[None, :, None, None]
    there = middle * (1.0 - share) ** _FOCAL * torch.log(share) * weights
    empty = (1.0 - middle) * counts * (1.0 - marks) ** _AROUND_MARK * share**_FOCAL * torch.log(1.0 - share)
    of_marks = -(there + empty).sum() / (middle[:, 0].sum() + _LEAST_MARKS)
    of_places = ((maps[:, 2:] - places).abs() * near[:, None]).sum() / (near.sum() + 1.0)
    return of_marks + _PLACE_WEIGHT * of_places, of_marks.detach(), of_places.detach()


def fit_proposals(
    pictures: Sequence[FilmedPicture],
    clips: Sequence[FilmedPicture],
    settings: ProposalSettings,
    folder: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    start: ProposalNetwork | None = None,
    workers: int = 0,
) -> ProposalNetwork:
    """Train, or go on with what a folder's checkpoint holds; the same on one machine, interrupted or not.

    ``start`` has the weights to begin with. Raises `InputError` for a checkpoint of other settings, pictures or first
    weights, and without pictures.
    """
    if not pictures and not clips:
        raise InputError("pictures", got="none", wanted="some to learn from")
    device = fitting_device()
    torch.manual_seed(settings.seed)
    network = (ProposalNetwork() if start is None else start).to(device=device, memory_format=torch.channels_last)
    network.train()
    optimizer = torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-4)
    inputs = _digest(network, [*pictures, *clips])
    folder.mkdir(parents=True, exist_ok=True)
    first, rows = _resumed(network, optimizer, inputs, settings, folder, device)
    parts: list[tuple[Tensor, ...]] = []
    for step, drawn in enumerate(crop_batches(pictures, clips, settings, first, workers), first):
        planes, *labels = (each.to(device, non_blocking=True) for each in drawn)
        batch = (planes, *labels)
        rate = settings.rate * min((step + 1) / _WARM_STEPS, 1.0) * _half_cosine(step / settings.steps)
        for group in optimizer.param_groups:
            group["lr"] = rate
        loss, *terms = proposal_loss(network(planes.contiguous(memory_format=torch.channels_last)), batch)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        parts.append((loss.detach(), *terms))
        done = step + 1
        if done % settings.every == 0 or done == settings.steps:
            means = torch.tensor([[float(term) for term in each] for each in parts]).mean(dim=0)
            rows.append([done, done * settings.batch, *(f"{float(m):.5g}" for m in means), f"{rate:.3g}"])
            parts.clear()
            _keep(network, optimizer, inputs, settings, folder, done, rows)
            progress(done, settings.steps)
    return network


def _half_cosine(share: float) -> float:
    return 0.5 * (1.0 + math.cos(math.pi * share))


def _digest(network: ProposalNetwork, pictures: Sequence[FilmedPicture]) -> str:
    """Return a hash of the first weights and of the pictures."""
    found = hashlib.sha256()
    for value in network.state_dict().values():
        found.update(value.cpu().numpy().tobytes())
    for picture in pictures:
        found.update(picture.jpeg)
        found.update(picture.aircraft.tobytes() + picture.birds.tobytes() + picture.unclear.tobytes())
    return found.hexdigest()


def _keep(
    network: ProposalNetwork,
    optimizer: torch.optim.Optimizer,
    inputs: str,
    settings: ProposalSettings,
    folder: Path,
    step: int,
    rows: list[list[Any]],
) -> None:
    state = {
        "settings": repr(settings),
        "inputs": inputs,
        "step": step,
        "network": network.state_dict(),
        "optimizer": optimizer.state_dict(),
        "rows": rows,
    }
    part = folder / f"{CHECKPOINT}.part"
    torch.save(state, part)
    part.replace(folder / CHECKPOINT)
    with (folder / LOG).open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([_COLUMNS, *rows])


def _resumed(
    network: ProposalNetwork,
    optimizer: torch.optim.Optimizer,
    inputs: str,
    settings: ProposalSettings,
    folder: Path,
    device: torch.device,
) -> tuple[int, list[list[Any]]]:
    """Load a folder's checkpoint, if there is one; return the step to go on with, and the log's rows so far."""
    path = folder / CHECKPOINT
    if not path.exists():
        return 0, []
    state = torch.load(path, map_location=device, weights_only=True)
    if state["settings"] != repr(settings):
        raise InputError(str(path), got=f"a run of {state['settings']}", wanted=f"{settings}, or an empty folder")
    if state["inputs"] != inputs:
        wanted = "an empty folder for these"
        raise InputError(str(path), got="a run with other pictures or first weights", wanted=wanted)
    network.load_state_dict(state["network"])
    optimizer.load_state_dict(state["optimizer"])
    return int(state["step"]), list(state["rows"])
