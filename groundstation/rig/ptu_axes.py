"""Errors of a pan-tilt head's axes: zero, scale, gear backlash, periodic error, sag, and lean of the tilt axis.

    pan  = reading · (1 + scale) + zero − sense · backlash / 2 + sine · sin(reading) + cosine · (cos(reading) − 1)
    tilt = reading · (1 + scale) + zero − sense · backlash / 2 + sag · (1 − cos(reading))

The sense is +1 or −1 as the axis moved last: the head lags behind its motor. Sine and cosine are the error once per
turn of an encoder that is mounted off centre; the sag is how much the load's weight bends the head down when it is
level, of which cos(tilt) is left. Both vanish at reading zero, where the zeros have them. The lean belongs to the
geometry: base_from_head = Rz(pan) · Ry(lean) · Rx(tilt).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.files.toml_table import TomlTable

# limits beyond any real head; a larger value indicates a wrong unit
MAX_ZERO_DEG = 360.0
MAX_SCALE_PPM = 100_000.0
MAX_LEAN_DEG = 10.0
MAX_BACKLASH_DEG = 5.0
MAX_PERIODIC_DEG = 2.0
MAX_SAG_DEG = 2.0
# the periodic terms change by less than 4 % of a change of the angle: 1e-13 rad after so many rounds
_INVERSE_ROUNDS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class PtuAxes:
    """Errors of a head's axes; all zero for an ideal one. Angles in rad, scales without unit."""

    pan_zero_rad: float = 0.0
    tilt_zero_rad: float = 0.0
    pan_scale: float = 0.0
    tilt_scale: float = 0.0
    lean_rad: float = 0.0
    pan_backlash_rad: float = 0.0
    tilt_backlash_rad: float = 0.0
    pan_sine_rad: float = 0.0
    pan_cosine_rad: float = 0.0
    tilt_sag_rad: float = 0.0

    @property
    def is_ideal_apart_from_lean(self) -> bool:
        """Whether readings equal angles: all errors but the lean are zero."""
        return replace(self, lean_rad=0.0) == IDEAL_AXES

    @property
    def most_turn(self) -> float:
        """The most that an angle changes by, over the change of its reading."""
        periodic = math.hypot(self.pan_sine_rad, self.pan_cosine_rad)
        return 1.0 + max(abs(self.pan_scale) + periodic, abs(self.tilt_scale) + abs(self.tilt_sag_rad))

    def middle_angles(self, pan_rad: FloatArray, tilt_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pan and tilt (…), rad, of readings (…), rad, in the middle of the gears' backlash."""
        periodic = self.pan_sine_rad * np.sin(pan_rad) + self.pan_cosine_rad * (np.cos(pan_rad) - 1.0)
        sag = self.tilt_sag_rad * (1.0 - np.cos(tilt_rad))
        pan = pan_rad * (1.0 + self.pan_scale) + self.pan_zero_rad + periodic
        return pan, tilt_rad * (1.0 + self.tilt_scale) + self.tilt_zero_rad + sag

    def angles(self, pan_rad: float, tilt_rad: float, pan_from: float, tilt_from: float) -> tuple[float, float]:
        """Return pan and tilt, rad, of two readings, rad; the senses are +1, −1 or between (0: not known)."""
        periodic = self.pan_sine_rad * math.sin(pan_rad) + self.pan_cosine_rad * (math.cos(pan_rad) - 1.0)
        sag = self.tilt_sag_rad * (1.0 - math.cos(tilt_rad))
        return (
            pan_rad * (1.0 + self.pan_scale) + self.pan_zero_rad - 0.5 * pan_from * self.pan_backlash_rad + periodic,
            tilt_rad * (1.0 + self.tilt_scale) + self.tilt_zero_rad - 0.5 * tilt_from * self.tilt_backlash_rad + sag,
        )

    def angles_many(self, readings_rad: FloatArray, senses: FloatArray) -> FloatArray:
        """Return pan and tilt (n, 2), rad, of readings (n, 2), rad, and senses (n, 2)."""
        scale = np.array([self.pan_scale, self.tilt_scale])
        zero = np.array([self.pan_zero_rad, self.tilt_zero_rad])
        backlash = np.array([self.pan_backlash_rad, self.tilt_backlash_rad])
        pan, tilt = readings_rad[:, 0], readings_rad[:, 1]
        periodic = self.pan_sine_rad * np.sin(pan) + self.pan_cosine_rad * (np.cos(pan) - 1.0)
        bent = np.column_stack([periodic, self.tilt_sag_rad * (1.0 - np.cos(tilt))])
        return np.asarray(readings_rad * (1.0 + scale) + zero - 0.5 * senses * backlash + bent)

    def readings(self, pan_rad: float, tilt_rad: float, pan_from: float, tilt_from: float) -> tuple[float, float]:
        """Return the readings, rad, at which the head has two angles, rad: the inverse of `angles`."""
        straight_pan = pan_rad - self.pan_zero_rad + 0.5 * pan_from * self.pan_backlash_rad
        straight_tilt = tilt_rad - self.tilt_zero_rad + 0.5 * tilt_from * self.tilt_backlash_rad
        pan, tilt = straight_pan / (1.0 + self.pan_scale), straight_tilt / (1.0 + self.tilt_scale)
        if self.pan_sine_rad == self.pan_cosine_rad == self.tilt_sag_rad == 0.0:
            return pan, tilt
        for _ in range(_INVERSE_ROUNDS):
            periodic = self.pan_sine_rad * math.sin(pan) + self.pan_cosine_rad * (math.cos(pan) - 1.0)
            pan = (straight_pan - periodic) / (1.0 + self.pan_scale)
            tilt = (straight_tilt - self.tilt_sag_rad * (1.0 - math.cos(tilt))) / (1.0 + self.tilt_scale)
        return pan, tilt


IDEAL_AXES = PtuAxes()


class Backlash:
    """Play operator (hysteresis) of one axis: the sense, −1 to 1, of the gear contact.

    On a reversal the axis first crosses its backlash, in which the head stands still, and the sense changes from −1 to
    1 in proportion to the reading. Noise smaller than the backlash has no effect. Before the first motion the sense is
    unknown, 0.
    """

    __slots__ = ("_half", "_head")

    def __init__(self, backlash_rad: float) -> None:
        self._half = 0.5 * backlash_rad
        self._head: float | None = None

    def sense(self, reading_rad: float) -> float:
        """Take the next reading and return the sense after it."""
        if self._half <= 0.0:
            return 0.0
        if self._head is None:
            self._head = reading_rad
        self._head = min(max(self._head, reading_rad - self._half), reading_rad + self._half)
        return (reading_rad - self._head) / self._half


class AxisCorrection:
    """Converts one station's readings, in order of time, to angles."""

    __slots__ = ("_axes", "_ideal", "_pan", "_tilt")

    def __init__(self, axes: PtuAxes) -> None:
        self._axes = axes
        # the readings of an ideal head are returned unchanged, bit for bit
        self._ideal = axes.is_ideal_apart_from_lean
        self._pan, self._tilt = Backlash(axes.pan_backlash_rad), Backlash(axes.tilt_backlash_rad)

    def angles(self, pan_rad: float, tilt_rad: float) -> tuple[float, float]:
        """Return pan and tilt, rad, of the next pair of readings, rad."""
        if self._ideal:
            return pan_rad, tilt_rad
        return self._axes.angles(pan_rad, tilt_rad, self._pan.sense(pan_rad), self._tilt.sense(tilt_rad))


_PPM = 1e-6
_LIMITS = {
    "pan_zero_deg": MAX_ZERO_DEG,
    "tilt_zero_deg": MAX_ZERO_DEG,
    "pan_scale_ppm": MAX_SCALE_PPM,
    "tilt_scale_ppm": MAX_SCALE_PPM,
    "lean_deg": MAX_LEAN_DEG,
    "pan_backlash_deg": MAX_BACKLASH_DEG,
    "tilt_backlash_deg": MAX_BACKLASH_DEG,
    "pan_sine_deg": MAX_PERIODIC_DEG,
    "pan_cosine_deg": MAX_PERIODIC_DEG,
    "tilt_sag_deg": MAX_SAG_DEG,
}
AXES_KEYS = tuple(_LIMITS)


def axes_from_file_units(values: dict[str, float]) -> PtuAxes:
    """Return the axes for keys of `AXES_KEYS` in degrees and ppm; what is left out is zero."""
    given = {_field(key): value * (_PPM if key.endswith("_ppm") else np.radians(1.0)) for key, value in values.items()}
    return PtuAxes(**{name: float(value) for name, value in given.items()})


def axes_in_file_units(axes: PtuAxes) -> dict[str, float]:
    """Return the axes as numbers in degrees and ppm, by `AXES_KEYS`."""
    units = {key: _PPM if key.endswith("_ppm") else np.radians(1.0) for key in AXES_KEYS}
    return {key: float(getattr(axes, _field(key)) / unit) for key, unit in units.items()}


def read_axes(table: TomlTable) -> PtuAxes:
    """Read the table ``ptu_axes`` of a station; raises `RigError` for a key or number that cannot be."""
    table.refuse_unknown(set(AXES_KEYS))
    values = {}
    for key, limit in _LIMITS.items():
        least = 0.0 if "backlash" in key else -limit
        values[key] = table.number(key, 0.0, minimum=least, maximum=limit)
    return axes_from_file_units(values)


def axes_to_toml(axes: PtuAxes) -> str:
    """Return the inline table of rig.toml."""
    numbers = (f"{key} = {value:.12g}" for key, value in axes_in_file_units(axes).items() if value != 0.0)
    return "{ " + ", ".join(numbers) + " }"


def _field(key: str) -> str:
    return key.removesuffix("_deg") + "_rad" if key.endswith("_deg") else key.removesuffix("_ppm")
