"""The inertial unit's log, and the camera file's [imu] section (docs/onboard-fly.md)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.files.csv_table import CsvTable
from groundstation.files.toml_table import TomlTable, load_toml
from groundstation.onboard.edges.camera_file import CameraFileError, NoseCamera
from groundstation.onboard.pose.inertial_filter import CameraMount, ImuSample, InertialConfig
from groundstation.onboard.pose.inertial_kernel import GRAVITY_M_S2
from groundstation.onboard.pose.simulated_approach import BODY_FROM_FORWARD_CAMERA
from groundstation.onboard.visual_inertial.config import ApproachConfig

SAMPLE_COLUMNS = (
    *("t_s", "force_x_m_s2", "force_y_m_s2", "force_z_m_s2"),
    *("rate_x_deg_s", "rate_y_deg_s", "rate_z_deg_s"),
)
_NOISES = (
    *("force_noise", "rate_noise", "force_bias_walk", "rate_bias_walk"),
    *("force_bias_sigma", "rate_bias_sigma", "speed_sigma_m_s"),
)
_MOST_GRAVITIES = 1.6
_OTHER_UNITS = {"g": 1.0, "ft/s²": 32.17, "mg": 1000.0, "mm/s²": 9807.0}
_KEYS = frozenset({"camera_in_body_m", *_NOISES})


class UnitLogError(InputError):
    """A log of inertial samples is not usable."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InertialUnit:
    """Parameters of the unit: the camera's mounting relative to it, and its noise."""

    mount: CameraMount
    config: InertialConfig


def load_unit(path: Path, camera: NoseCamera) -> InertialUnit:
    """Read the optional [imu] of a camera file; raises `CameraFileError`."""
    table = TomlTable(load_toml(path, CameraFileError), str(path), CameraFileError)
    usual = ApproachConfig().inertial
    place = np.zeros(3)
    config = usual
    if "imu" in table:
        reported = table.table("imu")
        reported.refuse_unknown(_KEYS)
        place = reported.vector("camera_in_body_m", 3, (0.0, 0.0, 0.0))
        noises = {name: reported.number(name, getattr(usual, name), above=0.0) for name in _NOISES}
        config = InertialConfig(**noises, restart_after=usual.restart_after, coasting_after_s=usual.coasting_after_s)
    body_from_camera = camera.mount.matrix @ BODY_FROM_FORWARD_CAMERA
    return InertialUnit(mount=CameraMount(camera_in_body_m=place, body_from_camera=body_from_camera), config=config)


def read_samples(path: Path) -> list[ImuSample]:
    """Read the inertial samples of a CSV log; raises `InputError`.

    Columns: `SAMPLE_COLUMNS`; specific force and rate in the body's axes forward, right, down.
    """
    table = CsvTable(path, SAMPLE_COLUMNS)
    samples: list[ImuSample] = []
    for row in table:
        t, *values = (table.number(row, name) for name in SAMPLE_COLUMNS)
        if samples and t <= samples[-1].t_s:
            raise table.fault(row.line, got=f"t_s = {t:g} after {samples[-1].t_s:g}", wanted="growing times")
        numbers: FloatArray = np.array(values)
        samples.append(ImuSample(t_s=t, force_m_s2=numbers[:3], rate_rad_s=np.radians(numbers[3:])))
    if len(samples) < 2:
        raise UnitLogError(str(path), got=f"{len(samples)} samples", wanted="a log of the video's whole time")
    _check_forces(path, np.array([sample.force_m_s2 for sample in samples]))
    return samples


def _check_forces(path: Path, forces_m_s2: FloatArray) -> None:
    """Raise where specific forces (n, 3) are in another unit, without gravity, or in other axes."""
    usual = float(np.median(np.linalg.norm(forces_m_s2, axis=1)))
    if not _near(usual, GRAVITY_M_S2):
        guess = next((f"; are they in {name}?" for name, one in _OTHER_UNITS.items() if _near(usual, one)), "")
        if not guess and usual < GRAVITY_M_S2:
            guess = "; has gravity been taken off them?"
        raise UnitLogError(
            f"{path}: force_x_m_s2, force_y_m_s2, force_z_m_s2",
            got=f"forces of {usual:.3g} in the median{guess}",
            wanted=f"specific force in m/s², about {GRAVITY_M_S2:.1f}",
        )
    down = float(np.median(forces_m_s2[:, 2]))
    if down > 0.5 * GRAVITY_M_S2:
        raise UnitLogError(
            f"{path}: force_z_m_s2",
            got=f"{down:+.3g} in the median; are the axes forward, left, up?",
            wanted=f"axes forward, right, down: about {-GRAVITY_M_S2:.1f}",
        )


def _near(value: float, gravity: float) -> bool:
    """Return whether a force is that of gravity in its unit, as far as flight may change it."""
    return 1.0 / _MOST_GRAVITIES < value / gravity < _MOST_GRAVITIES


def has_poses(path: Path) -> bool:
    """Return whether the log also has a navigation's attitude, which gives the initial edges."""
    return {"roll_deg", "pitch_deg", "yaw_deg"} <= set(CsvTable(path, ["t_s"]).columns)
