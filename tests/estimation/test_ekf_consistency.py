"""The filter's covariance is earned: NEES, NIS and RMSE on flights drawn from its own motion model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.stereo_rig import STEP_RAD, flight_events, make_rig

RUNS = 16
PSD = (0.05, 0.1, 0.05)


def drawn_path(generator: np.random.Generator, duration_s: float, dt: float = 0.01):
    """A track of constant velocity driven by white acceleration of the filter's own PSD."""
    n = int((duration_s + 2.0) / dt)
    velocity = np.array([0.0, -20.0, -1.0]) + np.cumsum(
        generator.normal(0, 1, (n, 3)) * np.sqrt(np.array(PSD) * dt), axis=0
    )
    position = np.array([0.0, 330.0, 18.0]) + np.cumsum(velocity, axis=0) * dt
    times = np.arange(n) * dt - 1.0

    def path(t: float):
        return np.array([np.interp(t, times, position[:, k]) for k in range(3)])

    return path


@pytest.fixture(scope="module")
def runs() -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of each run: normalised error squares (3 dof) and NIS of the pixels after settling, and errors."""
    config = Config()
    config = replace(
        config,
        estimation=replace(
            config.estimation,
            acceleration_psd_m2_s3=PSD,
            ptu_acceleration_psd_rad2_s3=1e-5,
            labelled_sigma_px=0.5,
            fix_window_s=0.005,
        ),
    )
    rig = make_rig()
    out = []
    for run in range(RUNS):
        generator = np.random.default_rng(1000 + run)
        path = drawn_path(generator, 10.0)
        pipeline = Pipeline(rig, config, span_m=2.3)
        nees, nis, errors = [], [], []
        for event in flight_events(rig, path, generator, duration_s=10.0):
            report = pipeline.step(event)
            nis += [c.innovation.nis for c in report.cameras if c.innovation is not None and c.t_s > 4.0]
            for estimate in report.estimates:
                if estimate.t_s < 4.0:
                    continue
                assert estimate.kinematics is not None
                e = estimate.kinematics.position_runway_m - path(estimate.t_s)
                nees.append(e @ np.linalg.solve(estimate.kinematics.covariance[:3, :3], e))
                errors.append(e)
        out.append((np.array(nees), np.array(nis), np.array(errors)))
    return out


def test_nees(runs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Successive errors of one run are correlated, so the bound counts independent runs at a few times apart."""
    samples = np.concatenate([nees[[0, 20, 40, -1]] for nees, _, _ in runs])
    low, high = chi2.ppf([0.005, 0.995], 3 * len(samples)) / len(samples)
    assert low < samples.mean() < high


def test_nis(runs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Innovations are white: all count."""
    nis = np.concatenate([r[1] for r in runs])
    low, high = chi2.ppf([0.005, 0.995], 2 * len(nis)) / len(nis)
    assert low < nis.mean() < high


def test_error_is_at_the_posterior_bound(runs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """At the end of the run (y ≈ 130 m) the RMSE is at the bound, within the resolution of 16 runs."""
    last = np.array([errors[-1] for _, _, errors in runs])
    rmse = np.sqrt((last**2).mean(axis=0))
    y, b, f = 130.0, 10.77, 6667.0
    single = np.hypot(0.5 / f, STEP_RAD / np.sqrt(12))
    one_fix = np.array([y * single / 2**0.5, 2**0.5 * y**2 * single / b])
    assert rmse[0] < one_fix[0]
    assert rmse[1] < 0.6 * one_fix[1], "the filter gains on a single fix along the runway"
