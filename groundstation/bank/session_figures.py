"""Figures of one replayed session against its truth: detection, track, consistency, misleading epochs.

Definitions (docs/simulation.md has them in one table). A *visible* frame is one that shows the aircraft by the rules of
`session_truth`. A frame is *hit* by a pixel inside the silhouette or within `HIT_MARGIN_PX` of it, *wrong* by any other
pixel. An epoch is *misleading* where the status is tracking and the error of an axis is beyond `MISLEADING_SIGMAS`
stated sigmas, or beyond `MISLEADING_LIMIT_M` where the stated covariance gives that a probability below 10⁻³.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from groundstation.arrays import FloatArray, MaskArray
from groundstation.bank.frame_outcomes import FrameOutcome, frame_outcomes
from groundstation.bank.session_truth import SessionTruth
from groundstation.evaluation.collector import TRACK_STATUSES
from groundstation.evaluation.evaluate import Evaluation
from groundstation.messages import TrackStatus

MISLEADING_SIGMAS = 5.0
MISLEADING_LIMIT_M = (3.0, 15.0, 1.5)
_MISLEADING_PROBABILITY = 1e-3
# an axis whose sigma is below its limit divided by this gives an error beyond the limit less than that probability
_LIMIT_SIGMAS = float(norm.isf(0.5 * _MISLEADING_PROBABILITY))
_TRACKING = TRACK_STATUSES.index(TrackStatus.TRACKING)
# ranges y of the errors that the tables quote, as everywhere in the results
RANGE_M = (100.0, 250.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFigures:
    """Figures of one session; what does not exist in it is None.

    Attributes
    ----------
    frames : frames delivered that have any part of the aircraft in the picture.
    visible_frames : of these, how many show it by the rules; the rest is excluded.
    hit, wrong : number of visible frames hit and of all frames (with the aircraft or without) with a wrong pixel.
    hit_initial : of the frames hit, those whose pixel was only known once the target was found.
    wrong_visible : number of visible frames with a wrong pixel.
    time_to_track_s : from the first pair visible to two cameras to the status tracking; None without tracking.
    seen_epochs : epochs visible to two cameras, from the first to the last.
    due_epochs : epochs from the first with the status tracking to the last visible to two cameras.
    covered_epochs : of these, epochs with an estimate.
    tracking_epochs, misleading_epochs : epochs with the status tracking and a known truth; those that mislead.
    losses, returned : number of track losses while visible to two cameras; number of re-acquisitions.
    return_s_max, return_s_median : time from the loss to tracking again, over the re-acquisitions.
    rmse_x_m … rmse_z_m : of tracking epochs; near_… for y in `RANGE_M`.
    over_bound_x … over_bound_z : root mean square error over the track's Cramér-Rao bound.
    nees_sum, nees_count : sum of NEES over tracking epochs, each of 3 degrees of freedom.
    nis_sum, nis_dof : sum of the innovations' squares of accepted pixels, and their degrees of freedom.
    """

    frames: int
    visible_frames: int
    hit: int
    hit_initial: int
    wrong: int
    wrong_visible: int
    seen_epochs: int
    time_to_track_s: float | None
    due_epochs: int
    covered_epochs: int
    tracking_epochs: int
    misleading_epochs: int
    losses: int
    returned: int
    return_s_median: float | None
    return_s_max: float | None
    rmse_x_m: float | None
    rmse_y_m: float | None
    rmse_z_m: float | None
    near_rmse_x_m: float | None
    near_rmse_y_m: float | None
    near_rmse_z_m: float | None
    over_bound_x: float | None
    over_bound_y: float | None
    over_bound_z: float | None
    nees_sum: float
    nees_count: int
    nis_sum: float
    nis_dof: int

    def to_row(self) -> dict[str, float | int | None]:
        """Return the figures by name, with the shares that tables show."""
        row: dict[str, float | int | None] = {f.name: getattr(self, f.name) for f in fields(self)}
        row["hit_share"] = _share(self.hit, self.visible_frames)
        row["wrong_share"] = _share(self.wrong_visible, self.visible_frames)
        row["excluded_share"] = _share(self.frames - self.visible_frames, self.frames)
        row["coverage"] = _share(self.covered_epochs, self.due_epochs)
        row["anees"] = self.nees_sum / (3.0 * self.nees_count) if self.nees_count else None
        row["nis"] = self.nis_sum / self.nis_dof if self.nis_dof else None
        row["misleading_share"] = _share(self.misleading_epochs, self.tracking_epochs)
        return row


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def session_figures(
    truth: SessionTruth, evaluation: Evaluation, outcomes: Sequence[FrameOutcome] | None = None
) -> SessionFigures:
    """Return the figures of a replay against the session's truth; ``outcomes`` where they are known already.

    Raises `KeyError` where the evaluation had no truth to compare with.
    """
    visible = truth.visible_pairs()
    pixels = _pixel_figures(frame_outcomes(truth, evaluation) if outcomes is None else outcomes)
    return SessionFigures(
        **pixels, **_track_figures(evaluation, visible), **_error_figures(evaluation), **_nis(evaluation)
    )


def _pixel_figures(outcomes: Sequence[FrameOutcome]) -> dict[str, int]:
    """Count the frames that show the aircraft, and the replay's hits, misses and wrong points."""
    return {
        "frames": sum(outcome.present for outcome in outcomes),
        "visible_frames": sum(outcome.visible for outcome in outcomes),
        "hit": sum(outcome.visible and outcome.hit for outcome in outcomes),
        "hit_initial": sum(outcome.visible and outcome.hit and outcome.initial for outcome in outcomes),
        "wrong": sum(outcome.wrong for outcome in outcomes),
        "wrong_visible": sum(outcome.visible and outcome.wrong for outcome in outcomes),
    }


