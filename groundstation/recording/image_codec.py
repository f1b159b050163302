"""Lossless pixels of a recording: PNG, or uncompressed if compression is too slow."""

from typing import Any

import cv2
import numpy as np
from google.protobuf.message import DecodeError

from groundstation.arrays import ImageArray
from groundstation.errors import RecordingError
from groundstation.files.png_file import png_size_px
from groundstation.picture import BayerPattern
from groundstation.recording import mcap_schemas

# run-length coding: faster than PNG's default strategy on noisy pictures, at the same size
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
# bit depth and colour type in the PNG header: 8 bit, grey or RGB
_PNG_KINDS = (b"\x08\x00", b"\x08\x02")
_ENCODINGS = {
    BayerPattern.RG: "bayer_rggb8",
    BayerPattern.GR: "bayer_grbg8",
    BayerPattern.GB: "bayer_gbrg8",
    BayerPattern.BG: "bayer_bggr8",
}


def encode_image(pixels: ImageArray, *, png: bool, pattern: BayerPattern | None, stamp_ns: int, frame_id: str) -> bytes:
    """Return a message with pixels (h, w) or (h, w, 3) BGR: a CompressedImage with ``png``, else a RawImage."""
    if png:
        data = cv2.imencode(".png", pixels, _PNG)[1].tobytes()
        return mcap_schemas.encode("CompressedImage", stamp_ns=stamp_ns, frame_id=frame_id, data=data, format="png")
    height, width = pixels.shape[:2]
    encoding = "bgr8" if pixels.ndim == 3 else "mono8" if pattern is None else _ENCODINGS[pattern]
    return mcap_schemas.encode(
        "RawImage",
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        width=width,
        height=height,
        encoding=encoding,
        step=width * (3 if pixels.ndim == 3 else 1),
        data=pixels.tobytes(),
    )


def decode_image(message: bytes, *, png: bool, size_px: tuple[int, int], colour: bool, where: str) -> ImageArray:
    """Return the pixels of a message, (h, w, 3) with ``colour``, else (h, w); they must have ``size_px`` (w, h).

    Raises `RecordingError`; a picture with a larger size in its header is not decoded.
    """
    w, h = size_px
    wanted = f"a picture of {w} × {h} px, {'in colour' if colour else 'one value a pixel'}"
    try:
        record = mcap_schemas.decode("CompressedImage" if png else "RawImage", message)
    except DecodeError as error:
        raise RecordingError(where, got="bytes that are no picture", wanted=wanted) from error
    pixels = _unpacked(record.data, size_px) if png else _plain(record, size_px, colour)
    shape = (h, w, 3) if colour else (h, w)
    if pixels is None or pixels.shape != shape or pixels.dtype != np.uint8:
        raise RecordingError(where, got="another picture" if pixels is not None else "a damaged one", wanted=wanted)
    return np.asarray(pixels, np.uint8)


def _unpacked(data: bytes, size_px: tuple[int, int]) -> Any:
    """Return a PNG's pixels, or None if it is invalid or of another size."""
    if png_size_px(data) != size_px or data[24:26] not in _PNG_KINDS:
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None


def _plain(record: Any, size_px: tuple[int, int], colour: bool) -> Any:
    """Return uncompressed pixels, or None if their number is wrong."""
    w, h = size_px
    if (record.width, record.height) != size_px or len(record.data) != w * h * (3 if colour else 1):
        return None
    return np.frombuffer(record.data, np.uint8).reshape((h, w, 3) if colour else (h, w))
