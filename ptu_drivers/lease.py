"""What ends motion by rate in the unit itself when its host falls silent: crashed, killed, without power, unplugged."""

import math
from dataclasses import dataclass
from enum import StrEnum

# a rate is renewed a few times in that long; with the braking of a usual unit it stands within 1 s
LEASE_S = 0.5


class LeaseKind(StrEnum):
    """What stops the unit."""

    UNIT_WATCHDOG = "its own watchdog"
    SHORT_MOVES = "short moves"
    """A rate is a chain of moves to targets close ahead, each of which ends by itself."""
    NO_RATES = "no motion by rate"
    """Only moves to positions, which end at their targets."""
    NONE = "nothing"
    """The protocol has nothing: it turns on until a limit of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lease:
    """Remaining motion by rate after the last command or query.

    Attributes
    ----------
    kind : what stops it.
    renewed_s : the time for which it holds its rate after the last renewal, s; infinite where nothing stops it.
    stop_s : until it stands still, s, from its fastest rate; infinite where nothing stops it.
    """

    kind: LeaseKind
    renewed_s: float = math.inf
    stop_s: float = math.inf

    def __str__(self) -> str:
        """Return it in words."""
        if self.kind in (LeaseKind.UNIT_WATCHDOG, LeaseKind.SHORT_MOVES):
            return f"motion by rate ends by {self.kind.value}, at rest within {self.stop_s:.2f} s of the last renewal"
        if self.kind is LeaseKind.NO_RATES:
            return f"{self.kind.value}; a move to a position ends there"
        return f"{self.kind.value} in the unit ends motion by rate: it turns to its own limit"


NO_LEASE = Lease(kind=LeaseKind.NONE)
MOVES_ONLY = Lease(kind=LeaseKind.NO_RATES)
