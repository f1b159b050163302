"""GenICam's pixel formats as pictures: raw stays raw, deeper than eight bits is cut to the upper eight."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.picture import BayerPattern, BgrPicture, Picture, RawPicture
from groundstation.sources.cameras.camera import CameraError

_RAW = re.compile(r"(Mono|Bayer(RG|GR|GB|BG))(8|10|12|14|16)$")
_COLOUR = {"RGB8": (3, "rgb"), "BGR8": (3, "bgr"), "RGBa8": (4, "rgb"), "BGRa8": (4, "bgr")}
WANTED = "Mono8, BayerRG8 (GR, GB, BG), RGB8, BGR8, RGBa8, BGRa8, or Mono and Bayer of 10 to 16 bits, not packed"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pixels:
    """``pixels`` (h, w) raw or (h, w, 3) BGR, uint8, its own memory; ``pattern`` of raw colours, None for grey."""

    pixels: ImageArray
    pattern: BayerPattern | None


def pixels_of(
    data: NDArray[np.uint8] | NDArray[np.uint16], pixel_format: str, size_px: tuple[int, int], row_padding: int = 0
) -> Pixels:
    """Return a copy of the pixels that a camera sent.

    Parameters
    ----------
    data : values in the order of transmission, uint8, or uint16 for deeper formats; any shape.
    pixel_format : its name in GenICam's Pixel Format Naming Convention.
    size_px : w, h.
    row_padding : values behind each row that are not pixels.

    Raises `CameraError` for an unknown format, or too few values.
    """
    w, h = size_px
    raw = _RAW.match(pixel_format)
    if raw is None and pixel_format not in _COLOUR:
        raise CameraError(f"pixel format: got {pixel_format}; wanted {WANTED}")
    channels = 1 if raw else _COLOUR[pixel_format][0]
    row = w * channels + row_padding
    values = data.reshape(-1)
    # the last row's padding may be missing
    if values.size < row * h - row_padding:
        wanted = f"{row * h - row_padding} for {w} × {h} px"
        raise CameraError(f"picture in {pixel_format}: got {values.size} values; wanted {wanted}")
    values = np.concatenate([values, np.zeros(max(row * h - values.size, 0), values.dtype)])
    image: NDArray[np.integer[Any]] = values[: row * h].reshape(h, row)[:, : w * channels]
    if raw is None:
        image = image.reshape(h, w, channels)[..., :3]
        return Pixels(pixels=_own(image[..., ::-1] if _COLOUR[pixel_format][1] == "rgb" else image), pattern=None)
    bits = int(raw[3])
    if bits > 8:
        image = image >> (bits - 8)
    return Pixels(pixels=_own(image), pattern=BayerPattern[raw[2]] if raw[2] else None)


def picture_of(pixels: ImageArray, pattern: BayerPattern | None) -> Picture:
    """Return pixels as a picture that is read through windows."""
    return RawPicture(pixels, pattern) if pixels.ndim == 2 else BgrPicture(pixels)


def _own(image: NDArray[np.integer[Any]]) -> ImageArray:
    return np.array(image, np.uint8, order="C", copy=True)
