"""Decides whether the clock errors of a turning station are observable: only while its PTU follows the motion model.

A clock error δ moves the pixel by δ times a speed, which is mostly the rate of the PTU as estimated from the encoder
readings and the motion model. For a PTU that moves more smoothly than the model, the estimated rate is mostly
measurement noise; for one that moves faster, it lags. Both would give a wrong and overconfident estimate of δ. The
innovations of the readings show either case: their mean square is 1 per degree of freedom if the model is correct.
Otherwise the clock errors are consider parameters: value and variance stay, and the covariance includes their effect.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

# number of readings of the running mean, and minimum number …
_READINGS, _FIRST_READINGS = 100, 25
# … and its tolerance as a factor: three and a half sigmas of white innovations
_AS_MODELLED = 1.28


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockMonitor:
    """Consistency of the encoder innovations of all turning stations; immutable, replaced with each reading.

    Attributes
    ----------
    clocks : indices of the clock errors of each turning station in the state.
    squares : per station, number of readings and their mean squared innovation per degree of freedom.
    """

    clocks: Mapping[str, tuple[int, ...]]
    squares: Mapping[str, tuple[int, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, clocks: Mapping[str, Iterable[int]]) -> "ClockMonitor":
        """Return the monitor before the first reading."""
        places = {name: tuple(own) for name, own in clocks.items()}
        return cls(clocks=places, squares={name: (0, 1.0) for name, own in places.items() if own})

    def read(self, station: str, square: float) -> "ClockMonitor":
        """Return the monitor after a reading with this squared innovation per degree of freedom."""
        count, mean = self.squares[station]
        after = (count + 1, mean + (square - mean) / min(count + 1, _READINGS))
        return replace(self, squares={**self.squares, station: after})

    def quiet(self) -> list[int]:
        """Return the indices of the clock errors that are only considered at present."""
        return [
            place
            for station, (count, mean) in self.squares.items()
            if count < _FIRST_READINGS or not 1.0 / _AS_MODELLED < mean < _AS_MODELLED
            for place in self.clocks[station]
        ]
