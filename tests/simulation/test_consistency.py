"""What the simulator draws is what the estimators assume: noise as the bounds have it, and a consistent filter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.messages import Epoch, InitialState, TrackEstimate
from groundstation.simulation import Scenario, SimulatedFlight, case_b, case_c, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.detection_camera import CameraModel
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.standard_cases import BASELINE_M, BOUND_PSD_M2_S3, FOCAL_PX, STEP_RAD
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.simulation.observed import triangulated

AROUND_200_M = GlideApproach(start_y_m=210.0, end_y_m=190.0)
PRIOR_SIGMA = (10.0, 5.0)


@pytest.mark.parametrize(
    ("make", "pixel_px", "angle_rad", "expected_y_m"),
    [
        (lambda seed: case_b(seed=seed, trajectory=AROUND_200_M, white_encoder=True), 0.5, STEP_RAD / 12**0.5, 0.43),
        (lambda seed: case_c(seed=seed, trajectory=AROUND_200_M), 1.0, STEP_RAD, 0.98),
    ],
    ids=["B", "C"],
)
def test_one_fix_is_as_uncertain_as_the_bounds_say(
    make: object, pixel_px: float, angle_rad: float, expected_y_m: float
) -> None:
    """σ_y = √2 y² σ_θ / b and σ_x = y σ_θ / √2 at y = 200 m: all fixes of 30 flights against χ²."""
    assert callable(make)
    ray_rad = np.hypot(pixel_px / FOCAL_PX, angle_rad)
    squares = []
    for seed in range(30):
        flight = simulate(make(seed))
        error = triangulated(flight)[1] - flight.truth.position_runway_m
        y = flight.truth.position_runway_m[:, 1]
        squares.append(
            np.column_stack(
                [error[:, 0] / (y * ray_rad / 2**0.5), error[:, 1] / (2**0.5 * y**2 * ray_rad / BASELINE_M)]
            )
            ** 2
        )
    assert 2**0.5 * 200.0**2 * ray_rad / BASELINE_M == pytest.approx(expected_y_m, abs=0.01)
    n = sum(len(s) for s in squares)
    low, high = chi2.ppf([0.001, 0.999], n) / n
    ratio = np.concatenate(squares).mean(axis=0)
    assert np.all((low < ratio) & (ratio < high))


def answers(flight: SimulatedFlight, initial: InitialState | None = None) -> dict[int, TrackEstimate]:
    config = Config()
    tuning = replace(
        config.estimation, acceleration_psd_m2_s3=BOUND_PSD_M2_S3, labelled_sigma_px=0.5, fix_window_s=0.005
    )
    pipeline = Pipeline(flight.rig, replace(config, estimation=tuning), initial=initial)
    reports = [*(pipeline.step(event) for event in flight.events), pipeline.finish()]
    assert pipeline.counts["late_ptu"] == pipeline.counts["late_frames"] == 0
    return {e.epoch: e for report in reports for e in report.estimates if e.kinematics is not None}


def drawn_start(flight: SimulatedFlight, seed: int) -> InitialState:
    """The truth, off by a draw from the bounds' prior."""
    off = np.random.default_rng([seed, 9]).normal(size=(2, 3)) * np.array(PRIOR_SIGMA)[:, None]
    return InitialState(
        t_s=0.0,
        position_runway_m=flight.truth.position_runway_m[0] + off[0],
        velocity_runway_m_s=flight.truth.velocity_runway_m_s[0] + off[1],
        sigma_position_m=np.full(3, PRIOR_SIGMA[0]),
        sigma_velocity_m_s=np.full(3, PRIOR_SIGMA[1]),
    )


def test_the_filter_is_consistent_on_tracks_drawn_from_its_model() -> None:
    """Case B with white angles: squared errors by the filter's own covariance, six times a flight, 14 flights."""
    nees = []
    for seed in range(14):
        flight = simulate(case_b(seed=seed, white_encoder=True))
        estimates = answers(flight, drawn_start(flight, seed))
        for k in range(10, 216, 35):
            kinematics = estimates[k].kinematics
            assert kinematics is not None
            error = kinematics.position_runway_m - flight.truth.position_runway_m[k]
            nees.append(error @ np.linalg.solve(kinematics.covariance[:3, :3], error))
    low, high = chi2.ppf([0.002, 0.998], 3 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high


def delayed() -> Scenario:
    """Readings and pixels come with delays of their own, out of the order of their stamps."""
    cameras = {
        "left": CameraModel(latency_s=0.02),
        "right": CameraModel(latency_s=0.05, phase_s=0.003),
    }
    ptus = {"left": PtuModel(delay_s=0.03, delay_jitter_s=0.02), "right": PtuModel(rate_hz=40.0, phase_s=0.007)}
    return replace(case_b(seed=3, trajectory=GlideApproach(start_y_m=400.0, end_y_m=250.0)), cameras=cameras, ptus=ptus)


def test_the_order_of_arrival_does_not_change_the_answers() -> None:
    flight = simulate(delayed())
    # an epoch's stamp is the mean of its frames', and it comes after the last of them
    last_s = 0.003
    stamps = [e.t_s + (last_s if isinstance(e, Epoch) else 0.0) for e in flight.events]
    order = np.lexsort(([isinstance(e, Epoch) for e in flight.events], stamps))
    in_order = replace(flight, events=tuple(flight.events[k] for k in order))
    assert in_order.events != flight.events
    start = drawn_start(flight, 3)
    live, sorted_out = answers(flight, start), answers(in_order, start)
    assert live.keys() == sorted_out.keys()
    assert len(live) > 50
    for k, estimate in live.items():
        mine, other = estimate.kinematics, sorted_out[k].kinematics
        assert mine is not None
        assert other is not None
        assert np.array_equal(mine.position_runway_m, other.position_runway_m)
