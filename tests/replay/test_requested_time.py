"""Output at a requested time: the covariance grows as the error does, ahead, and is sharper behind than before."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.messages import Kinematics
from groundstation.simulation import SimulatedFlight, case_b, simulate
from groundstation.simulation.standard_cases import BOUND_PSD_M2_S3
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.simulation.test_consistency import drawn_start

AHEAD_S = (0.0, 0.05, 0.11, 0.2)


def tuned() -> Config:
    config = Config()
    psd = BOUND_PSD_M2_S3
    own = replace(
        config.estimation,
        acceleration_psd_m2_s3=psd,
        manoeuvre_psd_m2_s3=psd,
        labelled_sigma_px=0.5,
        fix_window_s=0.005,
    )
    return replace(config, estimation=own)


def fly(seed: int) -> tuple[SimulatedFlight, dict[tuple[int, float], Kinematics]]:
    """Each fiftieth estimate requested at several times ahead, and just after it for half a second before."""
    flight = simulate(case_b(seed=seed, white_encoder=True))
    pipeline = Pipeline(flight.rig, tuned(), initial=drawn_start(flight, seed))
    asked: dict[tuple[int, float], Kinematics] = {}
    for event in flight.events:
        for e in pipeline.step(event).estimates:
            if e.epoch % 50 == 20:
                for ahead in (*AHEAD_S, -0.3):
                    at = pipeline.estimate_at(e.t_s + ahead)
                    assert at is not None
                    asked[e.epoch, ahead] = at
    return flight, asked


@pytest.fixture(scope="module")
def flights() -> list:
    return [fly(seed) for seed in range(12)]


@pytest.mark.parametrize("ahead", [*AHEAD_S, -0.3])
def test_the_error_at_a_requested_time_is_consistent(flights: list, ahead: float) -> None:
    """Position and velocity together, six degrees of freedom, four times a flight, on flights of the filter's model."""
    squares = []
    for flight, asked in flights:
        for (epoch, when), at in asked.items():
            if when != ahead:
                continue
            t = np.array([flight.truth.t_s[epoch] + when])
            truth = np.concatenate(
                [flight.scenario.trajectory.position(t)[0], flight.scenario.trajectory.velocity(t)[0]]
            )
            e = np.concatenate([at.position_runway_m, at.velocity_runway_m_s]) - truth
            squares.append(e @ np.linalg.solve(at.covariance, e))
    low, high = chi2.ppf([0.002, 0.998], 6 * len(squares)) / len(squares)
    assert len(squares) >= 48
    assert low < np.mean(squares) < high


def test_the_covariance_grows_ahead_and_not_behind(flights: list) -> None:
    for _, asked in flights:
        for (epoch, ahead), at in asked.items():
            if ahead == 0.0:
                now = np.diag(at.covariance)
                for more in AHEAD_S[1:]:
                    assert np.all(np.diag(asked[epoch, more].covariance) > now)
                # 0.3 s of later measurements: the velocity is known better than it is now
                assert np.all(np.diag(asked[epoch, -0.3].covariance)[3:] < now[3:])


def test_without_an_estimate_it_returns_none() -> None:
    """Before a target, and further back than the window reaches: None."""
    flight = simulate(case_b(seed=1))
    pipeline = Pipeline(flight.rig, tuned(), initial=drawn_start(flight, 1))
    assert pipeline.estimate_at(0.0) is None
    for event in flight.events:
        if event.t_s < 5.0:
            pipeline.step(event)
    assert pipeline.estimate_at(4.7) is not None
    assert pipeline.estimate_at(2.0) is None


def test_an_epochs_stamp_before_its_last_exposure_has_no_effect() -> None:
    """Cameras 60 ms apart: the estimate at their mean is no less certain than the newest, in each direction."""
    scenario = case_b(seed=3, white_encoder=True, ptu_hz=50.0)
    cameras = {**scenario.cameras, "right": replace(scenario.cameras["right"], phase_s=0.06)}
    flight = simulate(replace(scenario, cameras=cameras))
    pipeline = Pipeline(flight.rig, tuned(), initial=drawn_start(flight, 3))
    compared = 0
    for event in flight.events:
        for e in pipeline.step(event).estimates:
            if e.kinematics is not None and e.t_s > 5.0:
                newest = pipeline.estimate_at(e.t_s + 0.03)
                assert newest is not None
                now = np.diag(newest.covariance)
                # the target was further away then, by 0.03 s
                assert np.all(np.diag(e.kinematics.covariance) < 1.02 * now)
                compared += 1
    assert compared > 100
