"""Hard examples: how often each filmed target is drawn, by how badly a network does on it.

A network that has seen most targets right learns little from them. Half of the draws stay uniform: what is hard may be
labelled wrongly, and what is easy must not be forgotten.
"""

from collections.abc import Sequence

import numpy as np
import torch

from groundstation.arrays import FloatArray
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from training.losses import WindowBatch, loss_of
from training.network import ChannelNetwork
from training.recorded_windows import RecordedTarget, target_window

_UNIFORM_SHARE = 0.5
# losses beyond this quantile count as equal: among the largest are wrong labels
_LARGEST = 0.98


def draw_shares(network: ChannelNetwork, targets: Sequence[RecordedTarget]) -> FloatArray:
    """Return how often each of n targets is drawn, (n,), sum 1, by the loss of a network on its centred window."""
    if not targets:
        return np.zeros(0)
    network.eval()
    losses = []
    with torch.no_grad():
        for target in targets:
            batch = _centred(target, next(network.parameters()).device)
            losses.append(float(loss_of(network(batch.windows), batch)[0]))
    network.train()
    worst = np.minimum(losses, np.quantile(losses, _LARGEST)) + 1e-9
    return np.asarray(_UNIFORM_SHARE / len(targets) + (1.0 - _UNIFORM_SHARE) * worst / worst.sum())


def _centred(target: RecordedTarget, device: torch.device) -> WindowBatch:
    """Return the window of a target as the filter's prediction would place and scale it at best."""
    image, share, nose = target_window(target, TARGET_PX, np.array(WINDOW_PX) / 2.0 - 0.5)
    inside = bool(np.all(nose > -0.5) and nose[0] < WINDOW_PX[0] - 0.5 and nose[1] < WINDOW_PX[1] - 0.5)
    levels = torch.from_numpy(image.transpose(2, 0, 1)[None].astype(np.float32))
    shares = torch.from_numpy(np.stack([share, np.zeros_like(share)])[None])
    noses = torch.from_numpy((nose if inside else np.full(2, np.nan))[None].astype(np.float32))
    return WindowBatch(windows=levels.to(device), shares=shares.to(device), noses=noses.to(device))
