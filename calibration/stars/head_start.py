"""A head's orientation from solved pictures: base and camera of a first fit, and pictures whose solution is wrong.

A picture that is solved has an attitude. Of all pictures of one head, attitudes and angles must agree with one base and
one mounting of the camera; the few that do not are solved wrongly, whatever the solver says of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.orientation import kabsch
from calibration.stars.night import StarPicture
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_x, rotation_y, rotation_z, wxyz_from_matrix
from groundstation.rig.rig import Station

# scales off by 1 % over 60° of tilt are 0.6°; an attitude by chance is tens of degrees off
AGREEING_RAD = float(np.radians(2.0))
_LEAST_AGREEING = 3
_ROUNDS = 20
_QUARTERS_RAD = tuple(float(np.radians(a)) for a in (0.0, 90.0, 180.0, 270.0))


class StarFitError(GroundstationError):
    """A night's pictures do not determine how a camera sits on its head, or do not fit at all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadStart:
    """The station with base and camera as the pictures have them, and which solved pictures agree, (k,)."""

    station: Station
    agrees: MaskArray


def head_start(
    station: Station, pictures: Sequence[StarPicture], runway_from_camera: Sequence[FloatArray]
) -> HeadStart:
    """Return the start from k solved pictures, each with its attitude (3, 3); raises `StarFitError`."""
    where = f"station {station.name}"
    if len(pictures) < _LEAST_AGREEING:
        got = f"{len(pictures)} picture{'s' * (len(pictures) != 1)} whose stars were recognised"
        raise StarFitError(f"{where}: got {got}; wanted at least {_LEAST_AGREEING}, better 24")
    attitudes = np.array(runway_from_camera)
    heads = np.array([_base_from_head(station, picture) for picture in pictures])
    own = matrix_from_wxyz(station.head_from_camera_wxyz)
    cameras = [own, *(rotation_y(quarter) @ rotation_x(-0.5 * np.pi) for quarter in _QUARTERS_RAD)]
    found = [_agreed(heads, attitudes, camera) for camera in cameras]
    base, camera, off = min(found, key=lambda one: float(np.median(one[2])))
    agrees = off < AGREEING_RAD
    if int(agrees.sum()) < max(_LEAST_AGREEING, len(pictures) // 2):
        got = f"angles that do not follow the stars: {np.degrees(np.median(off)):.1f} deg off"
        wanted = "angles with the signs of docs/conventions.md, each read while its picture was taken"
        raise StarFitError(f"{where}: got {got}; wanted {wanted}")
    turned = replace(
        station,
        runway_from_base_wxyz=wxyz_from_matrix(base),
        head_from_camera_wxyz=wxyz_from_matrix(camera),
    )
    return HeadStart(station=turned, agrees=agrees)


def _base_from_head(station: Station, picture: StarPicture) -> FloatArray:
    pan, tilt = station.ptu_axes.angles(*picture.reading_rad.tolist(), *picture.sense.tolist())
    return rotation_z(pan) @ rotation_y(station.ptu_axes.lean_rad) @ rotation_x(tilt)


def _agreed(heads: FloatArray, attitudes: FloatArray, camera: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return base (3, 3), camera (3, 3) and by how much each attitude (k, 3, 3) misses them, rad.

    Base and camera alternate, each the mean rotation of the pictures that agree best: the nearer half at first.
    """
    share = 0.5
    off = np.zeros(len(heads))
    # the base that most pictures agree with, each picture's own base tried
    each = attitudes @ np.swapaxes(heads @ camera, 1, 2)
    misses = np.array([_angle(each, one) for one in each])
    base = each[int(np.argmin(np.median(misses, axis=1)))]
    for _ in range(_ROUNDS):
        off = _angle(attitudes, base @ heads @ camera)
        near = off <= max(float(np.quantile(off, share)), 1e-9)
        base = _mean_rotation(attitudes[near] @ np.swapaxes(heads[near] @ camera, 1, 2))
        camera = _mean_rotation(np.swapaxes(base @ heads[near], 1, 2) @ attitudes[near])
    return base, camera, _angle(attitudes, base @ heads @ camera)


def _mean_rotation(rotations: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) nearest to several (k, 3, 3) in the sense of least squares."""
    k = len(rotations)
    return kabsch(np.tile(np.eye(3), (k, 1)), np.swapaxes(rotations, 1, 2).reshape(3 * k, 3))


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles (k,) between rotations (k, 3, 3), rad."""
    trace = np.einsum("kij,kij->k", a, np.broadcast_to(b, a.shape))
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))
