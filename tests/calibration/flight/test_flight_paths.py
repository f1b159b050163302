"""Paths as unknowns: how smooth they are found to be, where they break, and the derivative with the paths following."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import binom, multivariate_normal

from calibration.flight.observations import gather_flight
from calibration.flight.parameters import choose_parameters
from calibration.flight.paths import PathResiduals
from calibration.flight.problem import FlightProblem
from calibration.flight.smooth_path import ORDERS, Evidence, find_smoothness, path_basis
from groundstation.session import load_session
from groundstation.simulation import simulate
from groundstation.simulation.session_folder import write_session_folder
from tests.calibration.flight.flights import approach, with_clock_sigma


def test_a_path_is_as_smooth_as_it_was_drawn(rng: np.random.Generator) -> None:
    """Differences drawn at a tenth of the noise are found to a factor of two, the noise to a tenth; nothing breaks."""
    basis = path_basis(0.0, 30.0, 0.1)
    drawn = np.cumsum(np.cumsum(np.cumsum(0.002 * rng.normal(size=basis.count))))
    t = np.arange(0.0, 30.0, 0.1)
    seen = basis.at(t) @ drawn + 0.02 * rng.normal(size=len(t))
    for stated in (0.02, 0.01):
        found = find_smoothness(basis, t, seen, np.full(len(t), stated))
        assert np.ptp(found.difference) == 0.0
        assert 0.5 < found.difference[0] / 0.002 < 2.0
        assert found.noise_factor * stated == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize("order", [2, 3])
def test_white_jerk_and_white_acceleration_are_distinguished(order: int, rng: np.random.Generator) -> None:
    """Paths drawn by either are distinguished; their samples' noise is raised no more often than by chance, 5 %.

    Of a path with gusts and 2 cm fixes, as the filter's own motion model draws it, a spline with white jerk took four
    noises of ten to be larger than stated.
    """
    basis = path_basis(0.0, 17.0, 0.1)
    t = np.arange(0.0, 17.0, 0.1)
    identified, raised = 0, 0
    for _ in range(40):
        drawn = 0.4 * 0.02 * rng.normal(size=basis.count)
        for _ in range(order):
            drawn = np.cumsum(drawn)
        found = find_smoothness(basis, t, basis.at(t) @ drawn + 0.02 * rng.normal(size=len(t)), np.full(len(t), 0.02))
        identified += found.order == order
        raised += found.noise_factor > 1.0
    assert identified >= 38
    assert raised <= binom.ppf(0.999, 40, 0.05)


def test_orders_are_compared_by_the_probability_of_the_remainder_after_parabolas(rng: np.random.Generator) -> None:
    """Banded against dense: −2 log of a normal density of the samples' contrasts that have no parabola in them."""
    basis, noise, ratio = path_basis(0.0, 4.0, 0.1), 0.03, 0.7
    t = np.arange(0.0, 4.0, 0.07)
    seen = np.cumsum(rng.normal(size=len(t))) * 0.02
    B = basis.at(t).toarray()
    away = np.arange(basis.count) - 0.5 * (basis.count - 1)
    contrasts = null_space((B @ np.stack([away**0, away, away**2], axis=1)).T)
    banded, dense = [], []
    for order in ORDERS:
        weight = rng.uniform(0.3, 1.0, basis.count - order)
        own = Evidence(basis, t, seen, np.ones(len(t)), order)
        banded.append(own.comparable(weight, ratio, noise))
        rough = np.linalg.pinv(np.sqrt(weight)[:, None] * basis.differences(order).toarray())
        spread = noise**2 * (ratio**2 * B @ rough @ rough.T @ B.T + np.eye(len(t)))
        inside = multivariate_normal(cov=contrasts.T @ spread @ contrasts)
        dense.append(-2.0 * inside.logpdf(contrasts.T @ seen))
    assert banded[0] - banded[1] == pytest.approx(dense[0] - dense[1], abs=1e-6)


def test_a_corner_is_located(rng: np.random.Generator) -> None:
    """A descent that steepens by 1.5 m/s at 15.03 s: free there, and nowhere else."""
    basis = path_basis(0.0, 30.0, 0.1)
    t = np.arange(0.0, 30.0, 0.1)
    seen = np.where(t > 15.03, -1.5 * (t - 15.03), 0.0) + 0.02 * rng.normal(size=len(t))
    found = find_smoothness(basis, t, seen, np.full(len(t), 0.02)).difference
    # difference k is about knot k + 2 − 3, 0.1 s apart
    free_s = 0.1 * (np.flatnonzero(found > 10.0 * np.median(found)) - 1.0)
    assert len(free_s)
    assert np.all(np.abs(free_s - 15.03) < 0.6)


def test_the_gradient_is_that_of_the_cost_with_the_paths_following(tmp_path: Path) -> None:
    """Of what is left over Jᵀr is the exact gradient, whatever Kaufman leaves out of J."""
    scenario = approach(2, {}, loop=True)
    write_session_folder(tmp_path / "session", simulate(scenario), name="simulated")
    session = load_session(tmp_path / "session")
    rig = with_clock_sigma(session.rig, 0.05)
    free = choose_parameters(rig, ("orientation",), dgps_clock_open=True)
    data = gather_flight(session, None, None, 6.0)
    problem = FlightProblem(
        stations={s.name: s for s in rig.stations},
        observations=data.observations,
        track=data.track,
        antenna_in_body_m=np.zeros(3),
        names=free.names,
        prior_sigma=free.prior_sigma,
    )
    at = np.zeros(len(free.names))
    kept = {name: problem.predict(name, at).usable for name in problem.observations}
    joint = PathResiduals(problem, dict.fromkeys(kept, 0.5), kept, at)
    fit_problem = joint.fit_problem()
    linearised = fit_problem.linearise(at)
    jacobian = linearised.jacobian
    gradient = jacobian.T @ linearised.residual
    # what one sigma of each parameter makes the cost's slope
    scale = np.linalg.norm(jacobian, axis=0)
    for k, name in enumerate(free.names):
        step = np.zeros(len(at))
        step[k] = 1e-4 if "clock" in name else 1e-6
        ahead, behind = (fit_problem.linearise(at + sign * step).residual for sign in (1.0, -1.0))
        numeric = (ahead @ ahead - behind @ behind) / (4.0 * step[k])
        assert gradient[k] == pytest.approx(numeric, rel=2e-2, abs=0.02 * scale[k]), name
