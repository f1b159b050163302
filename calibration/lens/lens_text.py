"""A lens as text: the lens keys of rig.toml, OpenCV's YAML, Kalibr's camchain."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from calibration.errors import IntrinsicsError
from calibration.lens.model import PARAMETERS, CalibratedLens
from groundstation.arrays import FloatArray


def lens_to_toml(calibrated: CalibratedLens) -> str:
    """Return the keys that a [[station]] of rig.toml takes, and [covariance], there [station.covariance]."""
    lens = calibrated.lens
    w, h = lens.image_size_px
    lines = [
        "# for a [[station]] of rig.toml; [covariance] is [station.covariance] there",
        f"image_size_px = [{w}, {h}]",
        f"focal_px = {_list(lens.focal_px)}",
        f"principal_point_px = {_list(lens.principal_point_px)}",
        f"distortion = {_list(lens.distortion)}",
    ]
    known = _known(calibrated.covariance)
    if len(known):
        names = ", ".join(f'"{PARAMETERS[i]}"' for i in known)
        rows = [f"  {_list(row)}," for row in calibrated.covariance[np.ix_(known, known)]]
        lines += ["", "[covariance]", f"parameters = [{names}]", "matrix = [", *rows, "]"]
    return "\n".join(lines) + "\n"


def lens_to_opencv(calibrated: CalibratedLens) -> str:
    """Return what cv2.FileStorage reads, with the names of OpenCV's sample programs."""
    lens = calibrated.lens
    w, h = lens.image_size_px
    (fx, fy), (cx, cy) = lens.focal_px, lens.principal_point_px
    lines = ["%YAML:1.0", "---", f"image_width: {w}", f"image_height: {h}"]
    lines += _matrix("camera_matrix", np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]))
    lines += ["distortion_model: plumb_bob"]
    lines += _matrix("distortion_coefficients", lens.distortion[None])
    known = _known(calibrated.covariance)
    if len(known):
        lines += ["covariance_parameters: [ " + ", ".join(f'"{PARAMETERS[i]}"' for i in known) + " ]"]
        lines += _matrix("covariance", calibrated.covariance[np.ix_(known, known)])
    return "\n".join(lines) + "\n"


def lens_to_kalibr(calibrated: CalibratedLens) -> str:
    """Return a camchain with one camera; raises `IntrinsicsError` where k3 is not zero, which it cannot hold."""
    lens = calibrated.lens
    if lens.distortion[4] != 0.0:
        raise IntrinsicsError(
            "Kalibr's radtan",
            got=f"a lens with k3 = {lens.distortion[4]:.6g}",
            wanted="k3 = 0, for it has four coefficients (calibrate with --hold k3, or convert with --refit)",
        )
    w, h = lens.image_size_px
    return (
        "cam0:\n"
        "  camera_model: pinhole\n"
        f"  distortion_coeffs: {_list(lens.distortion[:4])}\n"
        "  distortion_model: radtan\n"
        f"  intrinsics: {_list([*lens.focal_px, *lens.principal_point_px])}\n"
        f"  resolution: [{w}, {h}]\n"
        "  rostopic: /cam0/image_raw\n"
    )


TEXT = {"toml": lens_to_toml, "opencv": lens_to_opencv, "kalibr": lens_to_kalibr}


def _known(covariance: FloatArray) -> Any:
    """Return the numbers of the parameters that are uncertain."""
    return np.flatnonzero(np.diag(covariance) > 0)


def _list(values: Iterable[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _matrix(key: str, matrix: FloatArray) -> list[str]:
    rows, columns = matrix.shape
    values = [", ".join(repr(float(v)) for v in row) for row in matrix]
    data = ",\n       ".join(values)
    return [
        f"{key}: !!opencv-matrix",
        f"   rows: {rows}",
        f"   cols: {columns}",
        "   dt: d",
        f"   data: [ {data} ]",
    ]
