"""The one fit of all calibrations: it ends at the least cost, and where a further step would be negligible."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from calibration.robust_fit import SOFT_L1_SIGMA, FitProblem, Linearisation, Loss, minimise
from groundstation.arrays import FloatArray

TIMES = np.linspace(0.0, 3.0, 60)
TRUE = np.array([2.0, 0.7, 1.3])
SIGMA = 0.02


def decay(rng: np.random.Generator, outliers: int = 0) -> tuple[FitProblem, FloatArray]:
    """A decay to a level, seen with noise: amplitude, rate and level; and what was seen (60,)."""
    seen = TRUE[0] * np.exp(-TRUE[1] * TIMES) + TRUE[2] + rng.normal(scale=SIGMA, size=len(TIMES))
    seen[:outliers] += 1.0

    def evaluate(x: FloatArray) -> Linearisation:
        fall = np.exp(-x[1] * TIMES)
        return Linearisation(
            residual=(x[0] * fall + x[2] - seen) / SIGMA,
            jacobian=np.column_stack([fall, -x[0] * TIMES * fall, np.ones(len(TIMES))]) / SIGMA,
        )

    loss = Loss.SOFT_L1 if outliers else Loss.SQUARED
    return FitProblem(evaluate=evaluate, prior_sigma=np.full(3, np.inf), step_scale=np.ones(3), loss=loss), seen


@pytest.mark.parametrize(("outliers", "most", "within"), [(0, 7, 1e-3), (4, 30, 0.01)])
def test_it_ends_at_the_least_cost_and_soon(rng: np.random.Generator, outliers: int, most: int, within: float) -> None:
    """Against SciPy's own loss and the smallest tolerances: the same to ``within`` sigmas.

    With the soft loss steps shorten the way by a share only, and SciPy's tolerance of the cost ends the fit first.
    """
    problem, seen = decay(rng, outliers)
    found = minimise(problem, np.array([1.0, 1.0, 0.0]))
    assert found.converged
    # measured over five draws: 5 to 6 and 17 to 25
    assert found.iterations <= most
    exact = least_squares(
        lambda x: (x[0] * np.exp(-x[1] * TIMES) + x[2] - seen) / SIGMA,
        TRUE,
        loss="soft_l1" if outliers else "linear",
        f_scale=SOFT_L1_SIGMA,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    off = (found.parameters - exact.x) / np.sqrt(np.diag(found.covariance))
    assert np.abs(off).max() < within
    np.testing.assert_array_equal(found.linearisation.residual, problem.linearise(found.parameters).residual)


def test_from_the_solution_on_one_evaluation_is_enough(rng: np.random.Generator) -> None:
    problem, _ = decay(rng)
    first = minimise(problem, TRUE)
    again = minimise(problem, first.parameters)
    assert again.iterations == 1
    np.testing.assert_array_equal(again.parameters, first.parameters)


def test_a_fit_that_is_not_at_its_end_says_so(rng: np.random.Generator) -> None:
    problem, _ = decay(rng)
    assert not minimise(problem, np.array([1.0, 1.0, 0.0]), most_evaluations=2).converged
