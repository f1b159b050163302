"""What is minimised: cross entropy of the classes, and of the nose's place."""

from dataclasses import dataclass

import torch
from torch import Tensor

from training.network import CLASSES

# a target covers some 3 % of a window; weighed so, it counts about as much as what surrounds it
AIRCRAFT_WEIGHT, OTHER_WEIGHT = 6.0, 4.0
_NOSE_WEIGHT = 0.1
# one sigma of the nose's mark, px: half a pixel of labelling, and the pixel itself
_NOSE_SIGMA_PX = 0.6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowBatch:
    """Windows with their truth.

    Attributes
    ----------
    windows : (n, 3, 96, 128) uint8 BGR; float32 once `on` a device.
    shares : (n, 2, 96, 128) uint8, of aircraft and other flying things, 255 for a whole pixel; then float32, 1.
    noses : (n, 2) float32 x, y; NaN where none is known.
    kinds : of airframe, scenery and sky that each shows.
    """

    windows: Tensor
    shares: Tensor
    noses: Tensor
    kinds: tuple[tuple[str, ...], ...]

    def without(self, kinds: frozenset[str]) -> "WindowBatch":
        """Return the windows that show none of these kinds."""
        if not kinds:
            return self
        kept = [k for k, shown in enumerate(self.kinds) if not kinds.intersection(shown)]
        return WindowBatch(
            windows=self.windows[kept],
            shares=self.shares[kept],
            noses=self.noses[kept],
            kinds=tuple(self.kinds[k] for k in kept),
        )

    def on(self, device: torch.device) -> "WindowBatch":
        """Return the batch on a device, windows and shares as float32."""
        windows = self.windows.to(device, non_blocking=True).float()
        return WindowBatch(
            windows=windows.contiguous(memory_format=torch.channels_last),
            shares=self.shares.to(device, non_blocking=True).float() / 255.0,
            noses=self.noses.to(device, non_blocking=True),
            kinds=self.kinds,
        )


def loss_of(maps: Tensor, batch: WindowBatch) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the loss of a batch's maps, and its parts."""
    classes = _class_loss(maps[:, :CLASSES], batch.shares)
    nose = _nose_loss(maps[:, CLASSES], batch.noses)
    return classes + _NOSE_WEIGHT * nose, {"classes": classes.detach(), "nose": nose.detach()}


def _class_loss(logits: Tensor, shares: Tensor) -> Tensor:
    log = torch.log_softmax(logits, dim=1)
    neither = (1.0 - shares.sum(dim=1)).clamp(0.0, 1.0)
    terms = neither * log[:, 0] + AIRCRAFT_WEIGHT * shares[:, 0] * log[:, 1] + OTHER_WEIGHT * shares[:, 1] * log[:, 2]
    return -terms.mean() * 10.0


def _nose_loss(logits: Tensor, noses: Tensor) -> Tensor:
    """Return the cross entropy of the map's softmax with a mark at the nose, over the windows that show one."""
    known = torch.isfinite(noses).all(dim=1)
    noses = torch.where(known[:, None], noses, 0.0)
    rows, columns = (torch.arange(n, dtype=logits.dtype, device=logits.device) for n in logits.shape[1:])
    v = torch.exp(-0.5 * ((rows[None] - noses[:, 1:]) / _NOSE_SIGMA_PX) ** 2)
    u = torch.exp(-0.5 * ((columns[None] - noses[:, :1]) / _NOSE_SIGMA_PX) ** 2)
    mark = v[:, :, None] * u[:, None, :]
    mark = mark / mark.sum(dim=(1, 2), keepdim=True)
    log = torch.log_softmax(logits.flatten(1), dim=1).view_as(logits)
    terms = -(mark * log).sum(dim=(1, 2))
    return (terms * known).sum() / known.sum().clamp(min=1)
