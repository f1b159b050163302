"""Figures of a session on tables worked out by hand."""

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest

from groundstation.arrays import MaskArray
from groundstation.bank.session_figures import SessionFigures, session_figures
from groundstation.bank.session_truth import FrameSilhouette, SessionTruth, distance_outside_px
from groundstation.evaluation.bounds import BoundSeries
from groundstation.evaluation.collector import CAMERA_DTYPE, DETECTION_STATUSES, EPOCH_DTYPE, TRACK_STATUSES
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.metrics import Comparison
from groundstation.evaluation.run_description import RunDescription
from groundstation.messages import DetectionStatus, TrackStatus
from groundstation.sources.true_silhouettes import TrueSilhouette

# 20 × 4 px with its upper-left pixel at (100, 50)
SILHOUETTE = TrueSilhouette(x=100, y=50, mask=np.ones((4, 20), dtype=bool))
STATIONS = ("left", "right")
T, C, L = TrackStatus.TRACKING, TrackStatus.COASTING, TrackStatus.LOST


@dataclass
class HandTruth:
    """Truth of sessions written by hand: which frames are visible, and which have nothing in the picture."""

    visible: dict[str, list[bool]]
    absent: set[tuple[str, int]] = field(default_factory=set)
    missing: set[tuple[str, int]] = field(default_factory=set)

    @property
    def pairs(self) -> int:
        return len(self.visible["left"])

    def taken(self, station: str, pair: int) -> bool:
        return (station, pair) not in self.missing

    def frame(self, station: str, pair: int) -> FrameSilhouette | None:
        if (station, pair) in self.absent:
            return None
        return FrameSilhouette(silhouette=SILHOUETTE, visible=self.visible[station][pair])

    def visible_pairs(self) -> dict[str, MaskArray]:
        return {name: np.array(seen) for name, seen in self.visible.items()}


def figures(
    truth: HandTruth,
    statuses: list[TrackStatus],
    *,
    pixels: dict[tuple[str, int], tuple[float, float]] | None = None,
    error_m: Any = 0.0,
    sigma_m: float = 1.0,
    y_m: Any = 150.0,
    initial: tuple[tuple[str, int], ...] = (),
) -> SessionFigures:
    """Return the figures of a run with one epoch each second."""
    n = len(statuses)
    epochs = np.zeros(n, EPOCH_DTYPE)
    epochs["epoch"], epochs["t_s"] = np.arange(n), np.arange(n, dtype=float)
    epochs["status"] = [TRACK_STATUSES.index(status) for status in statuses]
    known = np.array([status in (T, C) for status in statuses])
    epochs["position_m"] = np.where(known[:, None], 0.0, np.nan)
    cameras = np.zeros(len(pixels or {}), CAMERA_DTYPE)
    for row, ((station, pair), pixel) in zip(cameras, (pixels or {}).items(), strict=True):
        row["station"], row["epoch"], row["pixel"] = STATIONS.index(station), pair, pixel
        row["nis"], row["dof"], row["accepted"] = 3.0, 2, True
        if (station, pair) in initial:
            row["status"] = DETECTION_STATUSES.index(DetectionStatus.INITIAL)
    reference = np.zeros((n, 3))
    reference[:, 1] = y_m
    comparison = Comparison(
        t_s=epochs["t_s"],
        reference_m=reference,
        usable=np.ones(n, dtype=bool),
        ekf_error_m=np.broadcast_to(np.asarray(error_m, dtype=float), (n, 3)).copy(),
        ekf_known=known,
        triangulation_error_m=np.zeros((n, 3)),
        triangulation_known=np.zeros(n, dtype=bool),
        covariance_m2=np.tile(sigma_m**2 * np.eye(3), (n, 1, 1)),
    )
    bounds = BoundSeries(
        fix_sigma_m=np.ones((n, 3)),
        fix_known=np.zeros(n, dtype=bool),
        track_sigma_m=np.full((n, 3), 0.5),
        track_known=np.ones(n, dtype=bool),
    )
    evaluation = Evaluation(
        summary={},
        run=cast("RunDescription", None),
        epochs=epochs,
        cameras=cameras,
        stations=STATIONS,
        comparisons={"truth": comparison},
        reference=None,
        truth=None,
        bounds=bounds,
        events=(),
    )
    return session_figures(cast("SessionTruth", truth), evaluation)


def both(*seen: int) -> HandTruth:
    mask = [bool(v) for v in seen]
    return HandTruth({"left": mask, "right": list(mask)})


@pytest.mark.parametrize(
    ("pixel", "distance"),
    [((105.0, 52.0), 0.0), ((100.0, 50.0), 0.0), ((96.0, 50.0), 4.0), ((122.0, 57.0), 5.0), ((100.0, 53.4), 0.4)],
)
def test_distance_from_a_silhouette(pixel: tuple[float, float], distance: float) -> None:
    assert distance_outside_px(SILHOUETTE, np.array(pixel)) == pytest.approx(distance)


