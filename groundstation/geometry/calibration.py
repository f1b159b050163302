"""A station's calibration as a vector of parameters: their names and order, their effect on a pixel, a change of them.

Rotations are small-angle vectors θ in the left-hand frame of their name: runway_from_base becomes
exp([θ]×) · runway_from_base with θ in the runway frame, head_from_camera in the same way with θ in the head frame.
All others are added. The radius beyond which the lens polynomial is constant is not a parameter: a change keeps it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import GroundstationError
from groundstation.geometry import kernels
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE, project_calibration
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_from_vector, wxyz_from_matrix
from groundstation.geometry.station import StationGeometry

_GROUPS = {
    "runway_from_base": ("x", "y", "z"),  # rad, runway frame
    "ptu_position": ("x", "y", "z"),  # m, runway frame
    "head_from_camera": ("x", "y", "z"),  # rad, head frame
    "camera_in_head": ("x", "y", "z"),  # m, head frame
    "focal": ("x", "y"),  # px
    "principal_point": ("x", "y"),  # px
    "distortion": ("k1", "k2", "p1", "p2", "k3"),
}
# the one order of the parameters; rig.toml's covariance uses the same names
CALIBRATION_PARAMETERS: tuple[str, ...] = tuple(f"{group}.{part}" for group, parts in _GROUPS.items() for part in parts)
_INDEX = {name: k for k, name in enumerate(CALIBRATION_PARAMETERS)}
# rotation vectors, and the matrices of the packed station that they turn
_TURNED = ((slice(0, 3), slice(0, 9)), (slice(6, 9), slice(12, 21)))
# where an added parameter stands in the packed station
_PACKED = ((slice(3, 6), slice(9, 12)), (slice(9, 12), slice(21, 24)), (slice(12, 21), slice(24, 33)))


class CalibrationError(GroundstationError):
    """A calibration parameter has an unknown name, or a changed station is invalid."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibratedProjection:
    """A projected point with its derivatives.

    Attributes
    ----------
    pixel : (2,) u, v.
    jacobian : (2, 5) ∂(u, v)/∂(x, y, z, pan, tilt), px per m and px per rad.
    calibration_jacobian : (2, 21) ∂(u, v)/∂`CALIBRATION_PARAMETERS`, px per rad, m, px or unit.
    depth_m : along the optical axis.
    """

    pixel: FloatArray
    jacobian: FloatArray
    calibration_jacobian: FloatArray
    depth_m: float


def parameter_indices(names: Sequence[str]) -> list[int]:
    """Return the places of parameters in the full vector; raises `CalibrationError` for an unknown name."""
    unknown = [name for name in names if name not in _INDEX]
    if unknown:
        raise CalibrationError(f"no calibration parameter {unknown[0]!r}; one of {', '.join(_INDEX)}")
    return [_INDEX[name] for name in names]


def project_with_calibration(
    geometry: StationGeometry, point_runway_m: FloatArray, pan_rad: float, tilt_rad: float
) -> CalibratedProjection | None:
    """Return pixel and derivatives for a runway point (3,), or None if it is not in front of the camera.

    The pixel may be outside the image.
    """
    pixel, jacobian, calibration = np.empty(2), np.empty((2, 5)), np.empty((2, CALIBRATION_SIZE))
    point = np.asarray(point_runway_m, dtype=np.float64)
    depth = project_calibration(geometry.packed, point, pan_rad, tilt_rad, pixel, jacobian, calibration)
    if depth < kernels.MIN_DEPTH_M:
        return None
    return CalibratedProjection(pixel=pixel, jacobian=jacobian, calibration_jacobian=calibration, depth_m=depth)


def perturbed_packed(packed: FloatArray, change: FloatArray) -> FloatArray:
    """Return the packed station with a change (21,) of its calibration, in the order of `CALIBRATION_PARAMETERS`."""
    changed = packed.copy()
    for turn, matrix in _TURNED:
        # most changes are of one of the two alone
        if change[turn].any():
            changed[matrix] = (rotation_from_vector(change[turn]) @ packed[matrix].reshape(3, 3)).ravel()
    for here, there in _PACKED:
        changed[there] += change[here]
    return changed


def perturbed_station(geometry: StationGeometry, change: FloatArray) -> StationGeometry:
    """Return the station with a change (21,) of its calibration, in the order of `CALIBRATION_PARAMETERS`.

    Raises `CalibrationError` where a focal length would not stay positive.
    """
    packed = perturbed_packed(geometry.packed, change)
    if not np.all(packed[24:26] > 0.0):
        raise CalibrationError(f"station {geometry.name}: a focal length of {packed[24:26].min():.6g} px")
    changed = StationGeometry(
        name=geometry.name,
        ptu_position_m=packed[9:12],
        runway_from_base_wxyz=wxyz_from_matrix(packed[0:9].reshape(3, 3)),
        head_from_camera_wxyz=wxyz_from_matrix(packed[12:21].reshape(3, 3)),
        camera_in_head_m=packed[21:24],
        lens=Lens(
            image_size_px=geometry.lens.image_size_px,
            focal_px=packed[24:26],
            principal_point_px=packed[26:28],
            distortion=packed[28:33],
        ),
        lean_rad=geometry.lean_rad,
    )
    # the radius limit stays where it was, so that the pixel is a smooth function of the change
    changed.packed = packed
    return changed
