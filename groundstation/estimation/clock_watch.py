"""Which clocks can be learnt now: those whose effect on the pixel stands out of what is not known of the motion.

A clock that is off by δ moves the pixel by δ·ṁ, and the filter knows ṁ only as well as it knows the rates of the head and
the velocity of the target. Two things make it learn δ from noise, and be sure of it:

- ṁ is hardly more than its own error, as in a head that holds the target still in the picture;
- the head does not turn as its model says. One that is smoother has rates that are mostly the encoder's noise; one
  that is quicker has rates that lag. Either shows in the innovations of the readings.

While it is so the clock is considered, not estimated: value and variance stay, and what it may do is in the covariance.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

# ṁ is at least so many sigmas of its own error; noise alone does that in three of a thousand pixels
STIRRED_SIGMA = 4.0
# mean innovation square of readings, per degree of freedom, over so many of them …
_READINGS = 100
# … is within this factor of 1: three and a half sigmas
_AS_MODELLED = 1.28


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockWatch:
    """What is known of how well clocks can be told; a new one for each pixel and reading.

    Attributes
    ----------
    clocks : places in the state of each station's clocks.
    hidden : those that their station's newest pixel could not tell from noise.
    squares : of each station, mean innovation square of its readings per degree of freedom, at first that of no reading.
    """

    clocks: Mapping[str, tuple[int, ...]]
    hidden: frozenset[int]
    squares: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, clocks: Mapping[str, Iterable[int]]) -> "ClockWatch":
        """Return the watch before the first pixel, which could have told of a clock."""
        places = {name: tuple(own) for name, own in clocks.items()}
        return cls(clocks=places, hidden=frozenset(k for own in places.values() for k in own))

    def seen(self, station: str, hidden: Iterable[int]) -> "ClockWatch":
        """Return the watch after a pixel that left these of its station's clocks hidden."""
        return replace(self, hidden=self.hidden.difference(self.clocks[station]).union(hidden))

    def read(self, station: str, square: float) -> "ClockWatch":
        """Return the watch after a reading with this innovation square per degree of freedom."""
        before = self.squares.get(station, 1.0)
        return replace(self, squares={**self.squares, station: before + (square - before) / _READINGS})

    def quiet(self) -> list[int]:
        """Return the places of the clocks of which nothing is to be learnt now."""
        found = set(self.hidden)
        for station, square in self.squares.items():
            if not 1.0 / _AS_MODELLED < square < _AS_MODELLED:
                found.update(self.clocks[station])
        return sorted(found)
