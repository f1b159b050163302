"""Comparison of a replay's reported pixels with the true silhouettes, frame by frame."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.bank.session_truth import SessionTruth, distance_outside_px
from groundstation.evaluation.collector import DETECTION_STATUSES
from groundstation.evaluation.evaluate import Evaluation
from groundstation.messages import DetectionStatus

HIT_MARGIN_PX = 4.0
_INITIAL = DETECTION_STATUSES.index(DetectionStatus.INITIAL)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameOutcome:
    """One delivered frame.

    Attributes
    ----------
    station, pair : which frame.
    present : whether any part of the aircraft is in the picture.
    visible : whether it shows the aircraft by the rules of `session_truth`.
    pixel_px : the reported target point (2,); None without one.
    outside_px : distance of that point from the silhouette, 0 inside; infinite without a point or a silhouette.
    initial : whether the point was only known once the target was found, in a later frame.
    """

    station: str
    pair: int
    present: bool
    visible: bool
    pixel_px: FloatArray | None
    outside_px: float
    initial: bool = False

    @property
    def hit(self) -> bool:
        """Whether the reported point is inside the silhouette or within `HIT_MARGIN_PX` of it."""
        return self.outside_px <= HIT_MARGIN_PX

    @property
    def wrong(self) -> bool:
        """Whether the reported point is outside the aircraft."""
        return self.pixel_px is not None and not self.hit


def frame_outcomes(truth: SessionTruth, evaluation: Evaluation) -> list[FrameOutcome]:
    """Return the outcome of each delivered frame, by station and pair."""
    known = np.isfinite(evaluation.cameras["pixel"]).all(axis=1)
    reported: dict[tuple[str, int], tuple[FloatArray, bool]] = {
        (evaluation.stations[row["station"]], int(row["epoch"])): (
            row["pixel"].astype(np.float64),
            bool(row["status"] == _INITIAL),
        )
        for row in evaluation.cameras[known]
    }
    outcomes = []
    for station, visible in truth.visible_pairs().items():
        for pair in range(truth.pairs):
            if not truth.taken(station, pair):
                continue
            there = truth.frame(station, pair)
            pixel, initial = reported.get((station, pair), (None, False))
            outside = math.inf
            if there is not None and pixel is not None:
                outside = distance_outside_px(there.silhouette, pixel)
            outcome = FrameOutcome(
                station=station,
                pair=pair,
                present=there is not None,
                visible=bool(visible[pair]),
                pixel_px=pixel,
                outside_px=outside,
                initial=initial,
            )
            outcomes.append(outcome)
    return outcomes
