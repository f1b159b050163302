"""Angles that are whole numbers throughout: an encoder's counts in a table that should be in degrees.

Heads read in steps of thousandths to tenths of a degree. A table in which each reading of a head that turns is a whole
number, and that takes many different ones, is in another unit: positions of a pan-tilt unit, counts of a turn, or
hundredths of a degree. Some heads are read in whole degrees all the same: only of one whose stated step is finer are
whole numbers a contradiction, and not if the pictures move as its readings say.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from groundstation.messages import Event, PtuSample

# a head that is sent to whole degrees takes fewer of them, each for a while
_LEAST_READINGS, _LEAST_VALUES = 50, 20
# from such a step on a head could have whole degrees
_COARSE_STEP_DEG = 0.5
# readings have gone through radians in double precision
_WHOLE_DEG = 1e-6


@dataclass(slots=True)
class _Readings:
    """What has been read of one head: the number of readings, their extremes, deg, and the different ones."""

    count: int = 0
    low_deg: float = math.inf
    high_deg: float = -math.inf
    whole: bool = True
    values: set[tuple[int, int]] = field(default_factory=set)

    def add(self, pan_deg: float, tilt_deg: float) -> None:
        """Add a reading; one that is no number is none."""
        if not (math.isfinite(pan_deg) and math.isfinite(tilt_deg)):
            return
        self.count += 1
        self.low_deg = min(self.low_deg, pan_deg, tilt_deg)
        self.high_deg = max(self.high_deg, pan_deg, tilt_deg)
        pan, tilt = round(pan_deg), round(tilt_deg)
        self.whole = max(abs(pan_deg - pan), abs(tilt_deg - tilt)) <= _WHOLE_DEG
        if len(self.values) < _LEAST_VALUES:
            self.values.add((pan, tilt))


class EncoderCountsMonitor:
    """Looks whether the readings of heads are whole numbers.

    ``steps_rad`` are the resolutions of those that turn, by name; 0 where none is stated.
    """

    def __init__(self, steps_rad: Mapping[str, float]) -> None:
        self._steps_deg = {name: math.degrees(step) for name, step in steps_rad.items()}
        self._readings = {name: _Readings() for name in steps_rad}

    def watched(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, and take the readings from them."""
        for event in events:
            if isinstance(event, PtuSample):
                readings = self._readings.get(event.station)
                # one reading that is none ends it
                if readings is not None and readings.whole:
                    readings.add(math.degrees(event.pan_rad), math.degrees(event.tilt_rad))
            yield event

    def line(self, confirmed: Callable[[str], bool] = lambda name: False) -> str | None:
        """Return in a line whose readings are whole numbers, where the rig states finer steps; None if no head's are.

        ``confirmed`` returns whether something else says that a station's readings are degrees.
        """
        told = [name for name, read in self._readings.items() if self._are_counts(name, read) and not confirmed(name)]
        if not told:
            return None
        low = min(self._readings[name].low_deg for name in told)
        high = max(self._readings[name].high_deg for name in told)
        step_deg = min(self._steps_deg[name] for name in told)
        return (
            f"all angles of {' and '.join(told)} are whole numbers, {low:.0f} to {high:.0f}, where degrees are wanted: "
            f"are they an encoder's counts, or hundredths of degrees? With one ptu_resolution_deg of the rig, "
            f"{step_deg:g}, for each they would be {low * step_deg:.4g} to {high * step_deg:.4g} deg"
        )

    def _are_counts(self, name: str, readings: _Readings) -> bool:
        return (
            readings.whole
            and readings.count >= _LEAST_READINGS
            and len(readings.values) >= _LEAST_VALUES
            and 0.0 < self._steps_deg[name] < _COARSE_STEP_DEG
        )
