"""The compiled filter and filterpy's classes agree: steps, mixing, smoothing, updates, whole flights."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.arrays import FloatArray
from groundstation.errors import ConfigError
from groundstation.estimation.config import CalibrationUse, EstimationConfig, FilterImplementation, OutOfViewWeighting
from groundstation.estimation.filterpy_ekf import FilterpyEkf
from groundstation.estimation.filterpy_imm import FilterpyImm
from groundstation.estimation.filterpy_smoother import rts_step
from groundstation.estimation.imm import ImmFilter, ImmState
from groundstation.estimation.journal import FilterJournal
from groundstation.estimation.kalman_kernels import LinearMeasurement
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.smoother import Smoother
from groundstation.estimation.smoother_history import Transition, smooth_across
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.measurements import ReferencePosition
from groundstation.messages import Event, InitialState, PtuSample, ReferenceFix, StepReport, TrackEstimate, TrackStatus
from groundstation.tracking.config import Config, config_from_mapping
from groundstation.tracking.pipeline import Pipeline
from tests.stereo_rig import aim, flight_events, glide, make_rig

SEEDS = st.integers(0, 2**32 - 1)
AGREEMENT = 1e-9


def spread(rng: np.random.Generator, size: int) -> FloatArray:
    """A covariance (n, n) with sigmas from 10⁻⁴ to 10, as of rad and m."""
    root = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-4.0, 1.0, (size, 1))
    return np.asarray(root @ root.T + 0.1 * np.diag(np.diag(root @ root.T)))


def agree(a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray], bound: float = AGREEMENT) -> None:
    """Two means (n,) with covariances (n, n) differ by at most ``bound`` sigmas, and of σ_i σ_j."""
    sigma = np.sqrt(np.maximum(np.diag(b[1]), 0.0))
    known = sigma > 0.0
    np.testing.assert_array_equal(a[0][~known], b[0][~known])
    units = np.outer(sigma[known], sigma[known])
    # a mean of many sigmas has the rounding of its own size
    apart = np.abs(a[0] - b[0])[known] / (sigma[known] + np.abs(b[0][known]))
    assert apart.max(initial=0.0) <= bound
    assert (np.abs(a[1] - b[1])[np.ix_(known, known)] / units).max(initial=0.0) <= bound


def banks(rng: np.random.Generator, size: int, modes: int) -> tuple[ImmFilter, FilterpyImm]:
    """Both filters in one drawn state; the modes stand about a sigma apart."""
    stay_s = tuple(rng.uniform(0.5, 8.0, modes))
    ours, theirs = ImmFilter(size, stay_s), FilterpyImm(size, stay_s)
    covariances = np.array([spread(rng, size) for _ in range(modes)])
    states = rng.normal(size=(modes, size)) * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    weights = rng.dirichlet(np.ones(modes))
    ours.state = ImmState.mixed(states, covariances, weights)
    theirs.state = theirs.mixed(states, covariances, weights)
    return ours, theirs


def agree_in_all(ours: ImmFilter, theirs: ImmFilter, bound: float = AGREEMENT) -> None:
    agree((ours.x, ours.P), (theirs.x, theirs.P), bound)
    np.testing.assert_allclose(ours.weights, theirs.weights, rtol=bound)
    for k in range(len(ours.weights)):
        a, b = ours.state, theirs.state
        agree((a.states[k], a.covariances[k]), (b.states[k], b.covariances[k]), bound)


def drawn_measurement(rng: np.random.Generator, bank: ImmFilter, values: int) -> LinearMeasurement:
    """A measurement of several states at once, about as precise as its prediction, a sigma or two off."""
    sigma = np.sqrt(np.diag(bank.P))
    H = rng.normal(size=(values, sigma.size)) / sigma * (rng.random((values, sigma.size)) < 0.5)
    R = spread(rng, values)
    R = R / np.sqrt(np.outer(np.diag(R), np.diag(R))) * rng.uniform(0.1, 3.0)
    return LinearMeasurement(rng.normal(size=values) * 1.5, H, R)


@settings(max_examples=60)
@given(seed=SEEDS, size=st.integers(2, 9), modes=st.integers(1, 3), values=st.integers(1, 3))
def test_single_steps_over_drawn_states(seed: int, size: int, modes: int, values: int) -> None:
    """Mixing, prediction, update and mode probabilities, with and without likelihoods."""
    rng = np.random.default_rng(seed)
    ours, theirs = banks(rng, size, modes)
    agree_in_all(ours, theirs)
    F = np.eye(size) + np.triu(rng.normal(size=(size, size)), 1) * (rng.random((size, size)) < 0.3) * 0.1
    dt_s, noises = float(rng.uniform(0.001, 1.0)), [spread(rng, size) for _ in range(modes)]
    np.testing.assert_allclose(ours.weights_after(dt_s), theirs.weights_after(dt_s), rtol=AGREEMENT)
    for bank in (ours, theirs):
        bank.predict(F, noises, dt_s)
    agree_in_all(ours, theirs)
    estimated, share = rng.random(size) < 0.7, float(rng.uniform(0.0, 1.0))
    for updates_weights, mask, part in ((True, np.ones(size, np.bool_), 1.0), (False, estimated, share)):
        measurement = drawn_measurement(rng, ours, values)
        before = theirs.weights
        for bank in (ours, theirs):
            bank.correct(measurement, mask, updates_weights=updates_weights, share=part)
        agree_in_all(ours, theirs)
        if not updates_weights:
            np.testing.assert_array_equal(theirs.weights, before)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_resets_and_other_changes_of_the_state(seed: int) -> None:
    """Inflation, reset, correlation, new moments of a measured quantity, and the stationary probabilities."""
    rng = np.random.default_rng(seed)
    ours, theirs = banks(rng, 7, 2)
    values, variances, sensitivity = rng.normal(size=2), rng.uniform(0.1, 1.0, 2), rng.normal(size=(2, 3))
    H, estimated = rng.normal(size=(2, 7)), rng.random(7) < 0.7
    moments = 0.5 * H @ ours.P @ H.T
    for bank in (ours, theirs):
        bank.inflate(slice(1, 3), variances)
        bank.set_states(slice(3, 5), values, np.diag(variances))
        bank.correlate(slice(3, 5), slice(0, 3), sensitivity)
        bank.replace_moments(H, values, moments, estimated)
    agree_in_all(ours, theirs)
    for bank in (ours, theirs):
        bank.reset_modes()
    agree_in_all(ours, theirs)


def test_a_mode_that_no_measurement_supports_keeps_the_same_floor() -> None:
    """Five sigmas of the second mode, of the first one fifty."""
    out = []
    for kind in (ImmFilter, FilterpyImm):
        bank = kind(1, (1.0, 1.0))
        bank.state = bank.mixed(np.zeros((2, 1)), np.array([[[0.01]], [[1.0]]]), np.array([0.5, 0.5]))
        linear = LinearMeasurement(np.array([5.0]), np.ones((1, 1)), np.array([[1e-4]]))
        bank.correct(linear, np.ones(1, np.bool_), updates_weights=True)
        out.append(bank)
    agree_in_all(*out)
    assert out[1].weights[0] == pytest.approx(2e-6, rel=1e-5)


def test_filterpys_own_estimate_after_a_prediction_has_the_probabilities_of_before() -> None:
    """The reason why the mixture of a prediction is built by itself; to be used once filterpy weights with cbar."""
    modes = [FilterpyEkf(np.array([0.0]), np.eye(1)), FilterpyEkf(np.array([1.0]), np.eye(1))]
    for mode in modes:
        mode.set_motion(np.eye(1), np.zeros((1, 1)))
    change = np.array([[0.9, 0.1], [0.4, 0.6]])
    estimator = IMMEstimator(modes, np.array([0.7, 0.3]), change)
    estimator.predict()
    # the transition moves nothing, so that the mean of the mixture is the one of before
    assert estimator.cbar @ [mode.x[0] for mode in modes] == pytest.approx(0.3)
    assert estimator.x[0] != pytest.approx(0.3, abs=1e-3)


@settings(max_examples=40)
@given(seed=SEEDS, size=st.integers(2, 12), known=st.integers(0, 2))
def test_one_step_of_the_smoother(seed: int, size: int, known: int) -> None:
    """Over a prediction, a reset and exactly known states."""
    rng = np.random.default_rng(seed)
    P = spread(rng, size)
    F = np.eye(size) + 0.1 * np.triu(rng.normal(size=(size, size)), 1)
    if known and size > known:
        P[-known:], P[:, -known:] = 0.0, 0.0
        F[-known:, :-known], F[:-known, -known:] = 0.0, 0.0
    Q = spread(rng, size)
    Q[-known or size :], Q[:, -known or size :] = 0.0, 0.0
    x = rng.normal(size=size) * np.sqrt(np.diag(P))
    F[0] = 0.0 if rng.random() < 0.5 else F[0]
    P_next = F @ P @ F.T + Q
    x_next = F @ x
    x_next[0] += rng.normal() * np.sqrt(P_next[0, 0])
    none = np.zeros(1)
    step = Transition(t_s=0.0, next_s=0.1, x=x, P=P, F=F, x_next=x_next, P_next=P_next, weights=none)
    later = x_next + rng.normal(size=size) * np.sqrt(np.diag(P_next)), 0.5 * P_next
    agree(rts_step(step, *later), smooth_across(step, *later), bound=1e-8)


PRIOR = ParameterPrior.independent(
    (
        "left.runway_from_base.z",
        "right.head_from_camera.x",
        "left.camera_clock.offset",
        "right.ptu_clock.offset",
        "dgps_clock.offset",
    ),
    (1e-3, 5e-4, 0.01, 0.01, 0.2),
).with_span(0.15)


def both(journals: bool = False, **estimation: object) -> tuple[StationEkf, StationEkf]:
    """The compiled filter of two stations with carried errors, and filterpy's."""
    rig, out = make_rig(), []
    for kind in FilterImplementation:
        config = EstimationConfig(implementation=kind, **estimation)  # type: ignore[arg-type]
        geometries = {s.name: s.geometry() for s in rig.stations}
        out.append(StationEkf(geometries, rig.names, config, PRIOR, FilterJournal() if journals else None))
    assert isinstance(out[1]._filter.imm, FilterpyImm)
    assert not isinstance(out[0]._filter.imm, FilterpyImm)
    return out[0], out[1]


