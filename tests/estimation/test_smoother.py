"""The backward pass over the journal: exact in the linear case, consistent on flights drawn from the model, bounded."""

import copy
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.journal import FilterJournal
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.smoother import Smoother
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.measurements import ReferencePosition
from groundstation.messages import (
    Epoch,
    Event,
    InitialState,
    Kinematics,
    PixelMeasurement,
    StepReport,
    TrackEstimate,
    TrackStatus,
)
from groundstation.simulation import SimulatedFlight, StationErrors, case_b, perturbed, simulate
from groundstation.simulation.standard_cases import BOUND_PSD_M2_S3
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.simulation.test_consistency import drawn_start
from tests.stereo_rig import flight_events, glide, make_rig

PSD = (0.3, 0.6, 0.3)


def position_filter(
    prior: ParameterPrior | None = None, gate_probability: float = 1 - 1e-9, **options: object
) -> StationEkf:
    """A filter that is fed positions only: all is linear."""
    config = EstimationConfig(
        acceleration_psd_m2_s3=PSD,
        manoeuvre_psd_m2_s3=PSD,
        gate_probability=gate_probability,
        **options,  # type: ignore[arg-type]
    )
    return StationEkf({}, (), config, prior, FilterJournal())


def drive(
    ekf: StationEkf, generator: np.random.Generator, count: int = 40
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,), measured positions (n, 3) and their sigma."""
    times = np.cumsum(generator.uniform(0.05, 0.3, count))
    path = np.column_stack([np.sin(times), 100.0 - 5.0 * times, 10.0 + np.cos(0.5 * times)])
    measured = path + generator.normal(0, 0.5, path.shape)
    ekf.predict_to(0.0)
    ekf.start_target(np.array([0.0, 100.0, 10.0]), np.array([0.0, -5.0, 0.0]), np.diag([4.0] * 3 + [1.0] * 3))
    for t, z in zip(times, measured, strict=True):
        ekf.predict_to(float(t))
        ekf.update_reference(ReferencePosition(z, np.eye(3) * 0.25))
    return times, measured, path


def batch(times: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares over all states at once: means (n+1, 6), covariances (n+1, 6, 6)."""
    n = len(times) + 1
    information, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    first = np.diag([4.0] * 3 + [1.0] * 3)
    information[:6, :6] = np.linalg.inv(first)
    vector[:6] = np.linalg.solve(first, [0.0, 100.0, 10.0, 0.0, -5.0, 0.0])
    for k, dt in enumerate(np.diff(np.concatenate([[0.0], times]))):
        F = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
        q = np.diag(PSD)
        W = np.linalg.inv(np.block([[q * dt**3 / 3, q * dt**2 / 2], [q * dt**2 / 2, q * dt]]))
        a, b = slice(6 * k, 6 * k + 6), slice(6 * k + 6, 6 * k + 12)
        information[a, a] += F.T @ W @ F
        information[a, b] -= F.T @ W
        information[b, a] -= W @ F
        information[b, b] += W
        information[6 * k + 6 : 6 * k + 9, 6 * k + 6 : 6 * k + 9] += np.eye(3) / 0.25
        vector[6 * k + 6 : 6 * k + 9] += measured[k] / 0.25
    P = np.linalg.inv(information)
    x = (P @ vector).reshape(n, 6)
    return x, np.array([P[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(n)])


def smoothed(ekf: StationEkf, wanted: list[float], max_bytes: float = 2.5e8) -> dict[float, tuple]:
    found: dict[float, tuple] = {}
    smoother = Smoother(ekf.motion_over, lambda t, x, P: found.__setitem__(t, (x, P)), max_bytes)
    for t in wanted:
        smoother.request(t)
    ekf._filter.journal.history.archive = smoother.take
    ekf.close_history()
    return found


def test_it_is_the_batch_least_squares_solution() -> None:
    ekf = position_filter()
    times, measured, _ = drive(ekf, np.random.default_rng(1))
    x, P = batch(times, measured)
    found = smoothed(ekf, [0.0, *map(float, times)])
    assert len(found) == len(times) + 1
    for k, t in enumerate([0.0, *map(float, times)]):
        sigma = np.sqrt(np.diag(P[k]))
        np.testing.assert_allclose((found[t][0] - x[k]) / sigma, 0.0, atol=1e-6)
        np.testing.assert_allclose((found[t][1] - P[k]) / np.outer(sigma, sigma), 0.0, atol=1e-6)


def test_a_time_before_the_filters_is_smoothed_by_the_same_formula() -> None:
    """`kinematics_at` behind the filter's time, at a measurement's and between two: the batch solution there."""
    ekf = position_filter()
    times, measured, _ = drive(ekf, np.random.default_rng(2))
    x, P = batch(times, measured)
    at = ekf.kinematics_at(float(times[-6]))
    np.testing.assert_allclose(at.position_runway_m, x[-6, :3], atol=1e-6)
    np.testing.assert_allclose(at.covariance, P[-6], atol=1e-6)
    between = float(0.5 * (times[-6] + times[-5]))
    # an instant without a measurement of its own changes nothing
    measured_too = np.insert(measured, len(times) - 5, 0.0, axis=0)
    free = position_filter()
    free.predict_to(0.0)
    free.start_target(np.array([0.0, 100.0, 10.0]), np.array([0.0, -5.0, 0.0]), np.diag([4.0] * 3 + [1.0] * 3))
    for k, t in enumerate(np.insert(times, len(times) - 5, between)):
        free.predict_to(float(t))
        if float(t) != between:
            free.update_reference(ReferencePosition(measured_too[k], np.eye(3) * 0.25))
    np.testing.assert_allclose(
        ekf.kinematics_at(between).position_runway_m, free.kinematics_at(between).position_runway_m, atol=1e-8
    )
    # sharper than the motion model backwards, which adds its noise
    assert np.all(np.diag(ekf.kinematics_at(between).covariance) < np.diag(super_at(ekf, between).covariance))


def test_the_estimate_at_the_filters_own_time_is_the_motion_models_over_no_time() -> None:
    ekf = position_filter()
    drive(ekf, np.random.default_rng(3))
    assert ekf.time_s is not None
    F, Q = ekf.motion_over(0.0, np.ones(1))
    now = ekf.kinematics_at(ekf.time_s)
    position, velocity = (F @ ekf.state)[ekf.layout.position], (F @ ekf.state)[ekf.layout.velocity]
    np.testing.assert_array_equal(now.position_runway_m, position)
    np.testing.assert_array_equal(now.velocity_runway_m_s, velocity)
    target = ekf.layout.target
    np.testing.assert_array_equal(now.covariance, (F @ ekf.covariance @ F.T + Q)[target, target])


def super_at(ekf: StationEkf, t_s: float) -> Kinematics:
    without_journal = copy.copy(ekf)
    without_journal._filter = copy.copy(ekf._filter)
    without_journal._filter.journal = None
    return without_journal.kinematics_at(t_s)


def test_later_estimates_apply_before_and_considered_parameters_stay() -> None:
    """A DGPS clock's offset: estimated, its last value is the smoothed one; considered, it keeps its sigma."""
    prior = ParameterPrior.independent(["dgps_clock.offset"], [0.1])
    learnt = position_filter(prior)
    times, _, _ = drive(learnt, np.random.default_rng(3))
    last, variance = float(learnt.state[6]), float(learnt.covariance[6, 6])
    assert variance < 0.01
    for x, P in smoothed(learnt, [float(t) for t in times[::5]]).values():
        assert x[6] == pytest.approx(last, abs=1e-6)
        assert P[6, 6] == pytest.approx(variance, rel=1e-5)
    considered = position_filter(prior, calibration="consider")
    times, _, _ = drive(considered, np.random.default_rng(3))
    for x, P in smoothed(considered, [float(t) for t in times[::5]]).values():
        assert x[6] == pytest.approx(0.0, abs=1e-9)
        assert P[6, 6] == pytest.approx(0.01)
        # 0.1 s at 5 m/s: no flight is long enough to take that away
        assert P[1, 1] > 0.9 * (0.1 * 5.0) ** 2


def test_a_long_flight_is_smoothed_in_parts() -> None:
    """Held to 200 steps of 4,000: the same answers, since the future beyond that does not matter any more."""
    whole, parts = position_filter(), position_filter()
    times, _, _ = drive(whole, np.random.default_rng(4), 4000)
    drive(parts, np.random.default_rng(4), 4000)
    wanted = [float(t) for t in times[::50]]
    a, b = smoothed(whole, wanted), smoothed(parts, wanted, max_bytes=1.0)
    assert a.keys() == b.keys()
    assert len(a) == len(wanted)
    for t in wanted:
        np.testing.assert_allclose(a[t][0], b[t][0], atol=1e-6)
        np.testing.assert_allclose(a[t][1], b[t][1], atol=1e-6)


# ------------------------------------------------------------------------------------------ simulated flights
def tuned(**estimation: object) -> Config:
    config = Config()
    own = {"acceleration_psd_m2_s3": BOUND_PSD_M2_S3, "manoeuvre_psd_m2_s3": BOUND_PSD_M2_S3}
    tuning = replace(config.estimation, labelled_sigma_px=0.5, fix_window_s=0.005, **{**own, **estimation})  # type: ignore[arg-type]
    return replace(config, estimation=tuning)


def flown(events: tuple[Event, ...] | Iterator[Event], pipeline: Pipeline) -> tuple[dict, dict]:
    """The filter's estimates, and the smoothed kinematics, by time."""
    found: dict[float, Kinematics] = {}
    estimates: dict[float, TrackEstimate] = {}
    want = pipeline.smooth(found.__setitem__)

    def take(report: StepReport) -> None:
        for e in report.estimates:
            estimates[e.t_s] = e
            if e.kinematics is not None:
                want(e.t_s)

    for event in events:
        take(pipeline.step(event))
    take(pipeline.finish())
    pipeline.finish_smoothing()
    return estimates, found


@pytest.fixture(scope="module")
def drawn() -> list[tuple[SimulatedFlight, dict, dict]]:
    flights = []
    for seed in range(8):
        flight = simulate(case_b(seed=seed, white_encoder=True))
        pipeline = Pipeline(flight.rig, tuned(), initial=drawn_start(flight, seed))
        flights.append((flight, *flown(flight.events, pipeline)))
    return flights


def errors(flight: SimulatedFlight, found: dict[float, Kinematics]) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 3) and their normalised squares (n,) at each tenth of a flight."""
    t = flight.truth.t_s
    chosen = [k for k in range(10, len(t) - 1, 20) if float(t[k]) in found]
    assert len(chosen) > 8
    off = np.array([found[float(t[k])].position_runway_m - flight.truth.position_runway_m[k] for k in chosen])
    P = np.array([found[float(t[k])].covariance[:3, :3] for k in chosen])
    return off, np.einsum("ni,ni->n", off, np.linalg.solve(P, off[:, :, None])[:, :, 0])


def test_the_smoother_is_better_than_the_filter_and_consistent(drawn: list) -> None:
    """Eight flights drawn from the motion model: RMSE along the runway below 0.75 × the filter's, NEES in χ² bounds.

    Times are two seconds apart, so that errors are nearly independent.
    """
    later, filtered = [], []
    squares = []
    for flight, estimates, found in drawn:
        off, nees = errors(flight, found)
        later.append(off)
        squares.append(nees)
        filtered.append(errors(flight, {t: e.kinematics for t, e in estimates.items() if e.kinematics is not None})[0])
    ratio = np.sqrt((np.concatenate(later) ** 2).mean(axis=0) / (np.concatenate(filtered) ** 2).mean(axis=0))
    assert ratio[1] < 0.75
    assert np.all(ratio < 0.95)
    nees = np.concatenate(squares)
    low, high = chi2.ppf([0.002, 0.998], 3 * len(nees)) / len(nees)
    assert low < nees.mean() < high


def test_what_calibration_costs_stays_in_the_smoothed_covariance() -> None:
    """Pan errors of 0.01° at each station, considered: six flights, mean NEES of the smoothed track within reason.

    The error of a flight is nearly one number, so the bound is that of six values, with three sure degrees each.
    """
    sigma = np.radians(0.01)
    per_flight = []
    for seed in range(6):
        generator = np.random.default_rng([seed, 5])
        scenario = case_b(seed=seed, white_encoder=True)
        mounts = {
            name: StationErrors(mount_rad=np.array([0.0, 0.0, generator.normal(0.0, sigma)]))
            for name in ("left", "right")
        }
        stated = perturbed(scenario.true_rig, mounts)
        rig = replace(
            stated,
            stations=tuple(
                replace(s, covariance_parameters=("runway_from_base.z",), covariance=np.array([[sigma**2]]))
                for s in stated.stations
            ),
        )
        flight = simulate(replace(scenario, rig=rig))
        pipeline = Pipeline(rig, tuned(calibration="consider"), initial=drawn_start(flight, seed))
        _, found = flown(flight.events, pipeline)
        assert all(np.linalg.eigvalsh(k.covariance)[0] > 0.0 for k in found.values())
        per_flight.append(errors(flight, found)[1].mean())
    low, high = chi2.ppf([0.002, 0.998], 3 * len(per_flight)) / len(per_flight)
    assert low < np.mean(per_flight) < high


def test_nothing_is_smoothed_where_there_was_no_target() -> None:
    """Lost in the middle, acquired again: two tracks, each smoothed by itself; no answer before, between or after."""
    events = list(flight_events(make_rig(), glide, np.random.default_rng(8), duration_s=11.0))
    cut = [e for e in events if not (isinstance(e, PixelMeasurement) and 3.5 <= e.t_s < 8.0)]
    estimates, found = flown(iter(cut), Pipeline(make_rig(), tuned(lost_after_s=2.0), span_m=2.3))
    statuses = {e.status for t, e in estimates.items() if 5.7 < t < 7.9}
    assert statuses == {TrackStatus.LOST}
    known = [t for t, e in estimates.items() if e.kinematics is not None]
    assert sorted(found) == sorted(known)
    assert not [t for t in found if 5.7 < t < 7.9]
    # the last answer before the loss is the filter's own: nothing came after it
    last = max(t for t in found if t < 7.0)
    kinematics = estimates[last].kinematics
    assert kinematics is not None
    assert found[last].covariance[1, 1] == pytest.approx(kinematics.covariance[1, 1], rel=0.05)
    # the first track is independent of the second
    alone, first = flown((e for e in cut if e.t_s < 7.0), Pipeline(make_rig(), tuned(lost_after_s=2.0), span_m=2.3))
    t = min(first)
    np.testing.assert_allclose(found[t].position_runway_m, first[t].position_runway_m, atol=1e-9)
    assert alone[t].status is TrackStatus.TRACKING


def test_smoothing_does_not_change_the_filter() -> None:
    """Late data and spikes on the way: estimates bit for bit those of a run that is not smoothed."""
    flight = simulate(case_b(seed=2))
    start = InitialState(
        t_s=0.0,
        position_runway_m=flight.truth.position_runway_m[0],
        velocity_runway_m_s=flight.truth.velocity_runway_m_s[0],
        sigma_position_m=np.full(3, 2.0),
        sigma_velocity_m_s=np.full(3, 1.0),
    )
    events = [e for e in flight.events if e.t_s < 5.0]
    held = next(e for e in events if isinstance(e, PixelMeasurement) and e.t_s > 3.0)
    events.remove(held)
    events.insert(next(k for k, e in enumerate(events) if isinstance(e, Epoch) and e.t_s > 3.3), held)
    plain = Pipeline(flight.rig, tuned(), initial=start)
    expected = [e for event in events for e in plain.step(event).estimates] + list(plain.finish().estimates)
    pipeline = Pipeline(flight.rig, tuned(), initial=start)
    got, found = flown(iter(events), pipeline)
    assert pipeline.fused_late["fused_late_frames"] == 1
    for e in expected:
        other = got[e.t_s]
        if e.kinematics is not None:
            assert np.array_equal(e.kinematics.covariance, other.kinematics.covariance)
            assert e.t_s in found
