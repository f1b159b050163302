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
    """Windows (n, 3, 96, 128), shares of aircraft and other (n, 2, 96, 128), noses (n, 2) with NaN."""

    windows: Tensor
    shares: Tensor
    noses: Tensor


def loss_of(maps: Tensor, batch: WindowBatch) -> tuple[Tensor, dict[str, float]]:
    """Return the loss of a batch's maps, and its parts."""
    classes = _class_loss(maps[:, :CLASSES], batch.shares)
    nose = _nose_loss(maps[:, CLASSES], batch.noses)
    total = classes + _NOSE_WEIGHT * nose
    return total, {"classes": float(classes.detach()), "nose": float(nose.detach())}


def _class_loss(logits: Tensor, shares: Tensor) -> Tensor:
    log = torch.log_softmax(logits, dim=1)
    neither = (1.0 - shares.sum(dim=1)).clamp(0.0, 1.0)
    terms = neither * log[:, 0] + AIRCRAFT_WEIGHT * shares[:, 0] * log[:, 1] + OTHER_WEIGHT * shares[:, 1] * log[:, 2]
    return -terms.mean() * 10.0


def _nose_loss(logits: Tensor, noses: Tensor) -> Tensor:
    """Return the cross entropy of the map's softmax with a mark at the nose, over the windows that show one."""
    known = torch.isfinite(noses).all(dim=1)
    if not bool(known.any()):
        return logits.sum() * 0.0
    logits, noses = logits[known], noses[known]
    rows, columns = (torch.arange(n, dtype=logits.dtype, device=logits.device) for n in logits.shape[1:])
    v = torch.exp(-0.5 * ((rows[None] - noses[:, 1:]) / _NOSE_SIGMA_PX) ** 2)
    u = torch.exp(-0.5 * ((columns[None] - noses[:, :1]) / _NOSE_SIGMA_PX) ** 2)
    mark = v[:, :, None] * u[:, None, :]
    mark = mark / mark.sum(dim=(1, 2), keepdim=True)
    log = torch.log_softmax(logits.flatten(1), dim=1).view_as(logits)
    return -(mark * log).sum(dim=(1, 2)).mean()
