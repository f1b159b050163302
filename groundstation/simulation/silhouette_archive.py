"""masks.npz of a rendered session: numpy's container without times of writing, so that equal masks are equal files."""

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# the earliest time that a zip file can hold
_DATE = (1980, 1, 1, 0, 0, 0)


def write_silhouettes(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name as `numpy.load` reads them, compressed, in the mapping's order."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy", _DATE)
            member.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(member, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asanyarray(values), allow_pickle=False)
