"""Result of the search for two edges in one picture, the same for all search methods."""

from dataclasses import dataclass

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.marks import Change, Marks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundEdges:
    """Both edges in a picture.

    Attributes
    ----------
    crossings_px, covariance_px2 : where they cross the two rows that were used, (4,) and (4, 4).
    contrast : (2,) across both edges, 0 to 1.
    agreement : 1 where inside differs from outside by the same colours at both edges, all along them; down to −1.
    marks : what is beside the edges, where a profile was taken.
    unsettled_px2 : (4, 4) second moment of where marks that are not told apart would put them; None without a profile.
    change : whether the profile brought other lines than those that were followed; then the prior was not heeded.
    """

    crossings_px: FloatArray
    covariance_px2: FloatArray
    contrast: FloatArray
    agreement: float
    marks: Marks | None = None
    unsettled_px2: FloatArray | None = None
    change: Change = Change.NONE
