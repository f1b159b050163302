"""Lens files: the lens keys of rig.toml, a whole rig.toml, OpenCV's and ROS's YAML, Kalibr's camchain."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration.errors import IntrinsicsError
from calibration.lens.lens_text import TEXT
from calibration.lens.model import PARAMETERS, CalibratedLens
from calibration.lens.plain_yaml import parse_yaml
from groundstation.arrays import FloatArray
from groundstation.files.text_file import absence
from groundstation.files.toml_table import TomlTable, load_toml, quoted
from groundstation.files.whole_file import write_whole
from groundstation.geometry.camera import Lens
from groundstation.rig.covariance import ParameterCovariance, read_covariance
from groundstation.rig.rig import load_rig

_MOST_BYTES = 4_000_000
_STATION = re.compile(r"^[ \t]*\[\[[ \t]*station[ \t]*\]\]", re.MULTILINE)
_TOML_KEYS = frozenset({"image_size_px", "focal_px", "principal_point_px", "distortion", "covariance"})
_OPENCV_MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "M1")
_OPENCV_DISTORTION = ("distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "D", "D1")
# names of ROS and Kalibr for k1 k2 p1 p2 (k3); OpenCV's own files have none
_SAME_MODEL = ("", "plumb_bob", "radtan", "radial-tangential")


def format_of(path: Path, asked: str | None) -> str:
    """Return the format to write: ``asked`` if given, else by suffix; raises `IntrinsicsError` for an unknown one."""
    suffix = path.suffix.lower()
    formats = {".toml": ("toml",), ".yaml": ("opencv", "kalibr"), ".yml": ("opencv", "kalibr")}.get(suffix)
    if formats is None:
        raise IntrinsicsError(str(path), got=f"the suffix {quoted(suffix)}", wanted=".toml or .yaml")
    if asked is not None and asked not in formats:
        wanted = " or ".join(formats) + f" in a {suffix} file"
        raise IntrinsicsError(str(path), got=asked, wanted=wanted)
    return asked or formats[0]


def write_lens(path: Path, calibrated: CalibratedLens, form: str) -> None:
    """Write a lens in one of the formats of `lens_text.TEXT`.

    Raises `IntrinsicsError` where that cannot hold it, and where a whole rig stands under that name.
    """
    text = TEXT[form](calibrated)
    require_no_rig(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)


def require_no_rig(path: Path) -> None:
    """Raise `IntrinsicsError` where a rig file stands at ``path``: a lens written there would be all that is left."""
    if path.suffix.lower() != ".toml" or not path.is_file():
        return
    if re.search(
        r"^[ \t]*\[\[[ \t]*station[ \t]*\]\]", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE
    ):
        wanted = "another name for the lens alone (calibrate intrinsics --rig RIG --station NAME writes a whole rig)"
        raise IntrinsicsError(str(path), got="a rig file with [[station]], which would be lost", wanted=wanted)


def read_lens(path: Path, name: str | None = None) -> CalibratedLens:
    """Read a lens from any of the formats.

    Parameters
    ----------
    name : which station of a rig, or camera of a camchain; None where there is only one.

    Raises
    ------
    IntrinsicsError, RigError : the file is not usable or holds another lens model.
    """
    if path.suffix.lower() == ".toml":
        return _from_toml(path, name)
    if not path.is_file():
        raise IntrinsicsError(str(path), got=absence(path), wanted="a lens file")
    if path.stat().st_size > _MOST_BYTES:
        raise IntrinsicsError(str(path), got="more than 4 MB", wanted="a lens file")
    values = parse_yaml(path.read_bytes().decode("utf-8-sig", errors="replace"), str(path))
    cameras = {key: v for key, v in values.items() if isinstance(v, dict) and "intrinsics" in v}
    if cameras:
        return _from_kalibr(cameras, path, name)
    return _from_opencv(values, str(path))


def _from_toml(path: Path, name: str | None) -> CalibratedLens:
    values = load_toml(path, IntrinsicsError)
    if "station" in values:
        rig = load_rig(path)
        station = rig[_one(list(rig.names), name, str(path), "station")]
        if "lens" not in station.known:
            raise IntrinsicsError(str(path), got=f"no lens of station {station.name}", wanted="a lens")
        return CalibratedLens(lens=station.lens, covariance=_lens_part(rig.station_covariance(station.name)))
    table = TomlTable(values, str(path), IntrinsicsError)
    table.refuse_unknown(_TOML_KEYS)
    lens = _lens(
        str(path),
        table.vector("image_size_px", 2, names="[width, height]"),
        [*table.vector("focal_px", 2, names="[fx, fy]"), *table.vector("principal_point_px", 2, names="[cx, cy]")],
        table.vector("distortion", 5, (0.0,) * 5),
    )
    return CalibratedLens(lens=lens, covariance=_lens_part(read_covariance(table.table("covariance"))))


def _lens_part(known: ParameterCovariance) -> FloatArray:
    """Return the covariance (9, 9) of a lens's own parameters out of one of more."""
    covariance = np.zeros((9, 9))
    places = [(i, PARAMETERS.index(n)) for i, n in enumerate(known.names) if n in PARAMETERS]
    if places:
        source, target = (list(each) for each in zip(*places, strict=True))
        covariance[np.ix_(target, target)] = known.matrix[np.ix_(source, source)]
    return covariance


def _one(names: Sequence[str], name: str | None, where: str, kind: str) -> str:
    if name is None and len(names) == 1:
        return names[0]
    if name is None or name not in names:
        got = f"{len(names)} {kind}s" if name is None else f"--name {quoted(name)}"
        raise IntrinsicsError(where, got=got, wanted="--name with one of " + ", ".join(quoted(n) for n in names))
    return name


