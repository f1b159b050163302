"""The windows of each step: drawn by this process, or by several ahead of it; the same either way."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from groundstation.arrays import FloatArray
from training.losses import WindowBatch
from training.recorded_windows import RecordedTarget, recorded_window
from training.windows import LabelledWindow, WindowDrawer

_STREAM = 607
_AHEAD = 4


@dataclass(frozen=True, slots=True, eq=False)
class WindowSource:
    """Targets, their share of all windows, and where (n,) from 0 to 1 the part of each ends; None is uniform."""

    targets: Sequence[RecordedTarget]
    share: float
    ends: FloatArray | None = None

    def draw(self, generator: np.random.Generator) -> RecordedTarget:
        """Draw one of the targets."""
        if self.ends is None:
            return self.targets[int(generator.integers(len(self.targets)))]
        number = int(np.searchsorted(self.ends, float(generator.uniform()), side="right"))
        return self.targets[min(number, len(self.targets) - 1)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowStream:
    """What the windows of a run are drawn from; each depends on seed, step and its number in the step alone.

    Attributes
    ----------
    drawer : draws the windows that no source's share takes.
    sources : of recordings, pictures and worlds as filmed; one without targets gives its share to the drawer.
    seed, batch : of the run, and windows a step.
    """

    drawer: WindowDrawer
    sources: tuple[WindowSource, ...]
    seed: int
    batch: int

    def windows(self, step: int) -> list[LabelledWindow]:
        """Draw the windows of a step."""
        return [self._window(step, number) for number in range(self.batch)]

    def batches(self, first: int, last: int, workers: int) -> Iterator[WindowBatch]:
        """Yield the batches of steps from ``first`` to before ``last``, drawn by so many processes; 0 for this one."""
        steps: DataLoader[WindowBatch] = DataLoader(
            _StepBatches(self, first, last),
            batch_size=None,
            num_workers=workers,
            prefetch_factor=_AHEAD if workers else None,
            multiprocessing_context="fork" if workers else None,
        )
        return iter(steps)

    def _window(self, step: int, number: int) -> LabelledWindow:
        generator = np.random.default_rng([self.seed, _STREAM, step, number])
        draw = float(generator.uniform())
        for source in self.sources:
            if not source.targets:
                continue
            if draw < source.share:
                return recorded_window(source.draw(generator), generator)
            draw -= source.share
        return self.drawer.draw(generator)


class _StepBatches(Dataset[WindowBatch]):
    """The batches of some steps, by their place among these."""

    def __init__(self, stream: WindowStream, first: int, last: int) -> None:
        self._stream, self._first, self._last = stream, first, last

    def __len__(self) -> int:
        return self._last - self._first

    def __getitem__(self, place: int) -> WindowBatch:
        return batch_of(self._stream.windows(self._first + place))


def batch_of(windows: Sequence[LabelledWindow]) -> WindowBatch:
    """Return windows as a batch; shares are kept to a level of 255."""
    shares = np.stack([np.stack([w.aircraft, w.other]) for w in windows])
    return WindowBatch(
        windows=torch.from_numpy(np.ascontiguousarray(np.stack([w.image for w in windows]).transpose(0, 3, 1, 2))),
        shares=torch.from_numpy(np.rint(255.0 * shares).astype(np.uint8)),
        noses=torch.from_numpy(np.stack([w.nose_px for w in windows]).astype(np.float32)),
        kinds=tuple(w.kinds for w in windows),
    )
