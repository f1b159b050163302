"""Specification of drawn stations: place, head, clocks, calibration with its errors, and the DGPS on board."""

import math
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any

from groundstation.simulation.parameter_checks import require

MOST_STATIONS = 4
_ZERO = (0.0, 0.0, 0.0)
_DEG = math.radians(1.0)


class DgpsQuality(StrEnum):
    """Quality of a receiver's fixes: to centimetres, to decimetres, or to metres."""

    RTK = "rtk"
    FLOAT = "float"
    METRE = "metre"


def _check(spec: Any, ranges: dict[str, tuple[float, float]]) -> None:
    """Raise `ScenarioError` unless each named field, a number or a tuple of numbers, is within its range."""
    for name, (low, high) in ranges.items():
        value = getattr(spec, name)
        numbers = value if isinstance(value, tuple) else (value,)
        within = all(math.isfinite(v) and low <= v <= high for v in numbers)
        size = "" if not isinstance(value, tuple) else f"{len(_default(spec, name))} numbers, each "
        complete = not size or len(value) == len(_default(spec, name))
        where = f"{type(spec).__name__}: {name}"
        require(within and complete, where, got=value, wanted=f"{size or 'a number '}from {low:g} to {high:g}")


def _default(spec: Any, name: str) -> Any:
    return next(f.default for f in fields(spec) if f.name == name)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeSpan:
    """A stretch of true session time.

    Attributes
    ----------
    from_s, to_s : its beginning and end.
    """

    from_s: float
    to_s: float

    def __post_init__(self) -> None:
        ordered = math.isfinite(self.from_s) and math.isfinite(self.to_s) and self.to_s > self.from_s
        got = f"{self.from_s:g} to {self.to_s:g} s"
        require(ordered, "TimeSpan", got=got, wanted="an end after the start")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSpec:
    """A device's clock: t_session = t_device + offset + drift · t_device.

    Attributes
    ----------
    offset_s, drift_ppm : what the rig file states.
    error_s, drift_error_ppm : by how much the truth is larger.
    sigma_s, drift_sigma_ppm : one sigma of each of the two errors.
    """

    offset_s: float = 0.0
    drift_ppm: float = 0.0
    error_s: float = 0.0
    drift_error_ppm: float = 0.0
    sigma_s: float = 0.0
    drift_sigma_ppm: float = 0.0

    def __post_init__(self) -> None:
        _check(
            self,
            {
                "offset_s": (-10.0, 10.0),
                "drift_ppm": (-1000.0, 1000.0),
                "error_s": (-1.0, 1.0),
                "drift_error_ppm": (-1000.0, 1000.0),
                "sigma_s": (0.0, 1.0),
                "drift_sigma_ppm": (0.0, 1000.0),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationSpec:
    """By how much a station truly differs from what its rig file states, and what the file states of that.

    Rotations are small-angle vectors about the axes of the frame that is named first; each sigma is that of one
    component, independent of all others.

    Attributes
    ----------
    mount_sigma_rad, mount_error_rad : of runway_from_base, runway frame: x tilt, y roll, z pan.
    boresight_sigma_rad, boresight_error_rad : of head_from_camera, head frame: x tilt, y roll, z pan.
    position_sigma_m, position_error_m : of the pedestal, runway frame.
    focal_sigma_share, focal_error_share : of both focal lengths together, as a share of them.
    aspect_sigma_share, aspect_error_share : of each focal length alone, in addition (u, v).
    principal_point_sigma_px, principal_point_error_px : u, v.
    readout_sigma_s, readout_error_s : of the rolling shutter's time; without one there is none.
    """

    mount_sigma_rad: tuple[float, float, float] = _ZERO
    mount_error_rad: tuple[float, float, float] = _ZERO
    boresight_sigma_rad: tuple[float, float, float] = _ZERO
    boresight_error_rad: tuple[float, float, float] = _ZERO
    position_sigma_m: tuple[float, float, float] = _ZERO
    position_error_m: tuple[float, float, float] = _ZERO
    focal_sigma_share: float = 0.0
    focal_error_share: float = 0.0
    aspect_sigma_share: float = 0.0
    aspect_error_share: tuple[float, float] = (0.0, 0.0)
    principal_point_sigma_px: float = 0.0
    principal_point_error_px: tuple[float, float] = (0.0, 0.0)
    readout_sigma_s: float = 0.0
    readout_error_s: float = 0.0

    def __post_init__(self) -> None:
        _check(
            self,
            {
                "mount_sigma_rad": (0.0, 5.0 * _DEG),
                "mount_error_rad": (-20.0 * _DEG, 20.0 * _DEG),
                "boresight_sigma_rad": (0.0, 5.0 * _DEG),
                "boresight_error_rad": (-20.0 * _DEG, 20.0 * _DEG),
                "position_sigma_m": (0.0, 10.0),
                "position_error_m": (-40.0, 40.0),
                "focal_sigma_share": (0.0, 0.1),
                "focal_error_share": (-0.4, 0.4),
                "aspect_sigma_share": (0.0, 0.02),
                "aspect_error_share": (-0.1, 0.1),
                "principal_point_sigma_px": (0.0, 100.0),
                "principal_point_error_px": (-400.0, 400.0),
                "readout_sigma_s": (0.0, 0.05),
                "readout_error_s": (-0.2, 0.2),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadSpec:
    """A pan-tilt unit: its encoders, its loop, and how it is commanded.

    Attributes
    ----------
    resolution_rad : encoder step; 0 has none.
    encoder_sigma_rad : one sigma of a reading, in addition to the step.
    rate_hz, phase_s : readings are taken at phase + k / rate.
    delay_s, delay_jitter_s : a reading arrives delay + U(0, jitter) later.
    natural_rad_s, damping : of the loop of second order that follows the target.
    command_delay_s : age of the bearing that is followed.
    max_rate_rad_s, max_acceleration_rad_s2 : of each axis.
    backlash_rad : play between motor, where the encoder sits, and head.
    aim_sigma_share, aim_correlation_s : one sigma of the aim's wandering off the target, as a share of half the
        picture's height, and how long it takes.
    late_s : until then the head waits for the target …
    late_pan_share, late_tilt_share : … so far off it, as a share of half the picture's width and height.
    stalls : when the head does not move.
    """

    resolution_rad: float = 0.00625 * _DEG
    encoder_sigma_rad: float = 0.005 * _DEG
    rate_hz: float = 50.0
    phase_s: float = 0.0
    delay_s: float = 0.004
    delay_jitter_s: float = 0.0
    natural_rad_s: float = 15.0
    damping: float = 0.8
    command_delay_s: float = 0.05
    max_rate_rad_s: float = 1.0
    max_acceleration_rad_s2: float = 10.0
    backlash_rad: float = 0.0
    aim_sigma_share: float = 0.0
    aim_correlation_s: float = 1.0
    late_s: float = 0.0
    late_pan_share: float = 0.0
    late_tilt_share: float = 0.0
    stalls: tuple[TimeSpan, ...] = ()

    def __post_init__(self) -> None:
        _check(
            self,
            {
                "resolution_rad": (0.0, 1.0 * _DEG),
                "encoder_sigma_rad": (0.0, 1.0 * _DEG),
                "rate_hz": (1.0, 1000.0),
                "phase_s": (0.0, 1.0),
                "delay_s": (0.0, 1.0),
                "delay_jitter_s": (0.0, 1.0),
                "natural_rad_s": (0.5, 100.0),
                "damping": (0.05, 5.0),
                "command_delay_s": (0.0, 2.0),
                "max_rate_rad_s": (0.01, 20.0),
                "max_acceleration_rad_s2": (0.01, 200.0),
                "backlash_rad": (0.0, 1.0 * _DEG),
                "aim_sigma_share": (0.0, 5.0),
                "aim_correlation_s": (0.1, 60.0),
                "late_s": (0.0, 300.0),
                "late_pan_share": (-50.0, 50.0),
                "late_tilt_share": (-50.0, 50.0),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class StationSpec:
    """One station as it truly is.

    Attributes
    ----------
    name : letters, digits, - and _.
    position_m : intersection of the pan and tilt axes, runway frame.
    mount_rad : true orientation of the base, as a small-angle vector of runway_from_base, runway frame.
    boresight_rad : how the camera truly sits on the head, likewise, head frame.
    camera_in_head_m : lever arm of the camera's centre.
    calibration : what the rig file has of all this.
    head : the pan-tilt unit.
    ptu_clock, camera_clock : the devices' clocks.
    """

    name: str
    position_m: tuple[float, float, float] = (0.0, 0.0, 1.5)
    mount_rad: tuple[float, float, float] = _ZERO
    boresight_rad: tuple[float, float, float] = _ZERO
    camera_in_head_m: tuple[float, float, float] = (0.0, 0.065, 0.046)
    calibration: CalibrationSpec = field(default_factory=CalibrationSpec)
    head: HeadSpec = field(default_factory=HeadSpec)
    ptu_clock: ClockSpec = field(default_factory=ClockSpec)
    camera_clock: ClockSpec = field(default_factory=ClockSpec)

    def __post_init__(self) -> None:
        plain = bool(self.name) and self.name.replace("_", "a").replace("-", "a").isalnum()
        require(plain, "StationSpec: name", got=repr(self.name), wanted="letters, digits, - and _")
        _check(
            self,
            {
                "position_m": (-5000.0, 5000.0),
                "mount_rad": (-20.0 * _DEG, 20.0 * _DEG),
                "boresight_rad": (-20.0 * _DEG, 20.0 * _DEG),
                "camera_in_head_m": (-2.0, 2.0),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class DgpsSpec:
    """The receiver on board.

    Attributes
    ----------
    quality : what kind of fixes it gives.
    rate_hz, phase_s : fixes are taken at phase + k / rate.
    sigma_m : one sigma of each fix for itself, runway frame.
    wander_sigma_m, wander_s : one sigma of the slow error in addition, and its correlation time.
    clock_offset_s : t_dgps = t_session + offset: how late its stamps are.
    antenna_in_body_m : from the nose: x forward, y right, z down.
    gaps : when there are no fixes.
    """

    quality: DgpsQuality = DgpsQuality.RTK
    rate_hz: float = 10.0
    phase_s: float = 0.0
    sigma_m: tuple[float, float, float] = (0.02, 0.02, 0.04)
    wander_sigma_m: tuple[float, float, float] = _ZERO
    wander_s: float = 60.0
    clock_offset_s: float = 0.0
    antenna_in_body_m: tuple[float, float, float] = _ZERO
    gaps: tuple[TimeSpan, ...] = ()

    def __post_init__(self) -> None:
        _check(
            self,
            {
                "rate_hz": (0.1, 100.0),
                "phase_s": (0.0, 10.0),
                "sigma_m": (0.0, 100.0),
                "wander_sigma_m": (0.0, 100.0),
                "wander_s": (0.1, 10_000.0),
                "clock_offset_s": (-10.0, 10.0),
                "antenna_in_body_m": (-50.0, 50.0),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class StationsSpec:
    """The stations of a world.

    Attributes
    ----------
    stations : two to four, names that differ.
    dgps : None carries no receiver.
    """

    stations: tuple[StationSpec, ...]
    dgps: DgpsSpec | None = None

    def __post_init__(self) -> None:
        count = len(self.stations)
        wanted = f"2 to {MOST_STATIONS} stations"
        require(2 <= count <= MOST_STATIONS, "StationsSpec: stations", got=count, wanted=wanted)
        names = [s.name.casefold() for s in self.stations]
        got = ", ".join(s.name for s in self.stations)
        require(len(set(names)) == count, "StationsSpec: stations", got=got, wanted="names that differ")
