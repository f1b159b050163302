"""Flights in which the target leaves both images and comes back: weightings, and a miss as evidence, by their NEES."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from groundstation.estimation.config import EstimationConfig, OutOfViewWeighting
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.miss_update import moments_after_miss
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.standard_cases import drawn_glide
from tests.stereo_rig import aim, make_rig

PSD = (1.0, 4.0, 2.0)
SIZE = (1280, 960)
LEAVES_S, BACK_S = 2.0, 4.5


def fly(seed: int, weighting: OutOfViewWeighting, miss_share: float = 0.0) -> dict[str, list[float]]:
    """From 2 to 4.5 s both heads follow where the target would be without manoeuvres, turned away by half the image's
    width ± 60 px; then they follow the target. Squared errors per degree of freedom, by its position.

    Every target inside is detected; ``miss_share`` is the assumed detection probability of a missed detection.
    """
    rng = np.random.default_rng([seed, 3])
    rig = make_rig()
    path = drawn_glide(seed, PSD, GlideApproach(start_y_m=350.0, end_y_m=180.0))
    config = replace(EstimationConfig(), out_of_view=weighting)
    geometries = {s.name: s.geometry() for s in rig.stations}
    ekf = StationEkf(geometries, rig.names, config)
    out: dict[str, list[float]] = {"before": [], "away": [], "after": []}
    sigma_angle = 3e-5
    away = (640.0 + rng.uniform(-60.0, 60.0)) / 6667.0
    leaving = np.array([LEAVES_S])
    for t in np.arange(0.0, 6.5, 0.1):
        point, velocity = path.position(np.array([t]))[0], path.velocity(np.array([t]))[0]
        ekf.predict_to(t)
        aimed, turned = point, 0.0
        if LEAVES_S <= t < BACK_S:
            aimed = path.position(leaving)[0] + (t - LEAVES_S) * path.velocity(leaving)[0]
            turned = away
        pointed = {}
        for station in rig.stations:
            pan, tilt = aim(geometries[station.name], aimed)
            pointed[station.name] = (pan + turned, tilt)
            read = np.array(pointed[station.name]) + rng.normal(0, sigma_angle, 2)
            ekf.set_angles(station.name, (read[0], read[1]), (0.0, 0.0), sigma_angle)
        if t == 0.0:
            start = rng.normal(0, 1.0, 6) * [1, 5, 1, 1, 2, 1]
            ekf.start_target(point + start[:3], velocity + start[3:], np.diag([1, 25, 1, 1, 4, 1.0]))
        for station in rig.stations:
            geometry = geometries[station.name]
            projection = geometry.project(point, *pointed[station.name])
            assert projection is not None
            noise = rng.normal(0, 0.5, 2)
            if geometry.contains(projection.pixel):
                ekf.update_pixel(station.name, projection.pixel + noise, 0.25 * np.eye(2))
            elif miss_share > 0.0:
                ekf.update_miss(station.name, miss_share)
        k = ekf.kinematics_at(t)
        d = k.position_runway_m - point
        where = "before" if t < LEAVES_S else "away" if t < BACK_S else "after"
        if t > 1.0:
            out[where].append(float(d @ np.linalg.solve(k.covariance[:3, :3], d)) / 3.0)
            out.setdefault(f"{where} x", []).append(float(d[0]))
    return out


@cache
def flown(weighting: OutOfViewWeighting, miss_share: float = 0.0, flights: int = 40) -> dict[str, float]:
    """Mean squares of all flights together, rms of x."""
    found = [fly(seed, weighting, miss_share) for seed in range(flights)]
    out = {}
    for part in found[0]:
        values = np.concatenate([f[part] for f in found])
        out[part] = float(np.sqrt(np.mean(values**2)) if part.endswith("x") else np.mean(values))
    return out


@pytest.mark.parametrize("weighting", [OutOfViewWeighting.CONSISTENT, OutOfViewWeighting.GAIN])
def test_noise_over_t_and_gain_times_t_are_consistent(weighting: OutOfViewWeighting) -> None:
    """While the target is about the border, the squared errors are consistent with the covariance."""
    result = flown(weighting)
    assert 0.8 < result["before"] < 1.3
    assert 0.75 < result["away"] < 1.3
    assert 0.75 < result["after"] < 1.3


def test_the_papers_form_is_overconfident() -> None:
    assert flown(OutOfViewWeighting.PAPER, flights=12)["away"] > 3.0


def test_a_missed_detection_gives_information_on_the_position() -> None:
    """Misses as evidence: a tenth less error while the target is away, and still consistent."""
    blind, weighted = flown(OutOfViewWeighting.CONSISTENT), flown(OutOfViewWeighting.CONSISTENT, miss_share=0.2)
    assert weighted["away x"] < 0.9 * blind["away x"]
    assert 0.75 < weighted["away"] < 1.3


def test_a_miss_moves_belief_outside(rng: np.random.Generator) -> None:
    """Against sampling: at the border, in a corner, with correlation; far inside the shape does not change."""
    S = np.array([[900.0, 250.0], [250.0, 400.0]])
    for centre in ([10.0, 480.0], [-20.0, 500.0], [1275.0, 950.0]):
        samples = rng.multivariate_normal(centre, S, 200_000)
        inside = np.all((samples >= -0.5) & (samples <= np.array(SIZE) - 0.5), axis=1)
        weights = np.where(inside, 1.0 - 0.8, 1.0)
        mean = np.average(samples, axis=0, weights=weights)
        covariance = np.cov(samples.T, aweights=weights)
        found, spread = moments_after_miss(np.array(centre), S, SIZE, 0.8)
        np.testing.assert_allclose(found, mean, atol=1.5)
        np.testing.assert_allclose(spread, covariance, atol=0.1 * S[0, 0])
    found, spread = moments_after_miss(np.array([640.0, 480.0]), S, SIZE, 0.8)
    np.testing.assert_allclose(found, [640.0, 480.0], atol=1e-6)
    np.testing.assert_allclose(spread, S, rtol=1e-6)
