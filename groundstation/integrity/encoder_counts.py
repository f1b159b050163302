"""Angles that are whole numbers throughout: an encoder's counts in a table that should be in degrees.

Heads read in steps of thousandths to tenths of a degree. A table in which each reading of a head that turns is a whole
number, and that takes many different ones, is in another unit: positions of a pan-tilt unit, counts of a turn, or
hundredths of a degree.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from groundstation.messages import Event, PtuSample

# a head that is sent to whole degrees takes fewer of them, each for a while
_LEAST_READINGS, _LEAST_VALUES = 50, 20
# so coarse a head could have whole degrees
_COARSEST_STEP_DEG = 0.5
# readings have gone through radians in double precision, and through a correction of the axes if there is one
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
        """Add a reading."""
        self.count += 1
        self.low_deg = min(self.low_deg, pan_deg, tilt_deg)
        self.high_deg = max(self.high_deg, pan_deg, tilt_deg)
        pan, tilt = round(pan_deg), round(tilt_deg)
        self.whole = max(abs(pan_deg - pan), abs(tilt_deg - tilt)) <= _WHOLE_DEG
        if len(self.values) < _LEAST_VALUES:
            self.values.add((pan, tilt))


class EncoderCountsMonitor:
    """Looks whether the readings of heads are whole numbers; ``steps_rad`` are the resolutions of those that turn."""

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

    def line(self) -> str | None:
        """Return in a line whose readings are whole numbers; None if no head's are."""
        told = [name for name, readings in self._readings.items() if self._are_counts(name, readings)]
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
            and self._steps_deg[name] <= _COARSEST_STEP_DEG
        )
