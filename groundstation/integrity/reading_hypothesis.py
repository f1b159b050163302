"""Hypotheses of how the readings of a pan-tilt head came to be stored: right, or with one of the usual faults."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray

_RADIANS = 180.0 / math.pi
# a gradian in degrees
GRADIAN_DEG = 0.9
_LAGS_S = np.arange(-5.0, 5.01, 0.05)
_LEAST_LAG_S = 0.15
# sign and offset in rad that make an angle from there one above the horizon
_TILT_FROM: dict[str | None, tuple[int, float]] = {"zenith": (-1, math.pi / 2.0), "nadir": (1, -math.pi / 2.0)}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingHypothesis:
    """A hypothesis of how a station's readings came to be stored; the default is that they are right.

    Attributes
    ----------
    source : the station whose head they are of; None for the own.
    exchanged : pan and tilt are exchanged.
    pan_sign, tilt_sign : 1 or −1.
    unit : factor that makes them what they should be.
    lag_s : to be added to their times.
    focal_factor : ratio of the true focal length to the stated one.
    tilt_off_rad : to be added to tilt.
    pan_off_rad : the least that has to be added to pan.
    tilt_from : "zenith" or "nadir", if tilt is the angle from there; None for that above the horizon.
    """

    source: str | None = None
    exchanged: bool = False
    pan_sign: int = 1
    tilt_sign: int = 1
    unit: float = 1.0
    lag_s: float = 0.0
    focal_factor: float = 1.0
    tilt_off_rad: float = 0.0
    pan_off_rad: float = 0.0
    tilt_from: str | None = None

    def angles(self, readings: FloatArray) -> FloatArray:
        """Return pan and tilt (n, 2) rad that follow from readings (n, 2) rad."""
        ordered = readings[:, ::-1] if self.exchanged else readings
        tilt_sign, tilt_off_rad = _TILT_FROM.get(self.tilt_from, (self.tilt_sign, self.tilt_off_rad))
        signs, offsets = np.array([self.pan_sign, tilt_sign]), np.array([self.pan_off_rad, tilt_off_rad])
        return np.asarray(ordered * self.unit * signs + offsets)

    @property
    def axes_changed(self) -> bool:
        """Whether more than one of exchange and signs differs: rarely a fault of the readings alone."""
        return self.exchanged + (self.pan_sign < 0) + (self.tilt_sign < 0) > 1

    def kind(self) -> "ReadingHypothesis":
        """Return the kind of fault: the hypothesis without the amounts of a lag, a focal length and of offsets."""
        return replace(
            self,
            lag_s=math.copysign(bool(self.lag_s), self.lag_s),
            focal_factor=float(self.focal_factor != 1.0),
            tilt_off_rad=float(self.tilt_off_rad != 0.0),
            pan_off_rad=float(self.pan_off_rad != 0.0),
        )

    def words(self) -> str:
        """Return what would have to be changed, for a message: "with …"."""
        changes = []
        if self.source is not None:
            changes.append(f"the angles of station {self.source}")
        if self.exchanged:
            changes.append("pan and tilt exchanged")
        if self.pan_sign < 0:
            changes.append("pan reversed in sign")
        if self.tilt_sign < 0:
            changes.append("tilt reversed in sign")
        if self.tilt_from is not None:
            changes.append(f"tilt counted from the {self.tilt_from}, where that above the horizon is stated")
        if self.unit > 1.0:
            changes.append("angles in radians, where degrees are stated")
        if self.unit < 1.0:
            changes.append("angles that were converted to degrees twice")
        if self.lag_s:
            direction = "earlier" if self.lag_s < 0 else "later"
            changes.append(f"readings {abs(self.lag_s):.2f} s {direction}")
        if self.focal_factor != 1.0:
            changes.append(f"a focal length {self.focal_factor:.3g} times the stated one")
        if self.tilt_off_rad:
            direction = "lower" if self.tilt_off_rad < 0 else "higher"
            changes.append(f"a tilt {abs(math.degrees(self.tilt_off_rad)):.1f}° {direction}")
        if self.pan_off_rad:
            direction = "lower" if self.pan_off_rad < 0 else "higher"
            changes.append(f"a pan at least {abs(math.degrees(self.pan_off_rad)):.1f}° {direction}")
        return " and ".join(changes)


RIGHT = ReadingHypothesis()


def axis_hypotheses(source: str | None = None) -> Iterator[ReadingHypothesis]:
    """Yield the exchanges and signs of the two axes, none of them first."""
    for exchanged, pan_sign, tilt_sign in itertools.product((False, True), (1, -1), (1, -1)):
        yield ReadingHypothesis(source=source, exchanged=exchanged, pan_sign=pan_sign, tilt_sign=tilt_sign)


def zero_hypotheses() -> Iterator[ReadingHypothesis]:
    """Yield tilts that are counted from elsewhere than the horizon, with pan of either sign."""
    for tilt_from, pan_sign in itertools.product(("zenith", "nadir"), (1, -1)):
        yield ReadingHypothesis(tilt_from=tilt_from, pan_sign=pan_sign)


def unit_hypotheses() -> Iterator[ReadingHypothesis]:
    """Yield wrong units: radians stored as degrees, and degrees converted once too often."""
    yield ReadingHypothesis(unit=_RADIANS)
    yield ReadingHypothesis(unit=1.0 / _RADIANS)


def lag_hypotheses() -> Iterator[ReadingHypothesis]:
    """Yield times that are off by up to 5 s, the least first."""
    for lag_s in sorted(_LAGS_S, key=abs):
        if abs(lag_s) >= _LEAST_LAG_S:
            yield ReadingHypothesis(lag_s=round(float(lag_s), 3))


def station_hypotheses(others: Sequence[str]) -> Iterator[ReadingHypothesis]:
    """Yield all faults of one station's readings; ``others`` are the other stations that turn."""
    for source in (None, *others):
        yield from axis_hypotheses(source)
    yield from zero_hypotheses()
    yield from unit_hypotheses()
    yield from lag_hypotheses()