def operations(rng: np.random.Generator) -> list[Callable[[StationEkf], object]]:
    """Two seconds of a drawn flight: readings, pixels, widths, misses, references, and a jump of one PTU."""
    start, velocity = np.array([rng.uniform(-8, 8), rng.uniform(100, 400), rng.uniform(5, 20)]), rng.normal(size=3)
    velocity = velocity + [0.0, -22.0, -1.0]
    rig, done = make_rig(), []
    done.append(lambda ekf: ekf.predict_to(0.0))
    spread_6 = np.diag(rng.uniform(0.3, 3.0, 6) ** 2)
    first = start + rng.normal(size=3)
    done.append(lambda ekf: ekf.start_target(first, velocity, spread_6, triangulated=True))
    for k in range(20):
        t = 0.1 * k + float(rng.uniform(0.0, 0.05))
        point = start + velocity * t
        done.append(lambda ekf, t=t: ekf.predict_to(t))
        for s in rig.stations:
            angles = aim(s.geometry(), point)
            read = tuple(np.array(angles) + rng.normal(0, 3e-5, 2) + (0.5 if k == 12 and s.name == "left" else 0.0))
            done.append(lambda ekf, n=s.name, a=read: ekf.update_encoder(n, a, 3e-5, 0.002, 0.01))
            projection = s.geometry().project(point, *angles)
            assert projection is not None
            pixel = projection.pixel + rng.normal(0, 0.7, 2)
            done.append(lambda ekf, n=s.name, z=pixel: ekf.update_pixel(n, z, 0.5 * np.eye(2), 0.0, 0.4))
            width = 2.0 * 6667.0 / projection.depth_m
            done.append(lambda ekf, n=s.name, w=width, k=k: ekf.update_width(n, w, 2.0, alone=k % 5 == 0))
            done.append(lambda ekf, n=s.name: ekf.update_miss(n, 0.8))
        if k % 4 == 3:
            fix = point + rng.normal(0, 0.3, 3)
            done.append(lambda ekf, z=fix: ekf.update_reference(ReferencePosition(z, 0.1 * np.eye(3), -0.02)))
    return done


