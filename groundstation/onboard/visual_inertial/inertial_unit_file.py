"""The inertial unit's log, and the camera file's [imu] section (docs/onboard-fly.md)."""

import math
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
from groundstation.session.time_units import TIME_UNITS_S

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
# between samples; attitude and rate are compared over such windows, of which so many have to agree in their course
_SLOWEST_S = 0.5
_WINDOW_S, _LEAST_WINDOWS, _LEAST_CORRELATION = 1.0, 12, 0.7
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
    attitude_deg: list[tuple[float, float]] = []
    tells_attitude = {"roll_deg", "pitch_deg"} <= set(table.columns)
    for row in table:
        t, *values = (table.number(row, name) for name in SAMPLE_COLUMNS)
        if samples and t <= samples[-1].t_s:
            raise table.fault(row.line, got=f"t_s = {t:g} after {samples[-1].t_s:g}", wanted="growing times")
        numbers: FloatArray = np.array(values)
        if tells_attitude:
            roll, pitch = (table.optional_number(row, name) for name in ("roll_deg", "pitch_deg"))
            attitude_deg.append((math.nan if roll is None else roll, math.nan if pitch is None else pitch))
        samples.append(ImuSample(t_s=t, force_m_s2=numbers[:3], rate_rad_s=np.radians(numbers[3:])))
    if len(samples) < 2:
        raise UnitLogError(str(path), got=f"{len(samples)} samples", wanted="a log of the video's whole time")
    times_s = np.array([sample.t_s for sample in samples])
    _check_times(path, times_s)
    _check_forces(path, np.array([sample.force_m_s2 for sample in samples]))
    if tells_attitude:
        rates_deg_s = np.degrees([sample.rate_rad_s[:2] for sample in samples])
        _check_rates(path, times_s, rates_deg_s, np.array(attitude_deg))
    return samples


def _check_times(path: Path, times_s: FloatArray) -> None:
    """Raise where times (n,) are in another unit: no inertial unit is so slow."""
    apart_s = float(np.median(np.diff(times_s)))
    if len(times_s) >= _LEAST_WINDOWS and apart_s > _SLOWEST_S:
        units = [name for name, in_s in TIME_UNITS_S.items() if apart_s * in_s <= _SLOWEST_S]
        guess = f"; are the times in {units[0]}?" if units else ""
        got = f"samples {apart_s:g} s apart in the median{guess}"
        raise UnitLogError(f"{path}: t_s", got=got, wanted=f"seconds, samples at most {_SLOWEST_S:g} s apart")


def _check_rates(path: Path, times_s: FloatArray, rates_deg_s: FloatArray, attitude_deg: FloatArray) -> None:
    """Raise where rates about x and y (n, 2) and the log's own roll and pitch (n, 2) are in different units.

    Over a second each the attitude changes by the integral of the rate, as long as bank and pitch are small. Windows
    begin at the first sample of each half of one; those that a gap in the log makes longer tell nothing.
    """
    steps = np.diff(times_s)[:, None] * 0.5 * (rates_deg_s[1:] + rates_deg_s[:-1])
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    # not from all halves of the time: a first sample from before a clock was set is decades away
    halves = np.floor((times_s - times_s[0]) / (0.5 * _WINDOW_S))
    begins = np.flatnonzero(np.diff(halves, prepend=-1.0) > 0.0)
    ends = np.minimum(np.searchsorted(times_s, times_s[begins] + _WINDOW_S), len(times_s) - 1)
    took_s = times_s[ends] - times_s[begins]
    whole = (took_s >= _WINDOW_S) & (took_s <= _WINDOW_S + _SLOWEST_S)
    begins, ends = begins[whole], ends[whole]
    changes = np.stack([turned[ends] - turned[begins], attitude_deg[ends] - attitude_deg[begins]])
    for axis, name in enumerate(("x", "y")):
        by_rate, by_attitude = changes[:, np.isfinite(changes[:, :, axis]).all(axis=0), axis]
        if len(by_rate) < _LEAST_WINDOWS or not (np.ptp(by_rate) > 0.0 < np.ptp(by_attitude)):
            continue
        if np.corrcoef(by_rate, by_attitude)[0, 1] < _LEAST_CORRELATION:
            continue
        ratio = float(np.std(by_attitude) / np.std(by_rate))
        for guess, factor in (("are the rates in rad/s?", math.degrees(1.0)), ("is it in rad?", math.radians(1.0))):
            if 1.0 / _MOST_GRAVITIES < ratio / factor < _MOST_GRAVITIES:
                raise UnitLogError(
                    f"{path}: rate_{name}_deg_s",
                    got=f"an attitude that changes {ratio:.3g} times as fast; {guess}",
                    wanted="rates in deg/s and angles in deg",
                )


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
