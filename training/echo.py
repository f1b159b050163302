"""Data echoing: drawn windows are kept on the device and shown again, at another place and size and in other light.

A core draws some 200 windows in the time in which a GPU learns from ten thousand. Source: D. Choi, A. Passos,
C. J. Shallue and G. E. Dahl, *Faster neural network training with data echoing*, 2019.
"""

import math

import torch
from torch import Tensor
from torch.nn import functional

from training.losses import WindowBatch

_STREAM = 613
# logarithm of the size, place in px, and turn of a window that is shown again, one sigma; at most so many sigmas
_SIZE_SIGMA, _PLACE_SIGMA_PX, _TURN_SIGMA_RAD, _MOST_SIGMAS = 0.1, 5.0, math.radians(3.0), 2.5
# of the windows that are resampled; that blurs a little, so the others stay as sharp as they were drawn
_MOVED_SHARE = 0.5
# exposure, black level in levels, and balance of colours; noise, in levels, of a drawn strength
_GAIN_SIGMA, _LIFT_SIGMA, _TINT_SIGMA, _NOISE_MEAN = 0.12, 6.0, 0.03, 0.8


class EchoBuffer:
    """The windows of the last batches, on a device.

    Parameters
    ----------
    seed : of the choice, and of what is changed.
    batches : kept at most.
    device : where they are kept, and shown.
    """

    def __init__(self, seed: int, batches: int, device: torch.device) -> None:
        self._seed, self._batches, self._device = seed, batches, device
        self._kinds: dict[int, tuple[tuple[str, ...], ...]] = {}
        self._windows, self._shares, self._noses = (torch.empty(0, device=device) for _ in range(3))

    def add(self, number: int, batch: WindowBatch) -> None:
        """Keep the batch of this number, levels of uint8, in the place of the one that was drawn so many before."""
        size = len(batch.kinds)
        if not self._kinds:
            self._windows, self._shares, self._noses = (
                torch.empty((self._batches * size, *like.shape[1:]), dtype=like.dtype, device=self._device)
                for like in (batch.windows, batch.shares, batch.noses)
            )
        slot = number % self._batches
        place = slice(slot * size, (slot + 1) * size)
        for kept, new in ((self._windows, batch.windows), (self._shares, batch.shares), (self._noses, batch.noses)):
            kept[place].copy_(new, non_blocking=True)
        self._kinds[slot] = batch.kinds

    def draw(self, step: int) -> WindowBatch:
        """Return a batch of windows, changed, float32 on the device; by seed, step and what is held alone."""
        generator = torch.Generator(self._device)
        generator.manual_seed((self._seed * 1_000_003 + step) * 1009 + _STREAM)
        slots = sorted(self._kinds)
        size = len(self._kinds[slots[0]])
        drawn = torch.randint(len(slots) * size, (size,), generator=generator, device=self._device)
        chosen = torch.tensor(slots, device=self._device)[drawn // size] * size + drawn % size
        picked = WindowBatch(
            windows=self._windows[chosen],
            shares=self._shares[chosen],
            noses=self._noses[chosen],
            kinds=tuple(self._kinds[k // size][k % size] for k in chosen.tolist()),
        )
        return _relit(moved(picked.on(self._device), generator), generator)


def moved(batch: WindowBatch, generator: torch.Generator) -> WindowBatch:
    """Return windows, half of them mirrored, some at another size, place and turn, with their truth.

    What is beyond a window's rim is its mirror image, as its truth is.
    """
    device, count = batch.windows.device, len(batch.noses)
    normal = torch.randn((count, 4), generator=generator, device=device).clamp(-_MOST_SIGMAS, _MOST_SIGMAS)
    chance = torch.rand((count, 2), generator=generator, device=device)
    normal = torch.where(chance[:, :1] < _MOVED_SHARE, normal, torch.zeros_like(normal))
    mirror = torch.where(chance[:, 1] < 0.5, -1.0, 1.0)
    turn, finer = _TURN_SIGMA_RAD * normal[:, 0], torch.exp(_SIZE_SIGMA * normal[:, 1])
    cosine, sine = torch.cos(turn), torch.sin(turn)
    # from a pixel of the new window, relative to its middle, to one of the old
    rotation = torch.stack([torch.stack([cosine, -sine], -1), torch.stack([sine, cosine], -1)], -2)
    matrix = finer[:, None, None] * rotation * torch.stack([mirror, torch.ones_like(mirror)], -1)[:, None, :]
    shift = _PLACE_SIGMA_PX * normal[:, 2:]
    height, width = batch.windows.shape[-2:]
    half = torch.tensor([width / 2.0, height / 2.0], device=device)
    # grid_sample's coordinates are 1 at the rim
    theta = torch.cat([matrix * half[None, None, :] / half[None, :, None], (shift / half)[:, :, None]], dim=2)
    planes = torch.cat([batch.windows, batch.shares], dim=1)
    grid = functional.affine_grid(theta, list(planes.shape), align_corners=False)
    planes = functional.grid_sample(planes, grid, mode="bilinear", padding_mode="reflection", align_corners=False)
    middle = half - 0.5
    noses = torch.linalg.solve(matrix, (batch.noses - middle - shift)[:, :, None])[:, :, 0] + middle
    inside = ((noses > -0.5) & (noses < 2.0 * half - 0.5)).all(dim=1, keepdim=True)
    return WindowBatch(
        windows=planes[:, :3].contiguous(memory_format=torch.channels_last),
        shares=planes[:, 3:].clamp(0.0, 1.0),
        noses=torch.where(inside, noses, torch.nan),
        kinds=batch.kinds,
    )


def _relit(batch: WindowBatch, generator: torch.Generator) -> WindowBatch:
    """Return windows of other exposure, black level and balance of colours, with noise."""
    device, count = batch.windows.device, len(batch.noses)
    normal = torch.randn((count, 5, 1, 1), generator=generator, device=device)
    gain = torch.exp(_GAIN_SIGMA * normal[:, :1] + _TINT_SIGMA * normal[:, 1:4])
    sigma = torch.empty((count, 1, 1, 1), device=device).exponential_(1.0 / _NOISE_MEAN, generator=generator)
    noise = sigma * _normal_like(batch.windows, generator)
    levels = gain * batch.windows + _LIFT_SIGMA * normal[:, 4:] + noise
    return WindowBatch(
        windows=levels.round().clamp(0.0, 255.0), shares=batch.shares, noses=batch.noses, kinds=batch.kinds
    )


def _normal_like(like: Tensor, generator: torch.Generator) -> Tensor:
    return torch.empty_like(like).normal_(generator=generator)
