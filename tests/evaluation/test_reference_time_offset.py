"""The offset between two clocks and its sigma: held against sampled errors, white ones and such that last."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.evaluation.position_series import PositionSeries, ReferenceSeries
from groundstation.evaluation.reference_time_offset import NoOffset, ReferenceAligner, TimeOffset, estimate_offset

SIGMA_M = np.array([0.05, 0.3, 0.06])
FLIGHTS = 40
RATE_HZ = 10.0
WHITE, LASTING = 0.0, 0.9  # correlation of neighbours


def position(t_s: np.ndarray) -> np.ndarray:
    """A glide that sways sideways and changes its speed, (n, 3)."""
    y = 420.0 - 15.0 * t_s + 4.0 * np.sin(2 * np.pi * t_s / 11.0)
    return np.column_stack([3.0 * np.sin(2 * np.pi * t_s / 7.0), y, 0.06 * y + 0.5 * np.sin(2 * np.pi * t_s / 5.0)])


def velocity(t_s: np.ndarray) -> np.ndarray:
    return (position(t_s + 1e-4) - position(t_s - 1e-4)) / 2e-4


def errors(rng: np.random.Generator, count: int, correlation: float) -> np.ndarray:
    """Errors (n, 3) of unit variance whose neighbours correlate so much."""
    out = rng.normal(size=(count, 3))
    for k in range(1, count):
        out[k] = correlation * out[k - 1] + np.sqrt(1.0 - correlation**2) * out[k]
    return out


def aligner(
    rng: np.random.Generator, correlation: float, offset_s: float, seconds: float = 24.0, larger: float = 1.0
) -> ReferenceAligner:
    """A track whose covariance is right but for a factor on its errors, and a reference of another clock."""
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    found = position(t) + larger * SIGMA_M * errors(rng, len(t), correlation)
    at = np.arange(-4.0, seconds + 4.0, 0.05)
    series = PositionSeries(t_s=t, position_m=found, covariance_m2=np.tile(np.diag(SIGMA_M**2), (len(t), 1, 1)))
    reference = ReferenceSeries(t_s=at + offset_s, position_m=position(at), sigma_m=np.full((len(at), 3), 0.005))
    return ReferenceAligner(series, reference, 0.5)


def offset_of(lying: ReferenceAligner, start_s: float | None = None, **limits: float) -> TimeOffset | NoOffset:
    known = {"max_offset_s": 2.0, "huber_sigma": 2.0, "bias_sigmas": 0.5, **limits}
    return estimate_offset(lying, start_s=start_s, **known)


def found(lying: ReferenceAligner, start_s: float | None = None) -> TimeOffset:
    offset = offset_of(lying, start_s)
    assert isinstance(offset, TimeOffset), offset
    return offset


def bound_s(seconds: float = 24.0) -> float:
    """One sigma of the offset by Fisher's information, errors white: offset and the six biases with their priors."""
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    information = np.diag([0.0, *[0.5**-2] * 3, *[0.05**-2] * 3])
    weight = np.diag(1.0 / (SIGMA_M**2 + 0.005**2))
    for v in velocity(t):
        # one sigma of a fix of y, x and z, then a metre of x, y and z
        columns = np.column_stack([v, *(SIGMA_M[k] * np.eye(3)[k] for k in (1, 0, 2)), np.eye(3)])
        information += columns.T @ weight @ columns
    return float(np.sqrt(np.linalg.inv(information)[0, 0]))


@pytest.fixture(scope="module", params=[WHITE, LASTING], ids=["white", "lasting"])
def sampled(request: pytest.FixtureRequest) -> tuple[float, np.ndarray, list[TimeOffset]]:
    """Correlation, errors of the offset and what was found, of many flights."""
    off, all_found = [], []
    for seed in range(FLIGHTS):
        rng = np.random.default_rng([seed, 5])
        true_s = float(rng.uniform(-0.3, 0.3))
        all_found.append(found(aligner(rng, request.param, true_s), true_s + 0.01))
        off.append(all_found[-1].offset_s - true_s)
    return request.param, np.array(off), all_found


def test_the_offset_scatters_by_its_sigma(sampled: tuple[float, np.ndarray, list[TimeOffset]]) -> None:
    """Expected: mean of (error/σ)² inside two-sided χ² bounds of the flights, white errors or lasting."""
    _, off, flights = sampled
    low, high = chi2.ppf([0.001, 0.999], FLIGHTS)
    assert low < np.sum((off / [f.sigma_s for f in flights]) ** 2) < high


def test_correlated_errors_raise_the_sigma_by_their_effect(
    sampled: tuple[float, np.ndarray, list[TimeOffset]],
) -> None:
    """Expected: white errors are at the bound; of lasting ones the sampled scatter is a multiple, and so is sigma."""
    correlation, off, flights = sampled
    low, high = np.sqrt(chi2.ppf([0.001, 0.999], FLIGHTS) / FLIGHTS)
    scatter, sigma = float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean([f.sigma_s**2 for f in flights])))
    inflation = float(np.mean([f.inflation for f in flights]))
    if correlation == WHITE:
        assert low < scatter / bound_s() < high
        assert sigma == pytest.approx(bound_s(), rel=0.25)
        assert 1.0 <= inflation < 1.6
    else:
        # neighbours that correlate by ρ count (1 − ρ)/(1 + ρ) each, where the velocity changes slowly
        assert scatter > 2.0 * bound_s()
        assert 5.0 < inflation < (1.0 + LASTING) / (1.0 - LASTING) + 5.0
        assert low * 0.8 < scatter / sigma < high * 1.2


def test_errors_larger_than_stated_raise_the_sigma() -> None:
    plain, large = (found(aligner(np.random.default_rng(8), WHITE, 0.1, larger=factor), 0.1) for factor in (1.0, 1.5))
    assert large.inflation > 1.4 * plain.inflation
    assert large.sigma_s > 1.2 * plain.sigma_s
    assert large.misfit == pytest.approx(2.25 * plain.misfit, rel=0.1)


@pytest.mark.parametrize("true_s", [-1.37, -0.1, 0.0, 0.64, 1.9])
def test_the_offset_is_found_wherever_it_is(rng: np.random.Generator, true_s: float) -> None:
    """Expected: t_reference = t_session + offset, without a start, to five of the bound's sigmas."""
    assert found(aligner(rng, WHITE, true_s)).offset_s == pytest.approx(true_s, abs=5.0 * bound_s())


def test_what_shows_no_offset_gives_none(rng: np.random.Generator) -> None:
    hovering = aligner(rng, WHITE, 0.0)
    still = np.tile(position(np.zeros(1)), (len(hovering.series), 1)) + SIGMA_M * errors(rng, len(hovering.series), 0.0)
    reference = hovering.reference
    there = ReferenceSeries(
        t_s=reference.t_s, position_m=np.tile(position(np.zeros(1)), (len(reference), 1)), sigma_m=reference.sigma_m
    )
    series = PositionSeries(t_s=hovering.series.t_s, position_m=still, covariance_m2=hovering.series.covariance_m2)
    nothing = offset_of(ReferenceAligner(series, there, 0.5), 0.0)
    assert isinstance(nothing, NoOffset)
    assert "does not move enough" in nothing.reason
    later = ReferenceSeries(t_s=reference.t_s + 100.0, position_m=reference.position_m, sigma_m=reference.sigma_m)
    apart = offset_of(ReferenceAligner(hovering.series, later, 0.5))
    assert isinstance(apart, NoOffset)
    assert "share too few" in apart.reason
