"""Calibration errors: the difference between the true rig and the stated rig."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, wxyz_from_matrix
from groundstation.rig.rig import ClockModel, Rig, Station
from groundstation.simulation.parameter_checks import require, require_finite, require_shape

_VECTORS = ("mount_rad", "boresight_rad", "position_m", "camera_in_head_m")
_NUMBERS = ("focal_share", "ptu_offset_s", "ptu_drift_ppm", "camera_offset_s", "camera_drift_ppm")


def _zeros() -> FloatArray:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationErrors:
    """By how much two descriptions of one station differ; rotations are small-angle vectors (x, y, z).

    Attributes
    ----------
    mount_rad : (3,) in the runway frame, runway_from_base' = Exp(mount) · runway_from_base: x tilt, y roll, z pan.
    boresight_rad : (3,) in the head frame, head_from_camera' = Exp(boresight) · head_from_camera: x tilt, y roll,
        z pan of the camera on its head.
    position_m : (3,) added to ``ptu_position``, runway frame.
    camera_in_head_m : (3,) added to the lever arm, head frame.
    focal_share : both focal lengths are multiplied by 1 + this.
    ptu_offset_s, ptu_drift_ppm : added to the PTU's clock model (t_session = t_device + offset + drift · t_device).
    camera_offset_s, camera_drift_ppm : added to the camera's.
    """

    mount_rad: FloatArray = field(default_factory=_zeros)
    boresight_rad: FloatArray = field(default_factory=_zeros)
    position_m: FloatArray = field(default_factory=_zeros)
    camera_in_head_m: FloatArray = field(default_factory=_zeros)
    focal_share: float = 0.0
    ptu_offset_s: float = 0.0
    ptu_drift_ppm: float = 0.0
    camera_offset_s: float = 0.0
    camera_drift_ppm: float = 0.0

    def __post_init__(self) -> None:
        for name in _VECTORS:
            require_shape(f"StationErrors: {name}", np.asarray(getattr(self, name), dtype=np.float64), (3,))
        for name in _NUMBERS:
            require_finite(f"StationErrors: {name}", getattr(self, name))
        require(self.focal_share > -1, "StationErrors: focal_share", got=self.focal_share, wanted="above -1")


def perturbed(rig: Rig, errors: Mapping[str, StationErrors]) -> Rig:
    """Return a rig that differs from ``rig`` by ``errors``, by station name; the others stay.

    Either of a scenario's two rigs may be the perturbed one: stated = perturbed(true), or true =
    perturbed(stated) where the user's files are to remain unchanged.
    """
    for name in errors:
        require(
            name in rig.names, "perturbed: errors", got=f"station {name!r}", wanted="one of " + ", ".join(rig.names)
        )
    stations = tuple(_perturbed(s, errors[s.name]) if s.name in errors else s for s in rig.stations)
    return replace(rig, stations=stations)


def drawn_errors(
    generator: np.random.Generator, names: Sequence[str], sigma: StationErrors
) -> dict[str, StationErrors]:
    """Draw errors for each station, normal and independent, ``sigma`` holding one sigma of each number."""
    return {
        name: StationErrors(
            **{
                item.name: getattr(sigma, item.name) * generator.normal(size=np.shape(getattr(sigma, item.name)))
                for item in fields(StationErrors)
            }
        )
        for name in names
    }


def _perturbed(station: Station, by: StationErrors) -> Station:
    camera_clock = station.camera_clock
    if by.camera_offset_s or by.camera_drift_ppm:
        camera_clock = _shifted(camera_clock or ClockModel(), by.camera_offset_s, by.camera_drift_ppm)
    return replace(
        station,
        runway_from_base_wxyz=_turned(station.runway_from_base_wxyz, by.mount_rad),
        head_from_camera_wxyz=_turned(station.head_from_camera_wxyz, by.boresight_rad),
        ptu_position_m=station.ptu_position_m + by.position_m,
        camera_in_head_m=station.camera_in_head_m + by.camera_in_head_m,
        lens=replace(station.lens, focal_px=station.lens.focal_px * (1.0 + by.focal_share)),
        ptu_clock=_shifted(station.ptu_clock, by.ptu_offset_s, by.ptu_drift_ppm),
        camera_clock=camera_clock,
    )


def _turned(wxyz: FloatArray, by_rad: FloatArray) -> FloatArray:
    """Return Exp(by) · q as a unit Hamilton quaternion; q itself where nothing turns."""
    if not np.any(by_rad):
        return wxyz
    return wxyz_from_matrix(Rotation.from_rotvec(by_rad).as_matrix() @ matrix_from_wxyz(wxyz))


def _shifted(clock: ClockModel, offset_s: float, drift_ppm: float) -> ClockModel:
    return replace(clock, offset_s=clock.offset_s + offset_s, drift_ppm=clock.drift_ppm + drift_ppm)
