"""Evaluation of a finished run: comparison with the references and with the accuracy bounds."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.evaluation.bounds import BoundSeries, StationView, fix_covariance, fix_information, posterior_bounds
from groundstation.evaluation.checked_reference import CheckedReference, check_reference
from groundstation.evaluation.collector import (
    DETECTION_STATUSES,
    TRACK_STATUSES,
    TRIANGULATION_STATUSES,
    ResultCollector,
)
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.metrics import Comparison, phases_within
from groundstation.evaluation.position_series import (
    BoolArray,
    InterpolatedReference,
    PositionSeries,
    ReferenceSeries,
    interpolate,
)
from groundstation.evaluation.reference_hypotheses import reference_contradiction, too_few_common
from groundstation.evaluation.run_description import RunDescription, TruthLike
from groundstation.evaluation.summary import build_summary, smoothed_table
from groundstation.files.output_names import below
from groundstation.files.whole_file import whole_file, write_whole
from groundstation.messages import DgpsFix, TrackStatus, TriangulationStatus
from groundstation.rig.rig import Rig

# the least variance in any direction: as a share of the largest, and in m²
_RELATIVE_FLOOR = 1e-7
_ABSOLUTE_FLOOR_M2 = 1e-10
_BLOCK_ROWS = 4096


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """What an evaluation found: ``summary`` for summary.json, the rest for pictures.

    ``comparisons`` has an entry "truth", "dgps", both or none. ``epochs`` and ``cameras`` are the collector's
    tables, ``smoothed`` the same epochs smoothed over the flight if asked for, ``events`` its log: time in s,
    level, text.
    """

    summary: dict[str, Any]
    run: RunDescription
    epochs: NDArray[Any]
    cameras: NDArray[Any]
    stations: tuple[str, ...]
    comparisons: dict[str, Comparison]
    reference: CheckedReference | None
    truth: ReferenceSeries | None
    bounds: BoundSeries
    events: tuple[tuple[float, str, str], ...]
    smoothed: NDArray[Any] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ReferenceComparisons:
    """Comparisons by reference ("truth", "dgps") of the estimates and of the smoothed estimates, and the references.

    ``checked`` is the DGPS log without its excluded spans, ``truth`` the exact positions; None where there is none.
    """

    comparisons: dict[str, Comparison]
    smoothed: dict[str, Comparison]
    checked: CheckedReference | None
    truth: ReferenceSeries | None


def evaluate_run(
    collector: ResultCollector,
    run: RunDescription,
    *,
    rig: Rig,
    config: EvaluationConfig,
    dgps: Sequence[DgpsFix] = (),
    truth: TruthLike | None = None,
    smoothed: ResultCollector | None = None,
) -> Evaluation:
    """Compare a run, and its epochs after smoothing (``smoothed``), with the available references and the bounds."""
    epochs, cameras = collector.epochs(), collector.cameras()
    after = None if smoothed is None else smoothed.epochs()
    found = _compare_with_references(epochs, after, run, config, dgps, truth)
    contradictions, uncompared = _contradictions(epochs, found, config)
    run = replace(run, contradictions=(*run.contradictions, *contradictions), faults=(*run.faults, *uncompared))
    bounds = _bounds(epochs, cameras, collector.stations, rig, run, config, found.comparisons.get("truth"))
    summary = build_summary(
        epochs=epochs,
        cameras=cameras,
        stations=collector.stations,
        comparisons=found.comparisons,
        reference=found.checked,
        fixes=len(dgps),
        channels=collector.channels(),
        bounds=bounds,
        config=config,
        run=run,
    )
    for name, comparison in found.smoothed.items():
        summary["accuracy"][name]["smoothed"] = smoothed_table(found.comparisons[name], comparison)
    if len(epochs):
        # the pictures show the replayed interval
        run = replace(run, phases=phases_within(run.phases, float(epochs["t_s"][0]), float(epochs["t_s"][-1])))
    return Evaluation(
        summary=summary,
        run=run,
        epochs=epochs,
        cameras=cameras,
        stations=collector.stations,
        comparisons=found.comparisons,
        reference=found.checked,
        truth=found.truth,
        bounds=bounds,
        events=tuple(collector.events),
        smoothed=after,
    )


def _compare_with_references(
    epochs: NDArray[Any],
    smoothed: NDArray[Any] | None,
    run: RunDescription,
    config: EvaluationConfig,
    dgps: Sequence[DgpsFix],
    truth: TruthLike | None,
) -> _ReferenceComparisons:
    """Compare the epochs, and the smoothed ones, with the exact positions and with the DGPS log."""
    references: dict[str, InterpolatedReference] = {}
    checked, exact = None, None
    if truth is not None and len(truth.t_s):
        exact = ReferenceSeries(
            t_s=truth.t_s, position_m=truth.position_runway_m, sigma_m=np.zeros_like(truth.position_runway_m)
        )
        references["truth"] = interpolate(exact, epochs["t_s"], config.max_interpolation_gap_s)
    if len(dgps) >= 2 and np.any(_estimated(epochs)):
        checked = check_reference(
            dgps,
            track_series(epochs),
            triangulated_series(epochs),
            run.antenna_in_body_m,
            config,
            run.clocks_given,
        )
        references["dgps"] = checked.at(epochs["t_s"])

    def compare(rows: NDArray[Any]) -> dict[str, Comparison]:
        return {name: _compare(rows, at.position_m, at.usable, at.sigma_m) for name, at in references.items()}

    return _ReferenceComparisons(
        comparisons=compare(epochs),
        smoothed={} if smoothed is None else compare(smoothed),
        checked=checked,
        truth=exact,
    )


def _contradictions(
    epochs: NDArray[Any], found: _ReferenceComparisons, config: EvaluationConfig
) -> tuple[list[str], list[str]]:
    """Return why the epochs *tracking* and a reference cannot both be right, and where too little is known to tell."""
    track = track_series(epochs[epochs["status"] == TRACK_STATUSES.index(TrackStatus.TRACKING)])
    # the truth is on the session's clock: an offset of it would hide 50 m along the path
    references = {
        "the DGPS log": (None if found.checked is None else found.checked.fixes, config.max_offset_s),
        "truth.csv": (found.truth, 0.0),
    }
    gap_s = config.max_interpolation_gap_s
    contradictions, uncompared = [], []
    for name, (reference, offset_s) in references.items():
        if reference is not None:
            contradictions.append(reference_contradiction(track, reference, offset_s, name, gap_s))
            uncompared.append(too_few_common(track, reference, name, gap_s))
    return [line for line in contradictions if line], [line for line in uncompared if line]


def write_summary(path: Path, evaluation: Evaluation) -> None:
    """Write summary.json; raises `InputError` if the file can't be written."""
    text = json.dumps(evaluation.summary, indent=1, allow_nan=False, ensure_ascii=False)
    try:
        write_whole(path, text + "\n")
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault


