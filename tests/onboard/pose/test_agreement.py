"""Two independent positions of one flight: agreement, disagreement, and both together."""

import numpy as np
from scipy.stats import chi2

from groundstation.onboard.pose.agreement import PositionTrack, compare_positions

GROUND = np.diag([0.05, 1.0, 0.05]) ** 2
ONBOARD = np.diag([0.3, 2.0, 0.2]) ** 2


def series(
    rng: np.random.Generator, rate_hz: float, covariance: np.ndarray, off: np.ndarray, memory: float = 0.0
) -> PositionTrack:
    t = np.arange(0.0, 20.0, 1.0 / rate_hz)
    truth = np.stack([0 * t, 400 - 20 * t, 25 - 1.2 * t], axis=1)
    root = np.linalg.cholesky(covariance)
    noise = rng.standard_normal((len(t), 3))
    for k in range(1, len(t)):
        noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory**2) * noise[k]
    return PositionTrack(
        t_s=t, position_m=truth + noise @ root.T + off, covariance_m2=np.broadcast_to(covariance, (len(t), 3, 3))
    )


def test_false_alarms_have_the_stated_rate(rng: np.random.Generator) -> None:
    """Errors that last half a second: of 300 flights, 1 % are refused, within the 99.9 % bound of a binomial."""
    refused = 0
    for _ in range(300):
        both = compare_positions(series(rng, 10, GROUND, np.zeros(3), 0.8), series(rng, 10, ONBOARD, np.zeros(3), 0.8))
        assert both is not None
        refused += not both.agree
    assert refused <= 11


def test_a_disagreement_is_found_and_measured(rng: np.random.Generator) -> None:
    off = np.array([1.5, 0.0, 0.0])
    both = compare_positions(series(rng, 10, GROUND, np.zeros(3)), series(rng, 10, ONBOARD, off))
    assert both is not None
    assert not both.agree
    assert np.abs((both.mean_m - off) / both.mean_sigma_m).max() < 4.0
    assert both.mean_m[0] > 5 * both.mean_sigma_m[0]


def test_both_together_are_better_than_either(rng: np.random.Generator) -> None:
    both = compare_positions(series(rng, 10, GROUND, np.zeros(3)), series(rng, 10, ONBOARD, np.zeros(3)))
    assert both is not None
    truth = np.stack([0 * both.t_s, 400 - 20 * both.t_s, 25 - 1.2 * both.t_s], axis=1)
    e = both.fused_m - truth
    squares = np.einsum("ni,nij,nj->n", e, np.linalg.inv(both.fused_covariance_m2), e)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(e)) / len(e)
    assert low < squares.mean() < high
    assert both.fused_covariance_m2[0, 1, 1] < min(GROUND[1, 1], ONBOARD[1, 1])


def test_only_shared_time_counts(rng: np.random.Generator) -> None:
    ground, onboard = series(rng, 10, GROUND, np.zeros(3)), series(rng, 25, ONBOARD, np.zeros(3))
    kept = (onboard.t_s < 5.0) | (onboard.t_s > 12.0)
    part = PositionTrack(
        t_s=onboard.t_s[kept], position_m=onboard.position_m[kept], covariance_m2=onboard.covariance_m2[kept]
    )
    both = compare_positions(ground, part)
    assert both is not None
    assert not ((both.t_s > 5.0) & (both.t_s < 12.0)).any()
    later = PositionTrack(t_s=ground.t_s + 100, position_m=ground.position_m, covariance_m2=ground.covariance_m2)
    assert compare_positions(ground, later) is None