@settings(max_examples=5)
@given(seed=SEEDS, calibration=st.sampled_from(CalibrationUse), weighting=st.sampled_from(OutOfViewWeighting))
def test_every_update_of_a_drawn_flight(seed: int, calibration: CalibrationUse, weighting: OutOfViewWeighting) -> None:
    """The state after each operation, its innovation, and what was accepted."""
    ours, theirs = both(calibration=calibration, out_of_view=weighting)
    for operation in operations(np.random.default_rng(seed)):
        a, b = operation(ours), operation(theirs)
        assert type(a) is type(b)
        if a is not None:
            assert (a.accepted, a.dof) == (b.accepted, b.dof)
            np.testing.assert_allclose(a.nis, b.nis, rtol=1e-7, atol=1e-12)
        agree((ours.state, ours.covariance), (theirs.state, theirs.covariance))
    assert ours.manoeuvring == pytest.approx(theirs.manoeuvring, rel=1e-7)


def test_snapshots_and_predictions_leave_the_filter_unchanged() -> None:
    """Expected: the same bits after a snapshot is restored, and after a prediction."""
    _, ekf = both(journals=True)
    steps = operations(np.random.default_rng(3))
    for operation in steps[:60]:
        operation(ekf)
    saved, x = ekf.snapshot(), ekf.state.copy()
    for operation in steps[60:]:
        operation(ekf)
    after = ekf.covariance.copy()
    assert ekf.time_s is not None
    with ekf.predicted_ahead(ekf.time_s + 1.0):
        assert ekf.covariance[0, 0] > after[0, 0]
    np.testing.assert_array_equal(ekf.covariance, after)
    ekf.restore(saved)
    np.testing.assert_array_equal(ekf.state, x)
    for operation in steps[60:]:
        operation(ekf)
    np.testing.assert_array_equal(ekf.covariance, after)