def _from_kalibr(cameras: Mapping[str, Any], path: Path, name: str | None) -> CalibratedLens:
    chosen = _one(list(cameras), name, str(path), "camera")
    where, camera = f"{path}: {quoted(chosen)}", cameras[chosen]
    model, distortion = camera.get("camera_model", ""), camera.get("distortion_model", "")
    if model != "pinhole" or distortion not in (*_SAME_MODEL, "none"):
        raise IntrinsicsError(where, got=quoted(f"{model}-{distortion}"), wanted="pinhole-radtan")
    size = _numbers(camera.get("resolution"), f"{where} resolution", 2)
    intrinsics = _numbers(camera.get("intrinsics"), f"{where} intrinsics", 4)
    coefficients = (
        [] if distortion == "none" else _numbers(camera.get("distortion_coeffs"), f"{where} distortion_coeffs", 4)
    )
    return CalibratedLens(
        lens=_lens(where, size, intrinsics, [*coefficients, *([0.0] * 5)][:5]), covariance=np.zeros((9, 9))
    )


def _from_opencv(values: Mapping[str, Any], where: str) -> CalibratedLens:
    matrix = _matrix(_first(values, _OPENCV_MATRIX, where), f"{where}: camera_matrix", (3, 3))
    model = values.get("distortion_model", values.get("camera_model", ""))
    if model not in (*_SAME_MODEL, "pinhole"):
        raise IntrinsicsError(f"{where}: distortion_model", got=quoted(model), wanted="plumb_bob, k1 k2 p1 p2 k3")
    given = _matrix(_first(values, _OPENCV_DISTORTION, where), f"{where}: distortion_coefficients", None).reshape(-1)
    if given.size not in (0, 4, 5, 8, 12, 14) or np.any(given[5:] != 0.0):
        got = f"{given.size} coefficients"
        raise IntrinsicsError(f"{where}: distortion_coefficients", got=got, wanted="k1 k2 p1 p2 and perhaps k3")
    if matrix[0, 1] != 0.0 or matrix[1, 0] != 0.0 or not np.array_equal(matrix[2], (0.0, 0.0, 1.0)):
        raise IntrinsicsError(f"{where}: camera_matrix", got="other entries", wanted="fx, fy, cx, cy, a one and zeros")
    size = [
        values.get("image_width", values.get("image_Width")),
        values.get("image_height", values.get("image_Height")),
    ]
    distortion = np.concatenate([given, np.zeros(5)])[:5]
    lens = _lens(
        where, _numbers(size, f"{where}: image_width, image_height", 2), matrix[[0, 1, 0, 1], [0, 1, 2, 2]], distortion
    )
    names = values.get("covariance_parameters", [])
    if not names:
        return CalibratedLens(lens=lens, covariance=np.zeros((9, 9)))
    rows = _matrix(values.get("covariance"), f"{where}: covariance", None)
    table = {"parameters": names, "matrix": rows.tolist()}
    return CalibratedLens(lens=lens, covariance=_lens_part(read_covariance(TomlTable(table, where, IntrinsicsError))))


def _first(values: Mapping[str, Any], keys: Sequence[str], where: str) -> Any:
    for key in keys:
        if key in values:
            return values[key]
    raise IntrinsicsError(where, got=f"no {keys[0]}", wanted="a lens file of OpenCV, ROS or Kalibr")


def _matrix(value: Any, where: str, shape: tuple[int, int] | None) -> FloatArray:
    """Return OpenCV's matrix (rows, cols, data), or a plain list of rows."""
    if isinstance(value, dict):
        rows, columns = (value.get(key) for key in ("rows", "cols"))
        size = [v for v in (rows, columns) if isinstance(v, float) and v.is_integer() and 0 <= v <= 1000]
        if len(size) == 2 and (shape is None or shape == (size[0], size[1])):
            count = int(size[0]) * int(size[1])
            return np.array(_numbers(value.get("data"), where, count)).reshape(int(size[0]), int(size[1]))
    elif isinstance(value, list):
        flat = [v for row in value for v in (row if isinstance(row, list) else [row])]
        if shape is None or len(flat) == shape[0] * shape[1]:
            return np.array(_numbers(flat, where, len(flat))).reshape(shape or (1, -1))
    wanted = "rows, cols and data" if shape is None else f"rows: {shape[0]}, cols: {shape[1]} and data"
    raise IntrinsicsError(where, got=quoted(value), wanted=wanted)


def _numbers(value: Any, where: str, count: int) -> list[float]:
    if not isinstance(value, list) or len(value) != count or not all(isinstance(v, float) for v in value):
        raise IntrinsicsError(where, got=quoted(value), wanted=f"{count} numbers")
    if not np.all(np.isfinite(value)):
        raise IntrinsicsError(where, got=quoted(value), wanted=f"{count} finite numbers")
    return value


def _lens(
    where: str, size: Sequence[float] | FloatArray, intrinsics: Sequence[float] | FloatArray, distortion: Any
) -> Lens:
    """Return the lens; raises where size or focal length is invalid."""
    w, h = (float(v) for v in size)
    if w != int(w) or h != int(h) or not 1 <= min(w, h) <= max(w, h) <= 100_000:
        raise IntrinsicsError(where, got=f"an image of {w:g}x{h:g} px", wanted="whole numbers of px, 1 to 100000")
    fx, fy, cx, cy = (float(v) for v in intrinsics)
    if not min(fx, fy) > 0.0:
        raise IntrinsicsError(where, got=f"a focal length of {min(fx, fy):g} px", wanted="one above 0")
    return Lens(
        image_size_px=(int(w), int(h)),
        focal_px=np.array([fx, fy]),
        principal_point_px=np.array([cx, cy]),
        distortion=np.asarray(distortion, dtype=np.float64),
    )
