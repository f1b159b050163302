"""The network as ONNX: what the program runs, and what a further training begins with."""

import hashlib
from pathlib import Path

import onnx
import torch
from google.protobuf.message import DecodeError
from onnx import numpy_helper
from torch import Tensor, nn

from groundstation.detection.channel_window import WINDOW_PX
from groundstation.errors import InputError
from groundstation.files.channel_weights import read_weights
from training.network import EIGHTH, SIXTEENTH, ChannelNetwork
from training.widening import widened

_CHANNEL = "weights that `groundstation train` wrote"
# their lengths are the channels at these resolutions
_EIGHTH_NORM, _SIXTEENTH_NORM = "at_eighth.0.first_norm.bias", "at_sixteenth.0.first_norm.bias"


def export_onnx(network: ChannelNetwork, path: Path) -> str:
    """Write the network for one window at a time; returns the file's SHA-256.

    Batch normalisation is left as it is, and so are the names of the parameters, so that `load_onnx` reads the network
    back. ONNX Runtime merges it into the convolutions when it loads the file.
    """
    network = network.to("cpu", memory_format=torch.contiguous_format).eval()
    window = torch.full((1, 3, WINDOW_PX[1], WINDOW_PX[0]), 128.0)
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.onnx.export(
        network,
        (window,),
        str(path),
        input_names=["window"],
        output_names=["maps"],
        opset_version=17,
        dynamo=False,
        training=torch.onnx.TrainingMode.PRESERVE,
        do_constant_folding=False,
    )
    return hashlib.sha256(path.read_bytes()).hexdigest()


def load_onnx(path: Path) -> ChannelNetwork:
    """Read a network that `export_onnx` wrote; a narrower one is widened. Raises `InputError` for any other file."""
    found = _parameters(path, _CHANNEL)
    eighth, sixteenth = (
        found[name].shape[0] if name in found else least
        for name, least in ((_EIGHTH_NORM, EIGHTH), (_SIXTEENTH_NORM, SIXTEENTH))
    )
    network = ChannelNetwork(min(eighth, EIGHTH), min(sixteenth, SIXTEENTH))
    _take(network, found, path, _CHANNEL)
    return widened(network)


def load_parameters(network: nn.Module, path: Path, wanted: str) -> None:
    """Read an ONNX file's parameters into a network with the same names and shapes.

    Raises `InputError`, with what was ``wanted``, for a file that has others.
    """
    _take(network, _parameters(path, wanted), path, wanted)


def _parameters(path: Path, wanted: str) -> dict[str, Tensor]:
    try:
        model = onnx.load_model_from_string(read_weights(path, None))
    except DecodeError as fault:
        raise InputError(str(path), got=str(fault), wanted=wanted) from fault
    return {one.name: torch.from_numpy(numpy_helper.to_array(one).copy()) for one in model.graph.initializer}


def _take(network: nn.Module, found: dict[str, Tensor], path: Path, wanted: str) -> None:
    state = network.state_dict()
    # how many batches a norm has seen is in no file, and used by none of them
    missing = [
        name
        for name, value in state.items()
        if not name.endswith("num_batches_tracked") and (name not in found or found[name].shape != value.shape)
    ]
    if missing:
        raise InputError(str(path), got=f"no {missing[0]} of shape {tuple(state[missing[0]].shape)}", wanted=wanted)
    network.load_state_dict({name: found[name] for name in state if name in found}, strict=False)