def _track_figures(e: Evaluation, visible: Mapping[str, MaskArray]) -> dict[str, Any]:
    """Return the figures of status and estimates over the epochs visible to two cameras."""
    pairs = e.epochs["epoch"].astype(int)
    seen_by_two = np.sum([mask[pairs] for mask in visible.values()], axis=0) >= 2
    tracking = e.epochs["status"] == _TRACKING
    estimated = np.isfinite(e.epochs["position_m"]).all(axis=1)
    t_s = e.epochs["t_s"]
    figures: dict[str, Any] = {"seen_epochs": int(seen_by_two.sum()), "time_to_track_s": None}
    figures |= dict.fromkeys(("due_epochs", "covered_epochs", "losses", "returned"), 0)
    figures |= {"return_s_median": None, "return_s_max": None}
    if not seen_by_two.any():
        return figures
    first, last = np.flatnonzero(seen_by_two)[[0, -1]]
    begun = np.flatnonzero(tracking[first:]) + first
    if begun.size == 0 or begun[0] > last:
        figures["due_epochs"] = int(last - first + 1)
        return figures
    start = int(begun[0])
    figures["time_to_track_s"] = float(t_s[start] - t_s[first])
    figures["due_epochs"] = int(last - start + 1)
    figures["covered_epochs"] = int(estimated[start : last + 1].sum())
    span = slice(start, int(last) + 1)
    losses, returns = _losses(t_s[span], tracking[span], seen_by_two[span])
    figures |= {"losses": losses, "returned": len(returns)}
    if returns:
        figures |= {"return_s_median": float(np.median(returns)), "return_s_max": max(returns)}
    return figures


def _losses(t_s: FloatArray, tracking: MaskArray, seen_by_two: MaskArray) -> tuple[int, list[float]]:
    """Return how often tracking was missing while two cameras saw the aircraft, and the times of each return.

    The time of a re-acquisition starts when tracking has ended and two cameras see the aircraft.
    """
    losses, returns, since = 0, [], math.nan
    for t, tracks, seen in zip(t_s.tolist(), tracking.tolist(), seen_by_two.tolist(), strict=True):
        if tracks:
            if not math.isnan(since):
                returns.append(t - since)
            since = math.nan
        elif seen and math.isnan(since):
            losses, since = losses + 1, t
    return losses, returns


def _error_figures(e: Evaluation) -> dict[str, Any]:
    """Return errors and consistency of the epochs with the status tracking."""
    c = e.comparisons["truth"]
    judged = c.ekf_known & (e.epochs["status"] == _TRACKING)
    error, covariance = c.ekf_error_m[judged], c.covariance_m2[judged]
    sigma = np.sqrt(np.einsum("nii->ni", covariance))
    size = np.abs(error)
    limit = np.array(MISLEADING_LIMIT_M)
    misleading = (size > MISLEADING_SIGMAS * sigma) | ((size > limit) & (limit > _LIMIT_SIGMAS * sigma))
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])
    y = c.reference_m[judged, 1]
    near = (y >= RANGE_M[0]) & (y < RANGE_M[1])
    bounded = judged & e.bounds.track_known
    ratio = _ratio(c.ekf_error_m[bounded], e.bounds.track_sigma_m[bounded])
    return {
        "tracking_epochs": int(judged.sum()),
        "misleading_epochs": int(misleading.any(axis=1).sum()),
        **_by_axis("rmse_{}_m", _rms(error)),
        **_by_axis("near_rmse_{}_m", _rms(error[near])),
        **_by_axis("over_bound_{}", ratio),
        "nees_sum": float(nees.sum()),
        "nees_count": len(nees),
    }


def _nis(e: Evaluation) -> dict[str, Any]:
    rows = e.cameras[np.isfinite(e.cameras["nis"]) & e.cameras["accepted"]]
    return {"nis_sum": float(rows["nis"].astype(np.float64).sum()), "nis_dof": int(rows["dof"].astype(int).sum())}


def _rms(values: NDArray[Any]) -> FloatArray | None:
    return np.sqrt((values**2).mean(axis=0)) if len(values) else None


def _ratio(error: FloatArray, sigma: FloatArray) -> FloatArray | None:
    above, below = _rms(error), _rms(sigma)
    return None if above is None or below is None else above / below


def _by_axis(name: str, values: FloatArray | None) -> dict[str, float | None]:
    return {name.format(axis): None if values is None else float(values[k]) for k, axis in enumerate("xyz")}
