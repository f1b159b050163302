"""By how much two clocks differ: each exchange gives bounds, which drift widens and which intersect."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OffsetBounds:
    """The host's clock less a device's is between `low_s` and `high_s`, at `t_s` on either clock."""

    t_s: float
    low_s: float
    high_s: float

    @property
    def middle_s(self) -> float:
        """Return the likeliest offset, s."""
        return 0.5 * (self.low_s + self.high_s)

    @property
    def width_s(self) -> float:
        """Return how far the bounds are apart, s."""
        return self.high_s - self.low_s


def intersection(bounds: Iterable[OffsetBounds], t_s: float, drift: float) -> OffsetBounds | None:
    """Return the intersection of all bounds at `t_s`, or None where they contradict each other.

    Parameters
    ----------
    bounds : one at least. drift : largest relative drift of the clocks, s/s: older bounds are wider.
    """
    low_s, high_s = float("-inf"), float("inf")
    for b in bounds:
        wider_s = drift * abs(t_s - b.t_s)
        low_s, high_s = max(low_s, b.low_s - wider_s), min(high_s, b.high_s + wider_s)
    return OffsetBounds(t_s, low_s, high_s) if low_s <= high_s else None
