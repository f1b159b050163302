"""Result of the search for two edges in one picture, the same for all search methods."""

from dataclasses import dataclass

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.markings import Change, Markings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeMeasurement:
    """Both edges in a picture.

    Attributes
    ----------
    crossings_px, covariance_px2 : where they cross the two rows that were used, (4,) and (4, 4).
    stated_px2 : the same covariance as it is stated; None: that one. Errors of pictures are much alike, so that the one
        by which they are weighed has a larger floor.
    contrast : (2,) across both edges, 0 to 1.
    agreement : 1 where inside differs from outside by the same colours at both edges, all along them; down to −1.
    markings : side lines and lamps next to the edges, where a profile was taken.
    unsettled_px2 : (4, 4) second moment of where other layouts of the markings would put them; None
        without a profile.
    change : whether the profile brought other lines than those that were tracked; the prior was not used then.
    evidence : (2,) log-likelihood of each edge over none at all, see `layout_evidence.seen_at_all`; None without a
        profile.
    """

    crossings_px: FloatArray
    covariance_px2: FloatArray
    contrast: FloatArray
    agreement: float
    markings: Markings | None = None
    unsettled_px2: FloatArray | None = None
    change: Change = Change.NONE
    evidence: FloatArray | None = None
    stated_px2: FloatArray | None = None
