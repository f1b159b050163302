"""One's own labelled pictures, to fine-tune the network on an aircraft: a folder of pictures, masks and noses.

`NAME.png` or `NAME.jpg` is a picture, `NAME.mask.png` of the same size is white where the aircraft is, and `noses.csv`
(picture, u_px, v_px; optional, as are its rows) says where the nose is, visible or not.
"""

from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.errors import InputError
from groundstation.files.csv_table import CsvTable
from groundstation.sources.true_silhouettes import TrueSilhouette
from training.recorded_windows import RecordedTarget, labelled_picture, target_in

_MASK, _NOSES = ".mask.png", "noses.csv"
_SUFFIXES = (".png", ".jpg", ".jpeg")
_WHITE = 128
_LEAST_WIDTH_PX = 6


def labelled_pictures(folder: Path) -> list[RecordedTarget]:
    """Return the targets of a folder's pictures, in the order of their names.

    Raises `InputError` where there is none, or a mask is missing, empty or of another size.
    """
    pictures = sorted(
        path for path in folder.glob("*") if path.suffix.lower() in _SUFFIXES and not path.name.endswith(_MASK)
    )
    if not pictures:
        raise InputError(str(folder), got="no pictures", wanted=f"NAME.png or NAME.jpg, each with NAME{_MASK}")
    noses = _noses(folder / _NOSES)
    unknown = set(noses) - {path.name for path in pictures}
    if unknown:
        raise InputError(
            str(folder / _NOSES), got=f"no picture {min(unknown)}", wanted="names of pictures in its folder"
        )
    return [_labelled(path, noses.get(path.name)) for path in pictures]


def _labelled(path: Path, nose_px: FloatArray | None) -> RecordedTarget:
    mask_path = path.with_name(path.stem + _MASK)
    image, mask = _read(path, cv2.IMREAD_COLOR), _read(mask_path, cv2.IMREAD_GRAYSCALE)
    if mask.shape != image.shape[:2]:
        got, wanted = (f"{n.shape[1]} × {n.shape[0]} px" for n in (mask, image))
        raise InputError(str(mask_path), got=got, wanted=f"{wanted}, as its picture")
    silhouette = TrueSilhouette(x=0, y=0, mask=mask >= _WHITE)
    columns = np.flatnonzero(silhouette.mask.any(axis=0))
    width = int(columns[-1] - columns[0] + 1) if columns.size else 0
    if width < _LEAST_WIDTH_PX:
        raise InputError(str(mask_path), got=f"an aircraft {width} px wide", wanted=f"at least {_LEAST_WIDTH_PX} px")
    nose = np.full(2, np.nan) if nose_px is None else nose_px
    return target_in(labelled_picture(image, silhouette), silhouette.centre_px, float(width), nose)


def _read(path: Path, how: int) -> ImageArray:
    image = cv2.imread(str(path), how)
    if image is None:
        raise InputError(str(path), got="no picture that OpenCV reads", wanted="a PNG or JPEG file")
    return np.asarray(image, np.uint8)


def _noses(path: Path) -> dict[str, FloatArray]:
    if not path.exists():
        return {}
    table = CsvTable(path, ("picture", "u_px", "v_px"))
    return {
        row.text["picture"].strip(): np.array([table.number(row, "u_px"), table.number(row, "v_px")]) for row in table
    }
