"""A track that is young, and whether what it was made of was wrong.

A start may be tens of metres wide. Any first pixel passes its gate then, a gross outlier too, and the filter, sure of
itself at once, refuses all that is right. So as long as a track is young the filter keeps what it was begun with, and
counts: where several pixels in a row are refused, and by now more were refused than taken, it is the few that were
taken that were wrong (gross outliers are the exception). The track is then begun again from what it was begun with.
"""

from dataclasses import dataclass, replace

from groundstation.arrays import FloatArray

_IN_A_ROW = 4
_GROWN_UP = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProvisionalTrack:
    """What a track was begun with at ``t_s``, and how its pixels have fared since.

    Attributes
    ----------
    mean : (6,) position in m and velocity in m/s, runway frame; ``covariance`` (6, 6).
    triangulated : whether the rig's errors are in it besides.
    accepted, refused : pixels since; ``in_a_row`` of these refused ones since the newest that was accepted.
    """

    t_s: float
    mean: FloatArray
    covariance: FloatArray
    triangulated: bool
    accepted: int = 0
    refused: int = 0
    in_a_row: int = 0

    def after(self, *, accepted: bool) -> "ProvisionalTrack":
        """Return it with one more pixel."""
        if accepted:
            return replace(self, accepted=self.accepted + 1, in_a_row=0)
        return replace(self, refused=self.refused + 1, in_a_row=self.in_a_row + 1)

    @property
    def confirmed(self) -> bool:
        """Whether so much agrees with it that it is no longer in question."""
        return self.accepted >= _GROWN_UP and self.accepted > self.refused

    @property
    def refuted(self) -> bool:
        """Whether what was taken must have been wrong."""
        return self.in_a_row >= _IN_A_ROW and self.refused > self.accepted > 0