def write_reference_tums(folder: Path, evaluation: Evaluation) -> list[Path]:
    """Write truth.tum and dgps.tum, each reference at the times of the pairs, next to track.tum; returns the files.

    A program that matches stamps without interpolating then compares what `summary.json` compares. Raises
    `InputError` if a file can't be written.
    """
    written = []
    for name, c in evaluation.comparisons.items():
        path = below(folder, f"{name}.tum")
        try:
            with whole_file(path) as draft, draft.open("w", encoding="utf-8") as file:
                for k in np.flatnonzero(c.usable):
                    x, y, z = c.reference_m[k]
                    file.write(f"{c.t_s[k]:.6f} {x:.7f} {y:.7f} {z:.7f} 0 0 0 1\n")
        except OSError as fault:
            raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault
        written.append(path)
    return written


def track_series(epochs: NDArray[Any]) -> PositionSeries:
    """Return the epochs that have an EKF estimate."""
    known = _estimated(epochs)
    return PositionSeries(
        t_s=epochs["t_s"][known],
        position_m=epochs["position_m"][known],
        covariance_m2=_regular(epochs["covariance_m2"][known]),
    )


def triangulated_series(epochs: NDArray[Any]) -> PositionSeries:
    """Return the epochs with a triangulated point whose rays meet (maximum likelihood)."""
    known = _triangulation_ok(epochs)
    return PositionSeries(
        t_s=epochs["t_s"][known],
        position_m=epochs["ml_point_m"][known],
        covariance_m2=_regular(epochs["ml_covariance_m2"][known]),
    )


def _finite(points: FloatArray) -> BoolArray:
    """Return which rows (n,) are numbers throughout."""
    return np.asarray(np.all(np.isfinite(points), axis=1))


def _triangulation_ok(epochs: NDArray[Any]) -> BoolArray:
    """Return which epochs (n,) have a triangulated point."""
    ok = epochs["triangulation_status"] == TRIANGULATION_STATUSES.index(TriangulationStatus.OK)
    return ok & _finite(epochs["ml_point_m"]) & _finite(epochs["ml_covariance_m2"].reshape(-1, 9))


def _estimated(epochs: NDArray[Any]) -> BoolArray:
    """Return which epochs (n,) have an EKF estimate."""
    return _finite(epochs["position_m"]) & _finite(epochs["covariance_m2"].reshape(-1, 9))


def _regular(covariance_m2: NDArray[Any]) -> FloatArray:
    """Return covariances (n, 3, 3) that can be inverted: symmetric, every direction with some variance.

    Single precision, or a filter gone wrong, may have cost them that. What is not finite becomes the identity;
    such epochs do not count as estimates.
    """
    regular = np.empty(covariance_m2.shape, dtype=np.float64)
    # block by block: on the way there are eight arrays of this size
    for first in range(0, len(regular), _BLOCK_ROWS):
        regular[first : first + _BLOCK_ROWS] = _regular_block(covariance_m2[first : first + _BLOCK_ROWS])
    return regular


