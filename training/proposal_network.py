"""The proposal network, fully convolutional, and its ONNX file."""

import hashlib
from pathlib import Path

import torch
from torch import Tensor, nn

from groundstation.detection.proposal_finder import OUTPUTS
from training.export import load_parameters

# channels after 4, 8 and 16 px, and before the last layer; multiples of eight, which ONNX Runtime computes in blocks
_STEM, _EIGHTH, _SIXTEENTH, _MIXED = 16, 32, 64, 32
# middles are in one of some thousand cells
_FIRST_ODDS = -4.0


class _Convolution(nn.Module):
    """A convolution with normalisation; with a way around it where it ``keeps`` the size."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1, *, keeps: bool = False) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.norm = nn.BatchNorm2d(outputs)
        self.keeps = keeps

    def forward(self, x: Tensor) -> Tensor:
        y = self.norm(self.convolution(x))
        return torch.relu(y + x) if self.keeps else torch.relu(y)


class ProposalNetwork(nn.Module):
    """Planes (n, 3, h, w), h and w multiples of 16, to maps (n, 5, h / 8, w / 8).

    The maps are the logits of an aircraft's and of another flying thing's middle, the binary logarithm of its width
    over 14 px, and where in the cell it is, x and y from the cell's middle in cells.
    """

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(nn.Conv2d(3, _STEM, 6, 4, 1, bias=False), nn.BatchNorm2d(_STEM), nn.ReLU())
        self.eighth = _Convolution(_STEM, _EIGHTH, 2)
        self.sixteenth = nn.Sequential(
            _Convolution(_EIGHTH, _SIXTEENTH, 2),
            _Convolution(_SIXTEENTH, _SIXTEENTH, keeps=True),
            _Convolution(_SIXTEENTH, _SIXTEENTH, keeps=True),
        )
        self.narrow = nn.Conv2d(_SIXTEENTH, _EIGHTH, 1, bias=False)
        self.mixed = _Convolution(_EIGHTH, _MIXED)
        self.head = nn.Conv2d(_MIXED, OUTPUTS, 1)
        if self.head.bias is not None:
            nn.init.constant_(self.head.bias[:2], _FIRST_ODDS)

    def forward(self, planes: Tensor) -> Tensor:
        """Return the maps."""
        eighth = self.eighth(self.stem(planes))
        wide = nn.functional.interpolate(self.narrow(self.sixteenth(eighth)), scale_factor=2, mode="nearest")
        maps: Tensor = self.head(self.mixed(torch.relu(eighth + wide)))
        return maps


def export_proposals(network: ProposalNetwork, path: Path) -> str:
    """Write the network for pictures of any size; returns the file's SHA-256. `load_proposals` reads it back."""
    network = network.to("cpu", memory_format=torch.contiguous_format).eval()
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.onnx.export(
        network,
        (torch.zeros(1, 3, 64, 96),),
        str(path),
        input_names=["planes"],
        output_names=["maps"],
        dynamic_axes={"planes": {2: "height", 3: "width"}, "maps": {2: "rows", 3: "columns"}},
        opset_version=17,
        dynamo=False,
        training=torch.onnx.TrainingMode.PRESERVE,
        do_constant_folding=False,
    )
    return hashlib.sha256(path.read_bytes()).hexdigest()


def load_proposals(path: Path) -> ProposalNetwork:
    """Read a network that `export_proposals` wrote. Raises `InputError` for any other file."""
    network = ProposalNetwork()
    load_parameters(network, path, "weights of the proposal network")
    return network
