"""The network: a small U-Net from a window to the classes of its pixels and a map of where the nose is."""

import torch
from torch import Tensor, nn

CLASSES = 3  # neither, aircraft, other flying things
OUTPUTS = CLASSES + 1  # and the nose
# multiples of eight, which ONNX Runtime computes in blocks
_STEM, _HALF, _QUARTER = 16, 16, 32
EIGHTH, SIXTEENTH = 56, 80
_SUBPIXELS = 2


class _Block(nn.Module):
    """A convolution, and at low resolution, where it costs little, a second one with a way around both."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1, *, deep: bool = False) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.first_norm = nn.BatchNorm2d(outputs)
        self.second = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False) if deep else None
        self.second_norm = nn.BatchNorm2d(outputs) if deep else None

    def forward(self, x: Tensor) -> Tensor:
        y = torch.relu(self.first_norm(self.first(x)))
        return (
            y if self.second is None or self.second_norm is None else torch.relu(self.second_norm(self.second(y)) + y)
        )


class ChannelNetwork(nn.Module):
    """Window (n, 3, 96, 128), levels BGR 0 to 255, to maps (n, 4, 96, 128).

    The first three are the logits of neither, aircraft, other; the last is the logarithm, up to a constant, of the
    probability that the nose is at the pixel. The mean of a window and its contrast are taken out first, so that
    exposure does not matter; a constant window stays zero.

    Parameters
    ----------
    eighth, sixteenth : channels at an eighth and a sixteenth of the resolution.
    """

    def __init__(self, eighth: int = EIGHTH, sixteenth: int = SIXTEENTH) -> None:
        super().__init__()
        self.eighth, self.sixteenth = eighth, sixteenth
        self.stem = nn.Sequential(nn.Conv2d(3, _STEM, 5, 2, 2, bias=False), nn.BatchNorm2d(_STEM), nn.ReLU())
        self.at_half = _Block(_STEM, _HALF)
        self.at_quarter = _Block(_HALF, _QUARTER, 2)
        self.at_eighth = nn.Sequential(_Block(_QUARTER, eighth, 2, deep=True), _Block(eighth, eighth, deep=True))
        self.at_sixteenth = nn.Sequential(
            _Block(eighth, sixteenth, 2, deep=True), _Block(sixteenth, sixteenth, deep=True)
        )
        self.to_eighth = _Block(sixteenth + eighth, eighth, deep=True)
        # at the larger sizes sums instead of concatenations, which would double the cost of the next convolution
        self.narrow = nn.Conv2d(eighth, _QUARTER, 1, bias=False)
        self.to_quarter = _Block(_QUARTER, _HALF)
        self.to_half = _Block(_HALF, _HALF)
        self.head = nn.Conv2d(_HALF, OUTPUTS * _SUBPIXELS**2, 1)

    def forward(self, window: Tensor) -> Tensor:
        """Return the maps (n, 4, 96, 128) of windows (n, 3, 96, 128)."""
        mean = window.mean(dim=(1, 2, 3), keepdim=True)
        contrast = torch.sqrt(((window - mean) ** 2).mean(dim=(1, 2, 3), keepdim=True) + _LEAST_CONTRAST**2)
        x = self.stem((window - mean) / contrast)
        half = self.at_half(x)
        quarter = self.at_quarter(half)
        eighth = self.at_eighth(quarter)
        up = _doubled(self.at_sixteenth(eighth))
        up = _doubled(self.narrow(self.to_eighth(torch.cat([up, eighth], dim=1))))
        up = _doubled(self.to_quarter(up + quarter))
        return nn.functional.pixel_shuffle(self.head(self.to_half(up + half)), _SUBPIXELS)


# levels: below, a window's contrast is its noise
_LEAST_CONTRAST = 6.0


def _doubled(x: Tensor) -> Tensor:
    return nn.functional.interpolate(x, scale_factor=2, mode="nearest")


def parameters_of(network: nn.Module) -> int:
    """Return the number of trained values."""
    return sum(p.numel() for p in network.parameters())
