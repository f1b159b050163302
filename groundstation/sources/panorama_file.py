"""Panoramas of a site's heads in one file, .npz: grey levels, where they are of use, and their place, by station."""

import io
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile

from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.registration.panorama import GroundPanorama

FORMAT = "groundstation-panorama/1"
_MOST_BYTES, _MOST_PIXELS = 500_000_000, 200_000_000
_KEYS = ("grey", "known", "place")
_WANTED = "a file of `calibrate panorama`"
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
    """Return the panoramas of a file by station; raises `InputError`, which names file and key, where it is none."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(str(path), got=f"{path.stat().st_size} bytes", wanted=f"at most {_MOST_BYTES}")
        content = path.read_bytes()
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted=_WANTED) from fault
    try:
        file = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, *_DAMAGED) as fault:
        raise InputError(str(path), got="no archive, or a damaged one", wanted=_WANTED) from fault
    if not isinstance(file, NpzFile):
        raise InputError(str(path), got="a single array", wanted=_WANTED)
    with file:
        return _panoramas(path, file)


def _panoramas(path: Path, file: NpzFile) -> dict[str, GroundPanorama]:
    written = _array(path, file, "format")
    if written.shape or str(written) != FORMAT:
        got = repr(str(written)[:40]) if not written.shape else f"an array of {written.shape}"
        raise InputError(f"{path}: format", got=got, wanted=f"{FORMAT}, as `calibrate panorama` writes it")
    names = sorted({key.rpartition(".")[0] for key in file.files if key != "format"})
    for key in file.files:
        name, _, which = key.rpartition(".")
        if key != "format" and (not name or which not in _KEYS):
            raise InputError(f"{path}: {key}", got="an unknown key", wanted=f"STATION.{', .'.join(_KEYS)}")
    if not names:
        raise InputError(str(path), got="no station", wanted="a panorama of one or more")
    return {name: _panorama(path, name, {key: _array(path, file, f"{name}.{key}") for key in _KEYS}) for name in names}


def _array(path: Path, file: NpzFile, key: str) -> np.ndarray:
    """Return what stands under a key."""
    if key not in file.files:
        raise InputError(f"{path}: {key}", got="nothing", wanted=_WANTED)
    try:
        found = file[key]
    except (OSError, *_DAMAGED) as fault:
        raise InputError(f"{path}: {key}", got="damaged bytes", wanted=_WANTED) from fault
    if not isinstance(found, np.ndarray):
        raise InputError(f"{path}: {key}", got="no array", wanted=_WANTED)
    return found


def _panorama(path: Path, name: str, arrays: Mapping[str, np.ndarray]) -> GroundPanorama:
    grey, known, place = (arrays[key] for key in _KEYS)

    def refuse(key: str, wanted: str) -> InputError:
        got = f"{arrays[key].dtype} of {arrays[key].shape}"
        if key == "place" and arrays[key].size == 4:
            got = ", ".join(f"{v}" for v in arrays[key].ravel())
        return InputError(f"{path}: {name}.{key}", got=got, wanted=wanted)

    if grey.dtype != np.uint8 or grey.ndim != 2 or min(grey.shape) < 2 or grey.size > _MOST_PIXELS:
        raise refuse("grey", f"uint8 of two dimensions, at most {_MOST_PIXELS} pixels")
    if known.dtype != np.uint8 or known.shape != grey.shape:
        raise refuse("known", f"uint8 of {grey.shape}, as {name}.grey")
    if place.dtype != np.float64 or place.shape != (4,):
        raise refuse("place", "float64 of (4,): left, top, step and sigma, rad")
    if not np.isfinite(place).all() or not (1e-6 < place[2] < 0.1 and place[3] >= 0.0):
        raise refuse("place", "left, top, step (1e-6 to 0.1) and sigma (0 or more), rad")
    return GroundPanorama(
        grey=np.asarray(grey, dtype=np.float32),
        known=known,
        left_rad=float(place[0]),
        top_rad=float(place[1]),
        step_rad=float(place[2]),
        sigma_rad=float(place[3]),
    )
