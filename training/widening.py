"""A network with more channels at low resolution that computes at first what a narrower one does.

Source: T. Chen, I. Goodfellow and J. Shlens, *Net2Net: accelerating learning via knowledge transfer*, 2016; here new
channels are random, and what reads them has zeros for them, instead of copies of old channels.
"""

import torch
from torch import Tensor

from training.network import EIGHTH, SIXTEENTH, ChannelNetwork

# reads the channels of both resolutions, those of the sixteenth first
_JOINT = "to_eighth.first.weight"


def widened(
    network: ChannelNetwork, eighth: int = EIGHTH, sixteenth: int = SIXTEENTH, *, seed: int = 1
) -> ChannelNetwork:
    """Return a network of at least so many channels at an eighth and a sixteenth of the resolution, with the same maps.

    Raises `ValueError` where that is fewer than there are.
    """
    if eighth < network.eighth or sixteenth < network.sixteenth:
        had, wanted = (network.eighth, network.sixteenth), (eighth, sixteenth)
        raise ValueError(f"a network of {had} channels is not widened to {wanted}")
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(seed)
        wide = ChannelNetwork(eighth, sixteenth)
    new, old = wide.state_dict(), network.state_dict()
    for name, value in old.items():
        target = new[name]
        if target.shape == value.shape:
            target.copy_(value)
        elif name == _JOINT:
            _lay_into(target[:, :sixteenth], value[:, : network.sixteenth])
            _lay_into(target[:, sixteenth:], value[:, network.sixteenth :])
        else:
            _lay_into(target, value)
    return wide


def _lay_into(target: Tensor, value: Tensor) -> None:
    """Copy the weights of the old channels; those from new channels to old ones become zero, all others stay random."""
    rows = value.shape[0]
    if value.dim() > 1:
        target[:rows] = 0.0
        target[:rows, : value.shape[1]] = value
    else:
        target[:rows] = value
