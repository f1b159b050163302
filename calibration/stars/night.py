"""A night's pictures: the folder read, hot pixels found, the stars of each picture found."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.head_picture import HeadPicture, listed_fields
from calibration.picture_table import ListedPicture, read_picture_table
from calibration.stars.sky import FIRST_UTC_S, LAST_UTC_S
from calibration.stars.star_images import StarImages, find_stars, hot_pixels
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import InputError
from groundstation.files.image_header import MAX_PICTURE_PX, coded_size_px, is_decodable
from groundstation.rig.rig import Rig

# fewer pictures show a star at the same pixel by chance
_LEAST_FOR_HOT = 5
# the pictures of a night lie within this
_LONGEST_NIGHT_S = 40.0 * 3600.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarPicture(HeadPicture):
    """One picture of the night sky; ``seen`` are its stars."""

    seen: StarImages


def read_night(
    folder: Path, rig: Rig, progress: Callable[[int, int], None] = lambda done, of: None
) -> dict[str, tuple[StarPicture, ...]]:
    """Return the pictures of ``folder``/pictures.csv by station, in the table's order.

    Pictures are of 8 or 16 bits, colour or grey. Raises `InputError` for a faulty table or picture, and
    `MissingExtraError` without tetra3rs.
    """
    listed = read_picture_table(folder, rig, timed=True)
    require_one_night(folder, listed)
    hot = {name: _hot_of(folder, [i for i in listed if i.station == name], rig) for name in rig.names}
    found: dict[str, list[StarPicture]] = {}
    for number, item in enumerate(listed):
        progress(number + 1, len(listed))
        seen = find_stars(read_grey(folder, item, rig), hot[item.station])
        found.setdefault(item.station, []).append(StarPicture(**listed_fields(item), seen=seen))
    return {name: tuple(pictures) for name, pictures in found.items()}


def read_grey(folder: Path, item: ListedPicture, rig: Rig) -> FloatArray:
    """Return a picture's grey levels (h, w), of 16 bits where it has them; raises `InputError`."""
    where, path = f"{folder.name}/{item.file}", folder / item.file
    if not path.is_file():
        raise InputError(where, got="no such file", wanted="a picture, as stated in pictures.csv")
    data = path.read_bytes()
    size = coded_size_px(data)
    if size is not None and size[0] * size[1] > MAX_PICTURE_PX:
        wanted = f"at most {MAX_PICTURE_PX // 10**6} million pixels"
        raise InputError(where, got=f"a picture of {size[0]}x{size[1]} px", wanted=wanted)
    grey = None
    if is_decodable(data):
        flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
        try:
            grey = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
        except cv2.error:
            grey = None
    if grey is None:
        raise InputError(where, got="nothing that can be decoded", wanted="a picture, as stated in pictures.csv")
    w, h = rig[item.station].lens.image_size_px
    if grey.shape != (h, w):
        got = f"{grey.shape[1]}x{grey.shape[0]} px"
        raise InputError(where, got=got, wanted=f"{w}x{h} px, as stated in the rig for {item.station}")
    return np.asarray(grey, dtype=np.float32)


def require_one_night(folder: Path, listed: Sequence[ListedPicture]) -> None:
    """Raise `InputError` for times that are not Unix times of one night (or day)."""
    for item in listed:
        if not FIRST_UTC_S < item.utc_s < LAST_UTC_S:
            where = f"{folder.name}/pictures.csv: line {item.line}"
            raise InputError(where, got=f"t_utc_s = {item.utc_s:g}", wanted="Unix time in s, as `date +%s` prints it")
    files = [item.file for item in listed]
    if len(set(files)) < len(files):
        twice = next(item for k, item in enumerate(listed) if item.file in files[:k])
        where = f"{folder.name}/pictures.csv: line {twice.line}"
        raise InputError(where, got=f"{twice.file} a second time", wanted="each picture once")
    times = [item.utc_s for item in listed]
    if max(times) - min(times) > _LONGEST_NIGHT_S:
        got = f"pictures over {(max(times) - min(times)) / 3600.0:.0f} hours"
        raise InputError(f"{folder.name}/pictures.csv", got=got, wanted="the pictures of one night")


def _hot_of(folder: Path, listed: Sequence[ListedPicture], rig: Rig) -> MaskArray | None:
    """Return one camera's hot pixels (h, w); None where too few pictures tell."""
    if len(listed) < _LEAST_FOR_HOT:
        return None
    darkest = read_grey(folder, listed[0], rig)
    for item in listed[1:]:
        darkest = np.minimum(darkest, read_grey(folder, item, rig))
    return hot_pixels(darkest)
