"""The two parts of a stated covariance: flights drawn from it pass, wrong ones are called out."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.evaluation.covariance_parts import ErrorsWithCovariance, flights_chi_square, noise_chi_square
from groundstation.evaluation.metrics import ChiSquareMean

FRAMES = 50


def drawn_flight(rng: np.random.Generator, *, lasting: float = 1.0, noise: float = 1.0) -> list[ErrorsWithCovariance]:
    """Two cameras of one flight, drawn from what is stated with its parts so many times as large in variance."""
    own = rng.normal(size=2)
    return [drawn_run(rng, own * np.sqrt(lasting), noise) for _ in range(2)]


def drawn_run(rng: np.random.Generator, own: FloatArray, noise: float) -> ErrorsWithCovariance:
    size = np.linspace(0.6, 1.8, FRAMES)[:, None, None]
    stays, new = size**2 * np.diag([1.0, 0.7]), size * np.array([[0.06, 0.01], [0.01, 0.1]])
    errors = np.sqrt(np.diagonal(stays, axis1=1, axis2=2)) * own
    errors += np.einsum("nij,nj->ni", np.linalg.cholesky(noise * new), rng.normal(size=(FRAMES, 2)))
    return ErrorsWithCovariance(errors=errors, covariances=stays + new, noises=np.broadcast_to(new, stays.shape))


def verdict(mean: ChiSquareMean | None) -> str:
    assert mean is not None
    return "below" if mean.mean < mean.low else "above" if mean.mean > mean.high else "inside"


def of_noise(runs: list[ErrorsWithCovariance]) -> ChiSquareMean | None:
    found = noise_chi_square(runs)
    return None if found is None else found.mean


def test_draws_of_the_stated_model_are_inside_the_bounds_at_the_stated_rate(rng: np.random.Generator) -> None:
    """80 flights, 95 %: at least 71 and not all of each; four flights at once have narrower bounds."""
    flown = [drawn_flight(rng) for _ in range(80)]
    assert 71 <= sum(verdict(flights_chi_square([flight])) == "inside" for flight in flown) <= 79
    assert 71 <= sum(verdict(of_noise(flight)) == "inside" for flight in flown) <= 79
    one, four = flights_chi_square(flown[:1]), flights_chi_square(flown[:4])
    assert one is not None
    assert four is not None
    assert four.high < 0.75 * one.high


@pytest.mark.parametrize(("noise", "reported"), [(0.5, "below"), (2.0, "above")])
def test_noise_of_the_wrong_size_is_called_out_in_one_flight(
    rng: np.random.Generator, noise: float, reported: str
) -> None:
    verdicts = [verdict(of_noise(drawn_flight(rng, noise=noise))) for _ in range(20)]
    assert verdicts.count(reported) >= 19


def test_a_lasting_part_of_the_wrong_size_needs_many_flights(rng: np.random.Generator) -> None:
    """Expected: one flight with three times the lasting variance is mostly inside, forty are above."""
    flown = [drawn_flight(rng, lasting=3.0) for _ in range(40)]
    assert sum(verdict(flights_chi_square([flight])) == "inside" for flight in flown[:20]) >= 10
    assert verdict(flights_chi_square(flown)) == "above"
    assert verdict(flights_chi_square([drawn_flight(rng, lasting=0.3) for _ in range(40)])) == "below"


def test_the_noise_excludes_constant_errors_and_jumps_count_separately(rng: np.random.Generator) -> None:
    run = drawn_flight(rng)[0]
    drift = np.linspace(0.0, 8.0, FRAMES)[:, None]
    plain, moved = noise_chi_square([run]), noise_chi_square([replace(run, errors=run.errors + 3.0 + drift)])
    jumped = run.errors.copy()
    jumped[30] += 20.0
    found = noise_chi_square([replace(run, errors=jumped)])
    assert plain is not None
    assert moved is not None
    assert found is not None
    assert moved.mean.mean == pytest.approx(plain.mean.mean)
    assert plain.jump_share == 0.0
    assert found.jump_share == pytest.approx(3 / (FRAMES - 2))
    assert verdict(found.mean) == verdict(plain.mean) == "inside"


def test_too_few_frames_have_no_mean(rng: np.random.Generator) -> None:
    run = drawn_flight(rng)[0]
    short = ErrorsWithCovariance(errors=run.errors[:2], covariances=run.covariances[:2], noises=run.noises[:2])
    none = ErrorsWithCovariance(errors=run.errors[:0], covariances=run.covariances[:0], noises=run.noises[:0])
    assert noise_chi_square([short]) is None
    assert flights_chi_square([[none]]) is None
    assert flights_chi_square([[short]]) is not None
