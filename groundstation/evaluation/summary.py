"""The content of summary.json, as plain tables: numbers, strings and null, never NaN."""

import dataclasses
import platform
import sys
from collections.abc import Sequence
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.evaluation.bounds import BoundSeries
from groundstation.evaluation.checked_reference import CheckedReference
from groundstation.evaluation.collector import (
    DETECTION_STATUSES,
    MISS_REASONS,
    NO_REASON,
    TRACK_STATUSES,
    TRIANGULATION_STATUSES,
)
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.metrics import (
    Accuracy,
    ChiSquareMean,
    Comparison,
    ErrorStatistics,
    accuracy,
    chi_square_mean,
    in_bin,
    phase_masks,
    range_bins,
    statistics,
)
from groundstation.evaluation.missing_track import why_no_track
from groundstation.evaluation.position_series import BoolArray
from groundstation.evaluation.reference_time_offset import TimeOffset
from groundstation.evaluation.run_description import RunDescription

SUMMARY_FORMAT = "groundstation-summary/1"
AXES = ("x", "y", "z")
_PERCENTILES = (50, 90, 99)
_DISTRIBUTIONS = ("numpy", "scipy", "opencv-python-headless", "numba", "filterpy", "rerun-sdk", "groundstation")
_CORRELATION_NOTE = "bounds are for independent errors; errors of consecutive epochs are correlated"


def build_summary(
    *,
    epochs: NDArray[Any],
    cameras: NDArray[Any],
    stations: tuple[str, ...],
    comparisons: dict[str, Comparison],
    reference: CheckedReference | None,
    fixes: int,
    channels: dict[str, dict[str, Any]],
    bounds: BoundSeries,
    config: EvaluationConfig,
    run: RunDescription,
) -> dict[str, Any]:
    """Put everything that a run has shown into one JSON-ready table."""
    counts = _counts(epochs, cameras, stations)
    return {
        "format": SUMMARY_FORMAT,
        "session": _session(epochs, stations, run),
        "place": dict(run.place),
        "faults": list(run.faults),
        "contradictions": list(run.contradictions),
        "no_track": why_no_track(counts),
        "accuracy": {
            name: _accuracy_tables(comparison, config, run, bounds) for name, comparison in comparisons.items()
        },
        "nis": _nis(cameras, stations),
        "reference": _reference(reference, fixes, run, epochs["t_s"]),
        "calibration": {
            "use": (run.configuration or {}).get("estimation", {}).get("calibration"),
            "learnt_until_s": run.learnt_until_s,
            "errors": [dataclasses.asdict(error) for error in run.carried_errors],
        },
        "counts": {**counts, **(run.fused_late or {})},
        "channels": channels,
        "latency_ms": _percentiles(1e3 * epochs["latency_s"].astype(np.float64)),
        "detection_ms": {
            name: _percentiles(1e3 * cameras["elapsed_s"][cameras["station"] == k].astype(np.float64))
            for k, name in enumerate(stations)
        },
        "speed": {k: _number(v) for k, v in (run.speed or {}).items()},
        "configuration": dict(run.configuration or {}),
        "versions": versions(),
        "provenance": dict(run.provenance),
    }


def _session(epochs: NDArray[Any], stations: tuple[str, ...], run: RunDescription) -> dict[str, Any]:
    """Say what was processed."""
    t = epochs["t_s"]
    return {
        "name": run.name,
        "epochs": len(epochs),
        "from_s": _number(t[0]) if len(t) else None,
        "to_s": _number(t[-1]) if len(t) else None,
        "stations": list(stations),
    }


def _accuracy_tables(
    c: Comparison, config: EvaluationConfig, run: RunDescription, bounds: BoundSeries
) -> dict[str, Any]:
    """Return accuracy in total, by range and by background, with consistency, against one reference."""
    everything = np.ones(len(c.t_s), dtype=np.bool_)
    y = c.reference_m[:, 1]
    by_range = [
        {"from_m": low, "to_m": _number(high), **_group(c, c.usable & in_bin(y, low, high), bounds)}
        for low, high in range_bins(config.range_bins_m)
    ]
    nees = c.nees()
    return {
        "total": _group(c, everything, bounds),
        "by_range": [row for row in by_range if row["reference_epochs"]],
        "by_phase": {
            background: _group(c, inside, bounds) for background, inside in phase_masks(c.t_s, run.phases).items()
        },
        "anees": _chi_square(chi_square_mean(nees, np.full(len(nees), 3.0)), _CORRELATION_NOTE),
    }