def _regular_block(covariance_m2: NDArray[Any]) -> FloatArray:
    finite = np.isfinite(covariance_m2).all(axis=(1, 2))
    exact = np.where(finite[:, None, None], covariance_m2, np.eye(3)).astype(np.float64)
    values, vectors = np.linalg.eigh(0.5 * (exact + exact.transpose(0, 2, 1)))
    floor = _RELATIVE_FLOOR * np.abs(values).max(axis=1, initial=0.0) + _ABSOLUTE_FLOOR_M2
    values = np.maximum(values, floor[:, None])
    return np.asarray((vectors * values[:, None, :]) @ vectors.transpose(0, 2, 1))


def _compare(
    epochs: NDArray[Any], reference_m: FloatArray, usable: BoolArray, reference_sigma_m: FloatArray
) -> Comparison:
    """Set the run's estimates against a reference at the epochs' own times."""
    ekf_known = usable & _estimated(epochs)
    triangulation_known = usable & _triangulation_ok(epochs)
    covariance = _regular(epochs["covariance_m2"])
    for axis in range(3):
        covariance[:, axis, axis] += reference_sigma_m[:, axis] ** 2
    return Comparison(
        t_s=epochs["t_s"],
        reference_m=reference_m,
        usable=usable,
        ekf_error_m=np.where(ekf_known[:, None], epochs["position_m"] - reference_m, 0.0),
        ekf_known=ekf_known,
        triangulation_error_m=np.where(triangulation_known[:, None], epochs["ml_point_m"] - reference_m, 0.0),
        triangulation_known=triangulation_known,
        covariance_m2=covariance,
    )


def _bounds(
    epochs: NDArray[Any],
    cameras: NDArray[Any],
    stations: tuple[str, ...],
    rig: Rig,
    run: RunDescription,
    config: EvaluationConfig,
    truth: Comparison | None,
) -> BoundSeries:
    """Return the bounds of every epoch from the looks that gave a pixel, at the true or estimated position."""
    n = len(epochs)
    place = epochs["position_m"].copy()
    if truth is not None:
        place[truth.usable] = truth.reference_m[truth.usable]
    fix_sigma, fix_known, information = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_), np.zeros((n, 3, 3))
    views = _EpochViews(cameras, stations, rig)
    for k in range(n):
        if not np.all(np.isfinite(place[k])):
            continue
        information[k] = fix_information(place[k], views.of(int(epochs["epoch"][k])))
        covariance = fix_covariance(information[k])
        if covariance is not None:
            fix_sigma[k], fix_known[k] = np.sqrt(np.diag(covariance)), True
    track_sigma, track_known = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
    seen = np.flatnonzero(fix_known)
    if len(seen):
        first = int(seen[0])
        bounds = posterior_bounds(
            epochs["t_s"][first:],
            information[first:],
            np.array(run.acceleration_psd_m2_s3),
            config.prior_position_sigma_m,
            config.prior_velocity_sigma_m_s,
        )
        for k, bound in enumerate(bounds, first):
            track_sigma[k] = np.sqrt(np.diag(bound)[:3])
        track_known[first:] = True
    return BoundSeries(fix_sigma_m=fix_sigma, fix_known=fix_known, track_sigma_m=track_sigma, track_known=track_known)


class _EpochViews:
    """The looks with an accepted pixel, by epoch number; made when asked for, since an hour has 70,000 of them."""

    def __init__(self, cameras: NDArray[Any], stations: tuple[str, ...], rig: Rig) -> None:
        self._calibrated = [rig[name] for name in stations]
        self._geometries = [station.geometry() for station in self._calibrated]
        ok = np.isin(cameras["status"], [k for k, status in enumerate(DETECTION_STATUSES) if status.used])
        ok &= np.isfinite(cameras["pan_rad"]) & np.isfinite(cameras["tilt_rad"])
        self._cameras = cameras
        rows = np.flatnonzero(ok)
        self._rows = rows[np.argsort(cameras["epoch"][rows], kind="stable")]
        self._epochs = cameras["epoch"][self._rows]

    def of(self, epoch: int) -> list[StationView]:
        """Return the views of one epoch, in the order in which they came."""
        first, last = np.searchsorted(self._epochs, [epoch, epoch + 1])
        return [self._view(self._cameras[k]) for k in self._rows[first:last]]

    def _view(self, row: NDArray[Any]) -> StationView:
        station = self._calibrated[row["station"]]
        return StationView(
            geometry=self._geometries[row["station"]],
            pan_rad=float(row["pan_rad"]),
            tilt_rad=float(row["tilt_rad"]),
            pixel_covariance_px2=row["covariance_px2"].astype(np.float64),
            angle_sigma_rad=0.0 if station.fixed else station.angle_sigma_rad,
        )
