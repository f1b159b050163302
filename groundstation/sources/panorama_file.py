"""Panoramas of a site's heads in one file, .npz: grey levels, where they are of use, and their place, by station."""

import io
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from groundstation.detection.panorama import GroundPanorama
from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import write_whole

FORMAT = "groundstation-panorama/1"
_MOST_BYTES, _MOST_PIXELS = 500_000_000, 200_000_000
_KEYS = ("grey", "known", "place")
# what zipfile and NumPy raise for bytes that are wrong
_DAMAGED = (
    *(ValueError, KeyError, EOFError, SyntaxError, NotImplementedError, RuntimeError, OverflowError, MemoryError),
    *(zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError),
)


def write_panoramas(path: Path, panoramas: Mapping[str, GroundPanorama]) -> None:
    """Write the panoramas of stations; raises `InputError` where the file cannot be written."""
    arrays: dict[str, np.ndarray] = {"format": np.array(FORMAT)}
    for name, one in panoramas.items():
        arrays[f"{name}.grey"] = np.clip(np.round(one.grey), 0, 255).astype(np.uint8)
        arrays[f"{name}.known"] = np.asarray(one.known, dtype=np.uint8)
        arrays[f"{name}.place"] = np.array([one.left_rad, one.top_rad, one.step_rad, one.sigma_rad])
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content.getvalue())
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault


def read_panoramas(path: Path) -> dict[str, GroundPanorama]:
    """Return the panoramas of a file by station; raises `InputError` for one that is none."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(str(path), got=f"{path.stat().st_size} bytes", wanted=f"at most {_MOST_BYTES}")
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            if "format" not in file or str(file["format"]) != FORMAT:
                raise InputError(str(path), got="no format", wanted=f"{FORMAT}, as `calibrate panorama` writes it")
            names = sorted({key.rpartition(".")[0] for key in file.files} - {""})
            found = {name: _panorama(path, name, {key: file[f"{name}.{key}"] for key in _KEYS}) for name in names}
    except OSError as fault:
        got = os_words(fault)
        raise InputError(str(path), got=got, wanted="a file of `calibrate panorama`") from fault
    except _DAMAGED as fault:
        raise InputError(str(path), got="no panorama", wanted="a file of `calibrate panorama`") from fault
    if not found:
        raise InputError(str(path), got="no station", wanted="a panorama of one or more")
    return found


def _panorama(path: Path, name: str, arrays: Mapping[str, np.ndarray]) -> GroundPanorama:
    grey, known, place = (arrays[key] for key in _KEYS)
    whole = grey.ndim == 2 and grey.shape == known.shape and min(grey.shape) > 1 and grey.size <= _MOST_PIXELS
    right = grey.dtype == known.dtype == np.uint8 and place.shape == (4,) and place.dtype == np.float64
    if not whole or not right or not np.isfinite(place).all() or not (1e-6 < place[2] < 0.1 and place[3] >= 0.0):
        raise InputError(f"{path}: {name}", got="no panorama", wanted="a file of `calibrate panorama`")
    return GroundPanorama(
        grey=np.asarray(grey, dtype=np.float32),
        known=known,
        left_rad=float(place[0]),
        top_rad=float(place[1]),
        step_rad=float(place[2]),
        sigma_rad=float(place[3]),
    )
