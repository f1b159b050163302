"""Paths as unknowns: how smooth they are found to be, where they break, and the derivative with the paths following."""

from pathlib import Path

import numpy as np
import pytest

from calibration.flight_data import gather_flight
from calibration.flight_parameters import choose_parameters
from calibration.flight_paths import PathResiduals
from calibration.flight_problem import FlightProblem
from calibration.smooth_path import find_smoothness, path_basis
from groundstation.session import load_session
from groundstation.simulation import simulate
from groundstation.sinks.session_folder import write_session_folder
from tests.calibration.flights import approach, with_clock_sigma


def test_a_path_is_as_smooth_as_it_was_drawn(rng: np.random.Generator) -> None:
    """Differences drawn at a tenth of the noise are found to a factor of two, the noise to a tenth; nothing breaks."""
    basis = path_basis(0.0, 30.0, 0.1)
    drawn = np.cumsum(np.cumsum(np.cumsum(0.002 * rng.normal(size=basis.count))))
    t = np.arange(0.0, 30.0, 0.1)
    seen = basis.at(t) @ drawn + 0.02 * rng.normal(size=len(t))
    for stated in (0.02, 0.01):
        found = find_smoothness(basis, t, seen, np.full(len(t), stated))
        assert np.ptp(found.third_difference) == 0.0
        assert 0.5 < found.third_difference[0] / 0.002 < 2.0
        assert found.noise_factor * stated == pytest.approx(0.02, rel=0.15)


def test_a_corner_is_found_where_it_is(rng: np.random.Generator) -> None:
    """A descent that steepens by 1.5 m/s at 15.03 s: free there, and nowhere else."""
    basis = path_basis(0.0, 30.0, 0.1)
    t = np.arange(0.0, 30.0, 0.1)
    seen = np.where(t > 15.03, -1.5 * (t - 15.03), 0.0) + 0.02 * rng.normal(size=len(t))
    found = find_smoothness(basis, t, seen, np.full(len(t), 0.02)).third_difference
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
        looks=data.looks,
        track=data.track,
        antenna_in_body_m=np.zeros(3),
        names=free.names,
        prior_sigma=free.prior_sigma,
    )
    at = np.zeros(len(free.names))
    kept = {name: problem.predict(name, at).usable for name in problem.looks}
    joint = PathResiduals(problem, dict.fromkeys(kept, 0.5), kept, at)
    jacobian = joint.jacobian(at)
    gradient = jacobian.T @ joint.residual(at)
    # what one sigma of each parameter makes the cost's slope
    scale = np.linalg.norm(jacobian, axis=0)
    for k, name in enumerate(free.names):
        step = np.zeros(len(at))
        step[k] = 1e-4 if "clock" in name else 1e-6
        ahead, behind = (joint.residual(at + sign * step) for sign in (1.0, -1.0))
        numeric = (ahead @ ahead - behind @ behind) / (4.0 * step[k])
        assert gradient[k] == pytest.approx(numeric, rel=2e-2, abs=0.02 * scale[k]), name
