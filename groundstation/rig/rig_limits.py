"""What a number of a rig file cannot be: those of another unit or of another order, refused where they are read."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.files.toml_table import TomlTable

# a camera's arm on its head, and a rolling shutter: millimetres and milliseconds are beyond
_LONGEST_ARM_M, LONGEST_READOUT_S = 5.0, 1.0
# of an angle reading; seconds of arc are tens, and with less known the pictures do not tell where a head looks either
_COARSEST_DEG = 5.0
# of a rotation: with more there is none; square degrees are beyond
_WIDEST_ROTATION_RAD = 1.0
# what p1 and p2 displace a picture's corner by, as a share of its distance from the middle; lenses have thousandths
_MOST_TANGENTIAL = 0.03
# focal lengths as shares of the picture's size: views of 157 and of 0.06 degrees
_LEAST_FOCAL_SHARE, _MOST_FOCAL_SHARE = 0.1, 1000.0


def focal_wanted(size: FloatArray, focal: FloatArray) -> str:
    """Return what is wanted of a focal length (2,) px of pictures of a size (2,) px; "" of one that can be."""
    picture = f"the picture's {size[0]:.0f} × {size[1]:.0f} px"
    if np.any(focal < _LEAST_FOCAL_SHARE * size):
        return f"pixels, not mm: at least {_LEAST_FOCAL_SHARE:g} of {picture}"
    return f"at most {_MOST_FOCAL_SHARE:g} times {picture}" if np.any(focal > _MOST_FOCAL_SHARE * size) else ""


def size_relation(got: tuple[int, int], lens: tuple[int, int]) -> str:
    """Return, to follow a size (w, h) of pictures that a lens's is not, how the two are related."""
    if (across := _scale(got, lens)) is not None:
        # pixel (0, 0) is the centre of the upper left one
        return (
            f"; focal_px of that size times {across:.6g}, and each c of principal_point_px as"
            f" (c + 0.5) × {across:.6g} − 0.5, are those of the pictures, unless cut"
        )
    if (turned := _scale(got[::-1], lens)) is not None:
        also = "" if turned == 1.0 else f" (and the size is that times {turned:.6g})"
        return f"; width and height are exchanged{also}: are the pictures turned by 90 deg?"
    return "; another shape, so one of the two is a part of the sensor: calibrate the lens with pictures of this size"


def _scale(got: tuple[int, int], lens: tuple[int, int]) -> float | None:
    """Return by what a lens's size (w, h) is multiplied in a size that is rounded to pixels; None for another shape."""
    across, down = got[0] / lens[0], got[1] / lens[1]
    alike = abs(across * lens[1] - got[1]) <= 1.0 or abs(down * lens[0] - got[0]) <= 1.0
    return across if alike else None


def read_arm(table: TomlTable) -> FloatArray:
    """Return where the camera is on its head, m."""
    arm = table.vector("camera_in_head_m", 3, (0.0, 0.0, 0.0))
    if np.linalg.norm(arm) > _LONGEST_ARM_M:
        raise table.fail("camera_in_head_m", str(arm.tolist()), f"metres from the axes, at most {_LONGEST_ARM_M:g}")
    return arm


def read_readout(table: TomlTable) -> float:
    """Return the time of a rolling shutter, s."""
    readout_s = table.number("readout_s", 0.0)
    if abs(readout_s) > LONGEST_READOUT_S:
        raise table.fail("readout_s", f"{readout_s:g}", f"seconds, at most {LONGEST_READOUT_S:g} either way")
    return readout_s


def read_reading_deg(table: TomlTable, key: str, default: float) -> float:
    """Return the step or the sigma of an angle reading, degrees."""
    value = table.number(key, default, minimum=0.0)
    if value > _COARSEST_DEG:
        wanted = f"a finite number ≥ 0 ≤ {_COARSEST_DEG:g}, in degrees; a head that does not turn is fixed = true"
        raise table.fail(key, f"{value:g}", wanted)
    return value


def read_distortion(table: TomlTable, size: FloatArray, focal: FloatArray) -> FloatArray:
    """Return k1, k2, p1, p2, k3; ``size`` (2,) and ``focal`` (2,) are the picture's and the lens's, px."""
    distortion = table.vector("distortion", 5, (0.0,) * 5)
    x, y = 0.5 * size / focal
    p1, p2 = distortion[2:4]
    square = x * x + y * y
    # the same of either sign: of the corner that it is worst at
    moved = np.hypot(
        2.0 * abs(p1 * x * y) + abs(p2) * (square + 2.0 * x * x),
        2.0 * abs(p2 * x * y) + abs(p1) * (square + 2.0 * y * y),
    )
    if moved > _MOST_TANGENTIAL * np.sqrt(square):
        got = f"p1 = {p1:g} and p2 = {p2:g}, which displace a corner by {moved * float(focal.mean()):.0f} px"
        raise table.fail("distortion", got, "k1, k2, p1, p2, k3 in this order")
    return distortion


def require_rotation_sigmas(table: TomlTable, names: tuple[str, ...], matrix: FloatArray) -> None:
    """Raise `RigError` for a rotation so uncertain that there is none."""
    for name, variance in zip(names, np.diag(matrix), strict=True):
        if (
            any(part in name for part in ("runway_from_base", "head_from_camera"))
            and variance > _WIDEST_ROTATION_RAD**2
        ):
            wanted = f"rad² of at most {_WIDEST_ROTATION_RAD**2:g}"
            raise table.fail("matrix", f"a variance of {variance:g} for {name}", wanted)
