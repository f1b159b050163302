"""Hard examples: how often each filmed target is drawn, by how badly a network does on it.

A network that has seen most targets right learns little from them. Half of the draws stay uniform: what is hard may be
labelled wrongly, and what is easy must not be forgotten.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from groundstation.arrays import FloatArray
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from training.network import CLASSES, ChannelNetwork
from training.recorded_windows import RecordedTarget, target_window

_UNIFORM_SHARE = 0.5
# errors beyond this quantile count as equal: among the largest are wrong labels
_LARGEST = 0.98
# px of a window next to a silhouette that are neither in it nor out of it
_MARGIN_PX = 5


def draw_shares(network: ChannelNetwork, targets: Sequence[RecordedTarget]) -> FloatArray:
    """Return how often each of n targets is drawn, (n,), sum 1, by the error of a network on its centred window.

    The error is the cross entropy of two statements: that the likeliest pixel of the silhouette is aircraft, and that
    the likeliest one elsewhere is not.
    """
    if not targets:
        return np.zeros(0)
    network.eval()
    device = next(network.parameters()).device
    with torch.no_grad():
        errors = [_error(network, target, device) for target in targets]
    network.train()
    limited = np.minimum(errors, np.quantile(errors, _LARGEST)) + 1e-9
    return np.asarray(_UNIFORM_SHARE / len(targets) + (1.0 - _UNIFORM_SHARE) * limited / limited.sum())


def _error(network: ChannelNetwork, target: RecordedTarget, device: torch.device) -> float:
    """Return the error on the window that the filter's prediction would place and scale at best."""
    window = target_window(target, TARGET_PX, np.array(WINDOW_PX) / 2.0 - 0.5)
    logits = network(torch.from_numpy(window.image.transpose(2, 0, 1)[None].astype(np.float32)).to(device))[0, :CLASSES]
    odds = logits[1] - torch.logaddexp(logits[0], logits[2])
    cover = torch.from_numpy(window.aircraft).to(device)
    near = nn.functional.max_pool2d(cover[None, None], 2 * _MARGIN_PX + 1, 1, _MARGIN_PX)[0, 0]
    return _entropy(-odds, cover > 0.5, largest=False) + _entropy(odds, near == 0.0, largest=True)


def _entropy(wrong_odds: Tensor, where: Tensor, *, largest: bool) -> float:
    """Return -log of the probability that is right at the pixel of a region with the largest or least wrong odds."""
    if not bool(where.any()):
        return 0.0
    chosen = wrong_odds[where]
    return float(nn.functional.softplus(chosen.max() if largest else chosen.min()))