def smoothed(ekf: StationEkf, wanted: list[float]) -> dict[float, tuple[FloatArray, FloatArray]]:
    found: dict[float, tuple[FloatArray, FloatArray]] = {}
    journal = ekf._filter.journal
    assert journal is not None
    across = ekf._models.arithmetic.smooth_across
    smoother = Smoother(ekf.motion_over, lambda t, x, P: found.__setitem__(t, (x, P)), across=across)
    for t in wanted:
        smoother.request(t)
    journal.history.archive = smoother.take
    ekf.close_history()
    return found


def test_a_smoothed_flight() -> None:
    """With resets, inflations, carried errors and times between measurements, from the end to the start."""
    runs, wanted = [], [0.0, 0.05, *map(float, np.linspace(0.1, 1.9, 25))]
    for ekf in both(journals=True):
        for operation in operations(np.random.default_rng(8)):
            operation(ekf)
        runs.append(smoothed(ekf, wanted))
    assert runs[0].keys() == runs[1].keys() == set(wanted)
    for t in wanted:
        (x, P), (their_x, their_P) = runs[0][t], runs[1][t]
        agree((x, P), (their_x, P))
        # just after an axis was reset, its angle is known 10⁴ times better than its rate, and rounding shows
        agree((x, P), (x, their_P), bound=1e-5)
    constant = ekf.layout.parameters["dgps_clock.offset"]
    for x, P in runs[0].values():
        # a clock without process noise is estimated by all measurements, also before a reference moved the target
        assert x[constant] == pytest.approx(runs[0][wanted[-1]][0][constant], rel=1e-6)
        assert P[constant, constant] == pytest.approx(runs[0][wanted[-1]][1][constant, constant], rel=1e-6)


START = InitialState(
    t_s=0.0,
    position_runway_m=glide(0.0) + np.array([0.5, -2.0, 0.3]),
    velocity_runway_m_s=np.array([0.5, -24.0, -1.0]),
    sigma_position_m=np.full(3, 3.0),
    sigma_velocity_m_s=np.full(3, 2.0),
)


