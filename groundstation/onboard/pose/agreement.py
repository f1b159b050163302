"""The ground's track and the aircraft's own pose compared: whether they agree, and the fused position of both."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.correlation import effective_count, lag_one
from groundstation.geometry.chi_square import chi_square_limit

# over a whole flight
FALSE_ALARM = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionTrack:
    """Positions (n, 3) in m with covariances (n, 3, 3) at times (n,), one frame, one clock, times growing."""

    t_s: FloatArray
    position_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionAgreement:
    """Two independent positions over a flight.

    Attributes
    ----------
    t_s : (n,) times at which both exist.
    difference_m : (n, 3) on board less ground.
    squares : (n,) normalised squares of the difference, χ² with three degrees of freedom where both covariances hold.
    mean_m, mean_sigma_m : (3,) the flight's mean difference and its sigma, by the effective number of differences.
    ratio, limit : mean square per degree of freedom, and the value exceeded by chance in 1 of 100 flights.
    fused_m, fused_covariance_m2 : (n, 3), (n, 3, 3) both weighted by their covariances.
    """

    t_s: FloatArray
    difference_m: FloatArray
    squares: FloatArray
    mean_m: FloatArray
    mean_sigma_m: FloatArray
    ratio: float
    limit: float
    fused_m: FloatArray
    fused_covariance_m2: FloatArray

    @property
    def agree(self) -> bool:
        """Return whether chance explains the difference."""
        return self.ratio <= self.limit


def compare_positions(
    ground: PositionTrack, onboard: PositionTrack, longest_gap_s: float = 0.5
) -> PositionAgreement | None:
    """Compare at the ground's times, the aircraft's positions interpolated; None where they share no time.

    A filter's errors are correlated in time, so the limit counts the number of independent differences by their
    correlation. The antenna, nose or camera of each must have been converted to one point before.
    """
    t, position, covariance = _interpolated(onboard, ground.t_s, longest_gap_s)
    used = np.isin(ground.t_s, t)
    if not len(t):
        return None
    difference = position - ground.position_m[used]
    total = covariance + ground.covariance_m2[used]
    roots = np.linalg.cholesky(total)
    white = np.linalg.solve(roots, difference[..., None])[..., 0]
    dof = _dof_of(white)
    gain = np.linalg.solve(total, ground.covariance_m2[used])
    gain = np.swapaxes(gain, 1, 2)
    fused = ground.position_m[used] + np.einsum("nij,nj->ni", gain, difference)
    fused_covariance = ground.covariance_m2[used] - gain @ ground.covariance_m2[used]
    return PositionAgreement(
        t_s=t,
        difference_m=difference,
        squares=(white**2).sum(axis=1),
        mean_m=difference.mean(axis=0),
        mean_sigma_m=np.sqrt(np.diagonal(total, axis1=1, axis2=2).mean(axis=0) / (dof / 3.0)),
        ratio=float((white**2).mean()),
        limit=float(chi_square_limit(FALSE_ALARM, dof) / dof),
        fused_m=fused,
        fused_covariance_m2=0.5 * (fused_covariance + np.swapaxes(fused_covariance, 1, 2)),
    )


def _dof_of(white: FloatArray) -> float:
    """Return how many independent numbers a run of whitened differences (n, 3) is worth, 3 at least."""
    return effective_count(len(white), lag_one([white])) * 3


def _interpolated(
    series: PositionTrack, t_s: FloatArray, longest_gap_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return those of the times within a gap short enough, with position and covariance there."""
    after = np.searchsorted(series.t_s, t_s, side="left")
    after = np.clip(after, 1, max(len(series.t_s) - 1, 1))
    if len(series.t_s) < 2:
        return np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3))
    before = after - 1
    gap = series.t_s[after] - series.t_s[before]
    inside = (t_s >= series.t_s[before]) & (t_s <= series.t_s[after]) & (gap <= longest_gap_s)
    before, after, t = before[inside], after[inside], t_s[inside]
    share = ((t - series.t_s[before]) / gap[inside])[:, None]
    position = (1 - share) * series.position_m[before] + share * series.position_m[after]
    w = share[:, :, None]
    return t, position, (1 - w) * series.covariance_m2[before] + w * series.covariance_m2[after]
