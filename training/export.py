"""The network as ONNX: what the program runs."""

import hashlib
from pathlib import Path

import torch

from groundstation.detection.channel_window import WINDOW_PX
from training.network import ChannelNetwork


def export_onnx(network: ChannelNetwork, path: Path) -> str:
    """Write the network for one window at a time; returns the file's SHA-256."""
    network = network.to("cpu", memory_format=torch.contiguous_format).eval()
    window = torch.full((1, 3, WINDOW_PX[1], WINDOW_PX[0]), 128.0)
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.onnx.export(
        network, (window,), str(path), input_names=["window"], output_names=["maps"], opset_version=17, dynamo=False
    )
    return hashlib.sha256(path.read_bytes()).hexdigest()
