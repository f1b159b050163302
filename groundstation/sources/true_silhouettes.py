"""The true silhouettes of a rendered session: masks.npz by station and pair, read within a budget."""

import math
import struct
import zipfile
import zlib
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import SessionError
from groundstation.files.image_header import MAX_PICTURE_PX
from groundstation.files.toml_table import shown
from groundstation.session import Session
from groundstation.sources.frame_table import read_frames

# what numpy and zipfile raise for an archive that is damaged, or none
_DAMAGE = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, AttributeError, RuntimeError, MemoryError, SyntaxError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)
_MAX_CORNER_PX = 100_000
# of an array in masks.npz, whose values are bytes
_HEADER_BYTES = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueSilhouette:
    """The true silhouette: ``mask`` (h, w) with its upper-left pixel at column ``x`` and row ``y`` of the image."""

    x: int
    y: int
    mask: MaskArray

    @property
    def width_px(self) -> int:
        """Width of the silhouette in px."""
        columns = np.flatnonzero(self.mask.any(axis=0))
        return int(columns[-1] - columns[0] + 1)

    @property
    def centre_px(self) -> FloatArray:
        """Centre of its pixels, (2,)."""
        rows, columns = np.nonzero(self.mask)
        return np.array([self.x + columns.mean(), self.y + rows.mean()])


class SilhouetteArchive:
    """The session's masks.npz by station and epoch."""

    def __init__(self, session: Session) -> None:
        path = session.folder / "masks.npz"
        if not path.is_file():
            raise SessionError(session.name, got="no masks.npz", wanted="a rendered session with true silhouettes")
        self._where = f"{session.name}: masks.npz"
        try:
            self._archive = zipfile.ZipFile(BytesIO(path.read_bytes()))
            self._names = frozenset(name.removesuffix(".npy") for name in self._archive.namelist())
        except _DAMAGE as fault:
            raise self._fault(str(fault)) from fault
        self._numbers = read_frames(session).index

    def find(self, station: str, epoch: int) -> TrueSilhouette | None:
        """Return the silhouette, None where the aircraft is not in the picture."""
        key = f"{station}_{int(self._numbers[epoch]):04d}"
        if key not in self._names:
            return None
        mask, corner = self._array(key, 2), self._array(f"{key}_xy", 1)
        if not mask.any():
            return None
        if len(corner) != 2 or max(abs(int(v)) for v in corner) > _MAX_CORNER_PX:
            raise self._fault(f"{key}_xy is no corner of a silhouette")
        return TrueSilhouette(x=int(corner[0]), y=int(corner[1]), mask=mask > 0)

    def _array(self, key: str, dimensions: int) -> NDArray[Any]:
        """Return an array of whole numbers; raises `SessionError` where the archive is damaged there."""
        try:
            found = _member(self._archive, f"{key}.npy")
        except _DAMAGE as fault:
            raise self._fault(f"{key}: {fault}") from fault
        if found.ndim != dimensions or found.dtype.kind not in "biu":
            raise self._fault(f"{key}: {found.ndim} dimensions of {found.dtype}")
        return found

    def _fault(self, got: str) -> SessionError:
        return SessionError(self._where, got=shown(got), wanted="silhouettes, as `groundstation simulate` writes them")


def _member(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """Return one array of an archive, as numpy writes it; raises one of `_DAMAGE`.

    numpy allocates memory for the shape in a member's header, and unpacks all of it: both are checked before.
    """
    most = MAX_PICTURE_PX + _HEADER_BYTES
    with archive.open(name) as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise ValueError(f"more than {most} bytes")
    stream = BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    shape, _, dtype = read_header[version](stream, max_header_size=_HEADER_BYTES)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise ValueError(f"an array {shape} of {dtype} in {len(data) - stream.tell()} bytes")
    stream.seek(0)
    found: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return found
