"""Values of decoded ROS 2 messages: a head's angles, an uncompressed image; and which images belong together."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from groundstation.errors import SessionError
from groundstation.files.toml_table import quoted
from groundstation.picture import BayerPattern, BgrPicture, Picture, RawPicture

_MOST_JOINTS = 1000
_BAYER = {
    "bayer_rggb8": BayerPattern.RG,
    "bayer_grbg8": BayerPattern.GR,
    "bayer_gbrg8": BayerPattern.GB,
    "bayer_bggr8": BayerPattern.BG,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class BagEpochs:
    """Number of the pair of each frame, by station, and the stations of each pair."""

    numbers: Mapping[str, list[int]]
    stations: Mapping[int, list[str]]


def pan_tilt(message: Any, station: str, *, alone: bool) -> tuple[float, float] | None:
    """Return a station's pan and tilt; None where the message has not both.

    Joints are told by "pan" and "tilt" in their names, and by the station's where several share a topic.
    """
    names = [str(name).lower() for name in message.name[:_MOST_JOINTS]]
    found = []
    for axis in ("pan", "tilt"):
        at = [k for k, name in enumerate(names) if axis in name and (alone or station.lower() in name)]
        if len(at) != 1 or at[0] >= len(message.position) or not math.isfinite(message.position[at[0]]):
            return None
        found.append(float(message.position[at[0]]))
    return found[0], found[1]


def plain_image(message: Any, data: Any, where: str) -> Picture:
    """Return an uncompressed image as a picture."""
    h, w, step, encoding = int(message.height), int(message.width), int(message.step), str(message.encoding)
    depth = 3 if encoding in ("bgr8", "rgb8") else 1
    if encoding not in ("bgr8", "rgb8", "mono8", *_BAYER):
        wanted = "bgr8, rgb8, mono8 or " + ", ".join(_BAYER)
        raise SessionError(where, got=f"encoding {quoted(encoding)}", wanted=wanted)
    if h < 1 or w < 1 or step < depth * w or len(data) < step * h:
        raise SessionError(where, got=f"{len(data)} bytes for {w}×{h} px", wanted="as many as the image has")
    pixels = np.ascontiguousarray(data[: step * h].reshape(h, step)[:, : depth * w])
    if depth == 1:
        return RawPicture(pixels, _BAYER.get(encoding))
    image = pixels.reshape(h, w, 3)
    return BgrPicture(image if encoding == "bgr8" else np.ascontiguousarray(image[:, :, ::-1]))
