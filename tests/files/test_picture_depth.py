"""What a coded picture's header says of orientation and depth: rows as stored, and no 12-bit levels in 16 bits."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.errors import IntrinsicsError
from calibration.pictures import read_pictures
from groundstation.errors import SessionError
from groundstation.files.picture_depth import shallow_levels
from groundstation.session import load_session
from groundstation.session.media import read_image
from tests.session.folder import SIZE, Tiny

RAMP = np.tile(np.linspace(100, 4095, SIZE[0]).astype(np.uint16), (SIZE[1], 1))


def turned_jpeg(path: Path, orientation: int) -> np.ndarray:
    """Write a picture whose EXIF says how to turn it; returns it as it is stored, bright in its upper left."""
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    image[:12, :20] = 255
    data = cv2.imencode(".jpg", image)[1].tobytes()
    entry = struct.pack("<HHIHH", 0x0112, 3, 1, orientation, 0)
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1) + entry + struct.pack("<I", 0)
    path.write_bytes(data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:])
    return image


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_pictures_are_as_stored_in_sessions_and_calibrations(tmp_path: Path, orientation: int) -> None:
    """A camera that is upside down or on its side says so in its pictures: a lens is of the rows of its sensor."""
    stored = turned_jpeg(tmp_path / "000000.jpg", orientation)
    seen = read_image(tmp_path / "000000.jpg")
    (calibrated,) = read_pictures([tmp_path / "000000.jpg"])
    assert isinstance(seen, np.ndarray)
    for image in (seen[:, :, 0], calibrated.grey):
        assert image.shape == stored.shape[:2]
        assert np.abs(image.astype(int) - stored[:, :, 0]).mean() < 3


def depth_of(image: np.ndarray, kind: str = ".png") -> str | None:
    return shallow_levels(cv2.imencode(kind, image)[1].tobytes())


@pytest.mark.parametrize("kind", [".png", ".tif"])
def test_12_bit_levels_in_16_bits_are_noticed(kind: str) -> None:
    assert depth_of(RAMP, kind) == "16 bits a pixel, none brighter than 4095 of 65535"
    assert depth_of(RAMP // 4, kind) == "16 bits a pixel, none brighter than 1023 of 65535"
    assert depth_of(RAMP * 16, kind) is None
    assert depth_of((RAMP // 16).astype(np.uint8), kind) is None


def test_dark_pictures_tell_nothing() -> None:
    """Expected: neither a lens cap nor a black level that was moved to the top."""
    assert depth_of(RAMP % 200) is None
    assert depth_of((RAMP % 200) * 16) is None
    assert shallow_levels(b"no picture") is None


def test_a_session_and_a_calibration_of_such_pictures_are_refused(tmp_path: Path) -> None:
    folder = Tiny(fixed=("left", "right"), video="png").write(tmp_path / "session")
    load_session(folder)
    for path in (folder / "left").iterdir():
        assert cv2.imwrite(str(path), RAMP)
    words = "got 16 bits a pixel, none brighter than 4095 of 65535; wanted 8 bits, or levels moved to the top"
    with pytest.raises(SessionError, match=f"left/000000.png: {words}"):
        load_session(folder)
    with pytest.raises(IntrinsicsError, match=words):
        list(read_pictures([folder / "left"]))