def smoothed_table(c: Comparison, smoothed: Comparison) -> dict[str, Any]:
    """Return the smoothed track's accuracy against a reference, with the filter's ``c`` on the same epochs."""
    both = c.ekf_known & smoothed.ekf_known
    nees = smoothed.nees()
    alone = int(np.count_nonzero(c.usable))
    ekf = statistics(c.ekf_error_m[both])
    return {
        **_statistics(statistics(smoothed.ekf_error_m[smoothed.ekf_known]), alone),
        "ekf_rmse_m": None if ekf is None else _vector(ekf.rmse_m),
        "anees": _chi_square(chi_square_mean(nees, np.full(len(nees), 3.0)), _CORRELATION_NOTE),
    }


def _group(c: Comparison, group: BoolArray, bounds: BoundSeries) -> dict[str, Any]:
    """Return one group of epochs as a table."""
    a: Accuracy = accuracy(c, group)
    alone = a.reference_epochs
    improvement = a.improvement_percent
    nees = c.nees()[group[c.ekf_known]]
    return {
        "reference_epochs": alone,
        "ekf": _statistics(a.ekf, alone),
        "triangulation": _statistics(a.triangulation, alone),
        "common": {
            "epochs": 0 if a.common_ekf is None else a.common_ekf.count,
            "ekf_rmse_m": None if a.common_ekf is None else _vector(a.common_ekf.rmse_m),
            "triangulation_rmse_m": None if a.common_triangulation is None else _vector(a.common_triangulation.rmse_m),
            "improvement_percent": None if improvement is None else _vector(improvement),
        },
        "anees": _number(nees.mean() / 3.0) if len(nees) else None,
        "bound": _bound(c, group, bounds),
    }


def _statistics(s: ErrorStatistics | None, reference_epochs: int) -> dict[str, Any]:
    """Return error statistics as a table; null where there are none."""
    if s is None:
        return {"epochs": 0, "coverage": 0.0, "rmse_m": None, "mean_m": None, "p95_m": None, "max_m": None}
    return {
        "epochs": s.count,
        "coverage": s.count / reference_epochs,
        "rmse_m": _vector(s.rmse_m),
        "mean_m": _vector(s.mean_m),
        "p95_m": _vector(s.p95_m),
        "max_m": _vector(s.max_m),
    }


def _bound(c: Comparison, group: BoolArray, bounds: BoundSeries) -> dict[str, Any]:
    """Return the bounds' root mean square over a group and the errors in multiples of them."""
    on_fix = group & c.triangulation_known & bounds.fix_known
    on_track = group & c.ekf_known & bounds.track_known
    fix, triangulation = _rms(bounds.fix_sigma_m[on_fix]), _rms(c.triangulation_error_m[on_fix])
    track, ekf = _rms(bounds.track_sigma_m[on_track]), _rms(c.ekf_error_m[on_track])
    return {
        "fix_sigma_m": fix,
        "track_sigma_m": track,
        "triangulation_over_fix": _ratio(triangulation, fix),
        "ekf_over_track": _ratio(ekf, track),
    }


def _rms(values: FloatArray) -> list[float | None] | None:
    """Return the root mean square per axis of (n, 3), or None without rows."""
    return _vector(np.sqrt((values**2).mean(axis=0))) if len(values) else None


def _ratio(above: list[float | None] | None, below: list[float | None] | None) -> list[float | None] | None:
    """Divide axis by axis; null where there is nothing to divide."""
    if above is None or below is None:
        return None
    return [a / b if a is not None and b else None for a, b in zip(above, below, strict=True)]


def _nis(cameras: NDArray[Any], stations: tuple[str, ...]) -> dict[str, Any]:
    """Return the mean normalised innovation square of accepted pixels per degree of freedom, and the rejections."""
    judged = np.isfinite(cameras["nis"])
    table: dict[str, Any] = {}
    for name, mask in [("all", judged), *((s, judged & (cameras["station"] == k)) for k, s in enumerate(stations))]:
        accepted = mask & cameras["accepted"]
        mean = chi_square_mean(cameras["nis"][accepted].astype(np.float64), cameras["dof"][accepted].astype(np.float64))
        table[name] = {
            **(_chi_square(mean, "accepted pixels only; the gate cuts the tail") or {"mean": None}),
            "judged": int(np.count_nonzero(mask)),
            "rejected": int(np.count_nonzero(mask & ~cameras["accepted"])),
        }
    return table


