"""Whether the clocks of a turning station can be learnt now: only while its head turns as its model says.

A clock that is off by δ moves the pixel by δ times a speed, and most of that speed is the head's rate, which is known
by the encoder's readings and the model alone. A head that is smoother than the model has rates that are mostly the
readings' noise, one that is quicker has rates that lag; the filter would learn δ from either, and be sure of it. The
innovations of the readings tell: their mean square is 1 per degree of freedom where the model is right. Where it isn't,
the clocks are considered, not estimated: value and variance stay, and what they may do is in the covariance.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

# the mean square is over so many readings; of so few it says nothing yet …
_READINGS, _FIRST_READINGS = 100, 25
# … and may be this factor from 1: three and a half sigmas of white innovations
_AS_MODELLED = 1.28


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockWatch:
    """What the readings say of the heads' model; a new one for each reading.

    Attributes
    ----------
    clocks : places in the state of each turning station's clocks.
    squares : of each of them, how many readings there were and their mean innovation square per degree of freedom.
    """

    clocks: Mapping[str, tuple[int, ...]]
    squares: Mapping[str, tuple[int, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, clocks: Mapping[str, Iterable[int]]) -> "ClockWatch":
        """Return the watch before the first reading."""
        places = {name: tuple(own) for name, own in clocks.items()}
        return cls(clocks=places, squares={name: (0, 1.0) for name, own in places.items() if own})

    def read(self, station: str, square: float) -> "ClockWatch":
        """Return the watch after a reading with this innovation square per degree of freedom."""
        count, mean = self.squares[station]
        after = (count + 1, mean + (square - mean) / min(count + 1, _READINGS))
        return replace(self, squares={**self.squares, station: after})

    def quiet(self) -> list[int]:
        """Return the places of the clocks of which nothing is to be learnt now."""
        return [
            place
            for station, (count, mean) in self.squares.items()
            if count < _FIRST_READINGS or not 1.0 / _AS_MODELLED < mean < _AS_MODELLED
            for place in self.clocks[station]
        ]
