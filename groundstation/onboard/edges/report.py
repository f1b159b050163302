"""The edge tracker's report of a frame."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.lines import crossings_at
from groundstation.onboard.edges.seen_marks import SeenMarks

# two pairs are the same lines up to so many px, or that part of their distance in the lower row
_SAME_PX, _SAME_SHARE = 3.0, 0.08


class EdgeStatus(Enum):
    """State of a frame's edges; ``ACQUIRING``: the best of several hypotheses that are still being compared."""

    ACQUIRING = "acquiring"
    TRACKING = "tracking"
    COASTING = "coasting"
    SEARCHING = "searching"


class EdgeMiss(Enum):
    """Why a frame gave no measurement."""

    NONE = "none"
    NO_BAND = "no_band"
    NO_PAIR = "no_pair"
    FAINT = "faint"
    GATED = "gated"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """Both edges in a frame and on the ground.

    Attributes
    ----------
    state : (a, b, c, d) with covariance, threshold frame of the pose that was given; after them, where these are
        estimated, the pose's lasting errors of roll, pitch and height.
    rows_px : upper and lower row (2,) of the search.
    crossings_px, covariance_px2 : of the estimate with these rows, (4,) and (4, 4).
    systematic_px2 : the part of that covariance (4, 4) that more pictures do not average out.
    predicted_px : before the measurement, (4,).
    measured_px : by the picture alone (4,), None without an accepted measurement.
    nis : normalised innovation squared of the measurement, NaN without one.
    marks : side line and lamps next to the edges; None where no profile was taken.
    """

    state: LineState
    rows_px: FloatArray
    crossings_px: FloatArray
    covariance_px2: FloatArray
    systematic_px2: FloatArray
    predicted_px: FloatArray
    measured_px: FloatArray | None
    nis: float
    marks: SeenMarks | None = None

    def are_lines(self, crossings_px: FloatArray, rows_px: FloatArray) -> bool:
        """Return whether they are the lines of the picture with crossings (4,) of rows (2,)."""
        there = crossings_at(self.crossings_px, self.rows_px, rows_px)
        apart = max(_SAME_PX, _SAME_SHARE * float(crossings_px[3] - crossings_px[1]))
        return bool(np.abs(there - crossings_px).max() < apart)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeReport:
    """Result of a frame; ``edges`` is None while searching and where no rows contain runway."""

    status: EdgeStatus
    miss: EdgeMiss
    edges: Edges | None