def _chi_square(mean: ChiSquareMean | None, note: str) -> dict[str, Any] | None:
    """Return a χ² mean as a table."""
    if mean is None:
        return None
    return {"mean": mean.mean, "low_95": mean.low, "high_95": mean.high, "count": mean.count, "note": note}


def _reference(reference: CheckedReference | None, fixes: int, run: RunDescription, t_s: FloatArray) -> dict[str, Any]:
    """Say what became of the DGPS log: clock offset, lever arm, spans excluded from the time of the epochs (n,)."""
    table: dict[str, Any] = {"fixes": fixes, "session_clock_is_dgps_clock": run.clocks_given}
    if reference is None:
        return {**table, "time_offset": None, "excluded": []}
    offset = reference.offset
    found = isinstance(offset, TimeOffset)
    return {
        **table,
        "usable_fixes": len(reference.fixes),
        "antenna_in_body_m": None if run.antenna_in_body_m is None else _vector(run.antenna_in_body_m),
        "noise_sigma_m": _vector(np.median(reference.fixes.sigma_m, axis=0)) if len(reference.fixes) else None,
        "time_offset": {
            "convention": "t_dgps = t_session + offset",
            "offset_s": _number(offset.offset_s) if isinstance(offset, TimeOffset) else None,
            "sigma_s": _number(offset.sigma_s) if isinstance(offset, TimeOffset) else None,
            "variance_inflation": _number(offset.inflation) if isinstance(offset, TimeOffset) else None,
            "constant_bias": {
                "fix_sigmas_yxz": list(offset.bias[:3]) if isinstance(offset, TimeOffset) else None,
                "xyz_m": list(offset.bias[3:]) if isinstance(offset, TimeOffset) else None,
            },
            "epochs": offset.samples if isinstance(offset, TimeOffset) else 0,
            "from": reference.offset_source.value,
            "applied_s": reference.applied_offset_s,
            "reason": "" if found else getattr(offset, "reason", ""),
        },
        "excluded": [
            {"from_s": s.from_s, "to_s": s.to_s, "reason": s.reason.value, "detail": s.detail}
            for s in reference.excluded
            if s.to_s >= t_s[0] and s.from_s <= t_s[-1]
        ],
    }


def _counts(epochs: NDArray[Any], cameras: NDArray[Any], stations: tuple[str, ...]) -> dict[str, Any]:
    """Count every status and every reason for a miss."""
    per_station = {}
    for k, name in enumerate(stations):
        own = cameras[cameras["station"] == k]
        missed = own["reason"][own["reason"] != NO_REASON]
        per_station[name] = {
            "status": _count(own["status"], DETECTION_STATUSES),
            "miss_reason": _count(missed, MISS_REASONS),
        }
    return {
        "track": _count(epochs["status"], TRACK_STATUSES),
        "triangulation": _count(epochs["triangulation_status"], TRIANGULATION_STATUSES),
        "detection": per_station,
    }


def _count(codes: NDArray[Any], words: Sequence[Any]) -> dict[str, int]:
    """Return how often each word occurs."""
    return {str(word): int(np.count_nonzero(codes == k)) for k, word in enumerate(words)}


def _percentiles(values: FloatArray) -> dict[str, float | None]:
    """Return p50, p90, p99 and max; null where there is no value."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return {**{f"p{p}": None for p in _PERCENTILES}, "max": None}
    return {**{f"p{p}": _number(np.percentile(known, p)) for p in _PERCENTILES}, "max": _number(known.max())}


def versions() -> dict[str, str]:
    """Return the versions of Python, of the platform and of what the numbers depend on."""
    found = {"python": sys.version.split()[0], "platform": platform.platform()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def _number(value: float) -> float | None:
    """Return a finite float, or None: JSON has no NaN."""
    number = float(value)
    return number if np.isfinite(number) else None


def _vector(values: FloatArray) -> list[float | None]:
    """Return three numbers for JSON."""
    return [_number(v) for v in values]
