"""A provisional track, which is restarted if its first pixels turn out to be outliers.

The initial covariance may be tens of metres wide. Any first pixel then passes the gate, a gross outlier as well, and
the overconfident filter rejects all correct pixels after it. While a track is provisional, the filter therefore keeps
its initial state and counts the pixels: if several consecutive ones are rejected and more were rejected than accepted,
the accepted ones were the outliers (gross outliers are the exception), and the track is restarted from its initial
state.
"""

from dataclasses import dataclass, replace

from groundstation.arrays import FloatArray

_REFUSED_IN_SUCCESSION = 4
_CONFIRMED_AFTER = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProvisionalTrack:
    """Initial state of a track at ``t_s``, and the counts of its pixels.

    Attributes
    ----------
    mean : (6,) position in m and velocity in m/s, runway frame; ``covariance`` (6, 6).
    triangulated : whether the mean also contains the errors of the rig.
    accepted, refused : pixels since the start; ``consecutive_refusals`` those since the newest accepted one.
    """

    t_s: float
    mean: FloatArray
    covariance: FloatArray
    triangulated: bool
    accepted: int = 0
    refused: int = 0
    consecutive_refusals: int = 0

    def after(self, *, accepted: bool) -> "ProvisionalTrack":
        """Return the track with one more pixel counted."""
        if accepted:
            return replace(self, accepted=self.accepted + 1, consecutive_refusals=0)
        return replace(self, refused=self.refused + 1, consecutive_refusals=self.consecutive_refusals + 1)

    @property
    def confirmed(self) -> bool:
        """Whether enough pixels were accepted to end the provisional phase."""
        return self.accepted >= _CONFIRMED_AFTER and self.accepted > self.refused

    @property
    def refuted(self) -> bool:
        """Whether the accepted pixels must have been outliers."""
        return self.consecutive_refusals >= _REFUSED_IN_SUCCESSION and self.refused > self.accepted > 0

    def restarted(self) -> "ProvisionalTrack":
        """Return the track at its initial state, without pixels."""
        return replace(self, accepted=0, refused=0, consecutive_refusals=0)