def test_pixels_are_hits_within_four_pixels_and_wrong_beyond() -> None:
    truth = HandTruth(
        {"left": [True, True, True, True], "right": [True, False, True, True]},
        absent={("right", 2)},
        missing={("right", 3)},
    )
    truth.visible["right"][2:] = [False, False]
    found = figures(
        truth,
        [T] * 4,
        pixels={
            ("left", 0): (105.0, 51.0),
            ("left", 1): (96.1, 50.0),
            ("left", 2): (95.9, 50.0),
            # of a frame that does not count, of one without the aircraft, of one that was lost
            ("right", 1): (300.0, 300.0),
            ("right", 2): (105.0, 51.0),
            ("right", 3): (105.0, 51.0),
        },
        # a hit, a wrong one, and one of a frame that does not count
        initial=(("left", 1), ("left", 2), ("right", 1)),
    )
    assert (found.frames, found.visible_frames) == (6, 5)
    assert (found.hit, found.hit_initial, found.wrong, found.wrong_visible) == (2, 1, 3, 1)
    row = found.to_row()
    assert row["hit_share"] == pytest.approx(2 / 5)
    assert row["wrong_share"] == pytest.approx(1 / 5)
    assert row["excluded_share"] == pytest.approx(1 / 6)
    assert row["nis"] == pytest.approx(1.5)


def test_time_to_track_starts_where_two_cameras_see() -> None:
    truth = both(0, 0, 1, 1, 1, 1, 1, 0)
    truth.visible["left"][0] = True
    found = figures(truth, [L, L, L, L, T, C, L, L])
    assert found.seen_epochs == 5
    assert found.time_to_track_s == 2.0
    assert (found.due_epochs, found.covered_epochs) == (3, 2)


def test_a_session_that_was_never_tracked_is_due_and_not_covered() -> None:
    found = figures(both(0, 1, 1, 1), [L] * 4)
    assert found.time_to_track_s is None
    assert (found.due_epochs, found.covered_epochs) == (3, 0)
    assert found.to_row()["coverage"] == 0.0
    assert found.to_row()["anees"] is None


def test_returns_count_from_the_moment_two_cameras_see_again() -> None:
    #                  0  1  2  3  4  5  6  7  8  9
    truth = both(1, 1, 1, 0, 0, 1, 1, 1, 1, 1)
    found = figures(truth, [T, T, L, L, L, L, L, T, L, L])
    # lost at 2 in sight, back at 7; lost at 8 and never back
    assert (found.losses, found.returned) == (2, 1)
    assert found.return_s_max == 5.0


def test_out_of_sight_is_no_loss_until_it_is_in_sight_again() -> None:
    found = figures(both(1, 1, 0, 0, 1, 1, 1), [T, T, C, L, L, T, T])
    assert (found.losses, found.returned, found.return_s_median) == (1, 1, 1.0)


@pytest.mark.parametrize(
    ("error_m", "sigma_m", "misleading"),
    [
        # beyond 5 sigma of one axis
        ((0.0, 0.0, 0.51), 0.1, True),
        ((0.49, 0.49, 0.49), 0.1, False),
        # beyond the limit across the runway (3 m): 3.29 sigma is the edge of a probability of 0.001
        ((3.1, 0.0, 0.0), 0.9, True),
        ((3.1, 0.0, 0.0), 0.92, False),
        # along the runway 15 m, upwards 1.5 m
        ((0.0, 14.9, 0.0), 4.5, False),
        ((0.0, 15.1, 0.0), 4.5, True),
        ((0.0, 0.0, -1.6), 0.45, True),
    ],
)
def test_misleading_epochs(error_m: tuple[float, float, float], sigma_m: float, misleading: bool) -> None:
    found = figures(both(1, 1), [T, C], error_m=error_m, sigma_m=sigma_m)
    # the coasting epoch states that it is not tracking
    assert (found.tracking_epochs, found.misleading_epochs) == (1, int(misleading))


def test_errors_and_consistency_of_tracking_epochs() -> None:
    error = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 0.0], [9.0, 9.0, 9.0]])
    found = figures(both(1, 1, 1), [T, T, C], error_m=error, sigma_m=2.0, y_m=np.array([150.0, 300.0, 150.0]))
    assert (found.rmse_x_m, found.rmse_y_m, found.rmse_z_m) == pytest.approx((1.0, 2.0, 0.0))
    assert (found.near_rmse_x_m, found.near_rmse_y_m) == pytest.approx((1.0, 2.0))
    assert (found.over_bound_x, found.over_bound_y) == pytest.approx((2.0, 4.0))
    assert found.nees_count == 2
    assert found.to_row()["anees"] == pytest.approx((1.0 + 4.0) / 4.0 / 3.0)