def flown(
    implementation: FilterImplementation, events: list[Event], initial: InitialState | None
) -> tuple[list[TrackEstimate], dict[float, FloatArray], dict[str, int], Pipeline]:
    """Estimates of a flight, its smoothed positions, its counts, and the pipeline."""
    base = Config()
    own = replace(base.estimation, implementation=implementation, labelled_sigma_px=0.5, fix_window_s=0.03)
    pipeline = Pipeline(make_rig(), replace(base, estimation=own), span_m=2.3, initial=initial)
    late: dict[float, FloatArray] = {}
    request = pipeline.smooth(lambda t, kinematics: late.__setitem__(t, kinematics.position_runway_m))
    estimates: list[TrackEstimate] = []

    def take(report: StepReport) -> None:
        for e in report.estimates:
            estimates.append(e)
            request(e.t_s)

    for event in events:
        take(pipeline.step(event))
    take(pipeline.finish())
    pipeline.finish_smoothing()
    return estimates, late, pipeline.counts | pipeline.fused_late, pipeline


@pytest.mark.parametrize("initial", [START, None], ids=["given", "searched"])
def test_a_whole_flight_through_the_pipeline(initial: InitialState | None) -> None:
    """Four seconds with references, spikes and late readings and pixels: the same statuses, counts and estimates."""
    rng = np.random.default_rng(4)
    events: list[Event] = []
    for e in flight_events(make_rig(), glide, rng, duration_s=4.0, ptu_hz=25.0, angle_sigma_rad=3e-5):
        spike = isinstance(e, PtuSample) and rng.random() < 0.01
        events.append(replace(e, pan_rad=e.pan_rad + 0.3) if spike and isinstance(e, PtuSample) else e)
    for t in np.arange(2.0, 3.0, 0.2):
        fix = ReferenceFix(t_s=float(t), position_runway_m=glide(t), sigma_m=np.full(3, 0.2))
        events.append(fix)
    arrival = [e.t_s + (rng.uniform(0.0, 0.3) if rng.random() < 0.1 else 0.0) for e in events]
    events = [events[k] for k in np.argsort(arrival, kind="stable")]
    (a, a_late, a_counts, ours), (b, b_late, b_counts, theirs) = (
        flown(kind, events, initial) for kind in FilterImplementation
    )
    assert [(e.t_s, e.status) for e in a] == [(e.t_s, e.status) for e in b]
    assert a_counts == b_counts
    assert a_counts["fused_late_ptu"] > 0
    assert {TrackStatus.TRACKING} <= {e.status for e in a}
    known = [(p.kinematics, q.kinematics) for p, q in zip(a, b, strict=True) if p.kinematics is not None]
    assert len(known) > 20
    for p, q in known:
        assert q is not None
        ours_x, theirs_x = (np.concatenate([k.position_runway_m, k.velocity_runway_m_s]) for k in (p, q))
        agree((ours_x, p.covariance), (theirs_x, q.covariance))
    for one, other in zip(ours.carried_errors, theirs.carried_errors, strict=True):
        assert one.sigma == pytest.approx(other.sigma, rel=AGREEMENT)
    assert a_late.keys() == b_late.keys()
    assert len(a_late) > 20
    for t, position in a_late.items():
        np.testing.assert_allclose(position, b_late[t], rtol=1e-7)


def test_the_implementation_is_chosen_by_the_configuration() -> None:
    chosen = config_from_mapping(Config, {"estimation": {"implementation": "filterpy"}}, "tuning.toml")
    assert chosen.estimation.implementation is FilterImplementation.FILTERPY
    assert Config().estimation.implementation is FilterImplementation.COMPILED
    with pytest.raises(ConfigError, match=r"implementation.*'numpy'.*'compiled', 'filterpy'"):
        config_from_mapping(Config, {"estimation": {"implementation": "numpy"}}, "tuning.toml")


def test_an_update_without_a_measurement_is_refused() -> None:
    with pytest.raises(ValueError, match="set_measurement"):
        FilterpyEkf(np.zeros(2), np.eye(2)).update(np.zeros(1))
