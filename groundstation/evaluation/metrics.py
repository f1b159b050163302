"""Errors against a reference per axis, range bin and background, and the consistency of the covariances.

Convention: the estimate at its epoch's time against the reference interpolated linearly to that time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.position_series import BoolArray
from groundstation.geometry.chi_square import chi_square_quantile

CONFIDENCE = 0.95


class PhaseLike(Protocol):
    """A stretch of the session with one kind of background; session time in s."""

    @property
    def from_s(self) -> float:
        """Return the first time."""

    @property
    def to_s(self) -> float:
        """Return the last time."""

    @property
    def background(self) -> str:
        """Return sky, mixed or ground."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorStatistics:
    """Of ``count`` errors: root mean square, mean, 95 % of the magnitudes and largest magnitude, (3,) m each."""

    count: int
    rmse_m: FloatArray
    mean_m: FloatArray
    p95_m: FloatArray
    max_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """One run against one reference, for all n epochs.

    Attributes
    ----------
    t_s : (n,) epochs; ``reference_m`` (n, 3); ``usable`` (n,) where the reference is.
    ekf_error_m, triangulation_error_m : (n, 3) estimate minus reference, where ``ekf_known`` and
        ``triangulation_known`` (n,) say so: both there and the reference usable.
    covariance_m2 : (n, 3, 3) of the EKF's error, the reference's own noise added.
    """

    t_s: FloatArray
    reference_m: FloatArray
    usable: BoolArray
    ekf_error_m: FloatArray
    ekf_known: BoolArray
    triangulation_error_m: FloatArray
    triangulation_known: BoolArray
    covariance_m2: FloatArray

    @property
    def both_known(self) -> BoolArray:
        """Return the epochs on which the two are compared with each other, (n,)."""
        return self.ekf_known & self.triangulation_known

    def nees(self) -> FloatArray:
        """Return the normalised squared error of each epoch with an EKF error, in time order."""
        e, P = self.ekf_error_m[self.ekf_known], self.covariance_m2[self.ekf_known]
        return np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Accuracy:
    """Accuracy over one group of epochs.

    ``reference_epochs`` have a usable reference; ``ekf`` and ``triangulation`` are each alone, the ``common``
    ones on the epochs where both exist; ``improvement_percent`` (3,) is 100·(1 − EKF / triangulation) of the
    common root mean squares. Statistics are None where there is no epoch.
    """

    reference_epochs: int
    ekf: ErrorStatistics | None
    triangulation: ErrorStatistics | None
    common_ekf: ErrorStatistics | None
    common_triangulation: ErrorStatistics | None

    @property
    def improvement_percent(self) -> FloatArray | None:
        """Return by how much the EKF is better than triangulation, or None without common epochs."""
        if self.common_ekf is None or self.common_triangulation is None:
            return None
        return 100.0 * (1.0 - self.common_ekf.rmse_m / np.maximum(self.common_triangulation.rmse_m, 1e-12))


@dataclass(frozen=True, slots=True, kw_only=True)
class ChiSquareMean:
    """A mean normalised square per degree of freedom (1 is ideal) and its two-sided 95 % bounds.

    The bounds hold for ``count`` independent values. Errors of consecutive epochs are correlated, so a
    consistent filter leaves them more often than 5 % of the time; innovations are nearly white.
    """

    mean: float
    low: float
    high: float
    count: int


def statistics(errors_m: FloatArray) -> ErrorStatistics | None:
    """Return the statistics of errors (n, 3), or None if there are none."""
    if len(errors_m) == 0:
        return None
    size = np.abs(errors_m)
    return ErrorStatistics(
        count=len(errors_m),
        rmse_m=np.sqrt((errors_m**2).mean(axis=0)),
        mean_m=errors_m.mean(axis=0),
        p95_m=np.percentile(size, 95, axis=0),
        max_m=size.max(axis=0),
    )


def accuracy(comparison: Comparison, group: BoolArray) -> Accuracy:
    """Return the accuracy over the epochs of ``group`` (n,)."""
    c = comparison
    both = group & c.both_known
    return Accuracy(
        reference_epochs=int(np.count_nonzero(group & c.usable)),
        ekf=statistics(c.ekf_error_m[group & c.ekf_known]),
        triangulation=statistics(c.triangulation_error_m[group & c.triangulation_known]),
        common_ekf=statistics(c.ekf_error_m[both]),
        common_triangulation=statistics(c.triangulation_error_m[both]),
    )


def range_bins(edges_m: Sequence[float]) -> list[tuple[float, float]]:
    """Return the bins (from, to) of rising edges; the last one is open."""
    return list(zip(edges_m, [*edges_m[1:], float("inf")], strict=True))


def in_bin(y_m: FloatArray, low_m: float, high_m: float) -> BoolArray:
    """Return which ranges y (n,) are in [low, high)."""
    return (y_m >= low_m) & (y_m < high_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """A part of a phase; session time in s."""

    from_s: float
    to_s: float
    background: str


def phases_within(phases: Sequence[PhaseLike], from_s: float, to_s: float) -> tuple[Stretch, ...]:
    """Return the parts of the phases that lie in an interval, s; those outside are left out."""
    cut = ((max(p.from_s, from_s), min(p.to_s, to_s), p.background) for p in phases)
    return tuple(Stretch(from_s=start, to_s=end, background=name) for start, end, name in cut if start < end)


def phase_masks(t_s: FloatArray, phases: Sequence[PhaseLike]) -> dict[str, BoolArray]:
    """Return the epochs (n,) of each background, phases of the same background together."""
    masks: dict[str, BoolArray] = {}
    for phase in phases:
        inside = (t_s >= phase.from_s - 1e-9) & (t_s <= phase.to_s + 1e-9)
        masks[phase.background] = masks.get(phase.background, np.zeros(len(t_s), dtype=np.bool_)) | inside
    return masks


def chi_square_mean(values: FloatArray, dof: FloatArray) -> ChiSquareMean | None:
    """Return the mean of χ² values (n,) per degree of freedom with its bounds, or None if there are none."""
    total = float(np.sum(dof))
    if len(values) == 0 or total <= 0:
        return None
    low, high = chi_square_quantile([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], total) / total
    return ChiSquareMean(mean=float(values.sum() / total), low=float(low), high=float(high), count=len(values))
