"""The silhouette's width: its Jacobian, and one camera alone with a span that is not exactly known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.journal import FilterJournal
from groundstation.estimation.parameters import LOG_SPAN, ParameterPrior
from groundstation.estimation.state_model import state_layout
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.width_update import WidthModel
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.standard_cases import drawn_glide
from tests.stereo_rig import aim, make_rig

SPAN_M = 2.3
SPAN_SIGMA, WIDTH_SIGMA = 0.15, 0.1
PSD = (1.0, 4.0, 2.0)
BOTH_UNTIL_S = 3.0


@pytest.mark.parametrize("point", [(0.5, 30.0, 2.0), (1.0, 200.0, 8.0), (-30.0, 2000.0, 300.0)])
def test_jacobian(rng: np.random.Generator, point: tuple[float, float, float]) -> None:
    """Numeric twin over position, velocity and span; what depends on the angles is left out, and is small."""
    rig = make_rig()
    layout = state_layout(rig.names, (LOG_SPAN,))
    geometry = rig["left"].geometry()
    model = WidthModel(layout, geometry)
    x = np.zeros(layout.size)
    x[layout.position], x[layout.velocity] = point, (4.0, -25.0, -1.0)
    x[layout.parameters[LOG_SPAN]] = 0.1
    angles = aim(geometry, np.array(point))
    expected = model.predict(x, SPAN_M, *angles)
    assert expected is not None
    depth = np.linalg.norm(np.array(point) - rig["left"].ptu_position_m)
    assert np.exp(expected.value[0]) == pytest.approx(SPAN_M * np.exp(0.1) * 6667.0 / depth, rel=0.1)
    twin = np.zeros(layout.size)
    for k in [*range(6), layout.parameters[LOG_SPAN]]:
        d = np.zeros(layout.size)
        d[k] = 1e-4
        ahead, back = model.predict(x + d, SPAN_M, *angles), model.predict(x - d, SPAN_M, *angles)
        assert ahead is not None
        assert back is not None
        twin[k] = (ahead.value[0] - back.value[0]) / 2e-4
    np.testing.assert_allclose(expected.jacobian[0], twin, atol=1e-7)
    turned = model.predict(x, SPAN_M, angles[0] + 1e-4, angles[1] + 1e-4)
    assert turned is not None
    assert abs(turned.value[0] - expected.value[0]) < 1e-4


def test_no_width_where_the_wings_are_not_seen_across() -> None:
    rig = make_rig()
    layout = state_layout(rig.names, (LOG_SPAN,))
    model = WidthModel(layout, rig["left"].geometry())
    x = np.zeros(layout.size)
    x[layout.position] = 0.0, 200.0, 8.0
    angles = aim(rig["left"].geometry(), x[layout.position])
    for velocity in ((20.0, 0.0, 0.0), (0.0, -1.0, 0.0)):
        x[layout.velocity] = velocity
        assert model.predict(x, SPAN_M, *angles) is None
    x[layout.velocity] = 0.0, -20.0, 0.0
    assert model.predict(x, SPAN_M, *angles) is not None
    assert WidthModel(state_layout(rig.names), rig["left"].geometry()).predict(x, SPAN_M, *angles) is None


def fly(seed: int, widths: bool, common: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both cameras for 3 s, then the left one alone: errors (n, 3), squares (n,) and the span's sigma (n,).

    Without ``common`` the filter assumes that the span is exact.
    """
    rng = np.random.default_rng(seed)
    rig = make_rig()
    path = drawn_glide(seed, PSD, GlideApproach(start_y_m=400.0, end_y_m=200.0))
    config = replace(EstimationConfig(), width_sigma_log=WIDTH_SIGMA)
    prior = ParameterPrior.nothing().with_span(SPAN_SIGMA if common else 1e-6)
    if not common:
        prior = replace(prior, walk_psd=np.zeros(1))
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, config, prior)
    span = SPAN_M * np.exp(rng.normal(0, SPAN_SIGMA))
    errors, squares, sigmas = [], [], []
    sigma_angle = 3e-5
    for t in np.arange(0.0, 8.0, 0.1):
        point = path.position(np.array([t]))[0]
        ekf.predict_to(t)
        if t == 0.0:
            start = rng.normal(0, 1.0, 6) * [1, 5, 1, 1, 2, 1]
            velocity = path.velocity(np.array([t]))[0]
            ekf.start_target(point + start[:3], velocity + start[3:], np.diag([1, 25, 1, 1, 4, 1.0]))
        for station in rig.stations:
            geometry = station.geometry()
            angles = aim(geometry, point)
            read = np.array(angles) + rng.normal(0, sigma_angle, 2)
            ekf.update_encoder(station.name, (read[0], read[1]), sigma_angle, 0.0, 0.0)
            if station.name == "right" and t > BOTH_UNTIL_S:
                continue
            projection = geometry.project(point, *angles)
            assert projection is not None
            ekf.update_pixel(station.name, projection.pixel + rng.normal(0, 0.5, 2), 0.25 * np.eye(2))
            v = path.velocity(np.array([t]))[0]
            x_axis = geometry.camera_pose(*angles).runway_from_camera[:, 0]
            aspect = abs(x_axis @ [v[1], -v[0], 0.0]) / np.hypot(v[0], v[1])
            width = span * 6667.0 / projection.depth_m * aspect * np.exp(rng.normal(0, WIDTH_SIGMA))
            if widths:
                ekf.update_width(station.name, width, SPAN_M, alone=t > BOTH_UNTIL_S + 0.3)
        k = ekf.kinematics_at(t)
        d = k.position_runway_m - point
        errors.append(d)
        squares.append(d @ np.linalg.solve(k.covariance[:3, :3], d))
        at = ekf.layout.parameters[LOG_SPAN]
        sigmas.append(ekf.covariance[at, at] ** 0.5)
    return np.array(errors), np.array(squares), np.array(sigmas)


def test_one_camera_with_an_estimated_span_keeps_its_range() -> None:
    """16 flights with drawn span errors: the span is estimated while two cameras detect it, the range is several times
    better than without widths, and the squared errors are consistent with the covariance."""
    flown = [fly(seed, widths=True) for seed in range(16)]
    plain = [fly(seed, widths=False) for seed in range(16)]
    end = slice(-5, None)
    rms = [np.sqrt(np.mean([e[end, 1] ** 2 for e, _, _ in case])) for case in (flown, plain)]
    assert rms[0] < 0.7 * rms[1]
    for moment in (20, 50, 79):
        low, high = chi2.ppf([0.001, 0.999], 3 * len(flown)) / (3 * len(flown))
        assert low < np.mean([s[moment] for _, s, _ in flown]) / 3.0 < high
    # 0.06 after the first epoch's two widths, a hundredth or two later
    assert np.mean([s[30] for *_, s in flown]) < 0.03 < np.mean([s[0] for *_, s in flown])


def test_widths_do_not_affect_the_track_while_two_cameras_detect_it() -> None:
    with_widths, without = fly(1, widths=True), fly(1, widths=False)
    np.testing.assert_allclose(with_widths[0][:30], without[0][:30], atol=1e-9)


def test_a_common_error_is_not_averaged_away() -> None:
    """With a span assumed exact, the filter's sigma of the range is far too small."""
    squares = [fly(seed, widths=True, common=False)[1][-1] for seed in range(12)]
    assert np.mean(squares) / 3.0 > 3.0


@pytest.mark.parametrize("journal", [None, FilterJournal()])
def test_what_a_small_silhouette_shows_of_the_span_does_not_last(journal: FilterJournal | None) -> None:
    """Widths of 10 px miss one to three of them for seconds: however many there are, they leave the span open."""
    rig, point, velocity = make_rig(), np.array([0.5, 350.0, 20.0]), np.array([0.0, -20.0, -1.0])
    sigmas = {}
    for width_px in (10.0, 80.0):
        prior = ParameterPrior.nothing().with_span(SPAN_SIGMA)
        ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, EstimationConfig(), prior, journal)
        ekf.predict_to(0.0)
        for s in rig.stations:
            ekf.set_angles(s.name, aim(s.geometry(), point), (0.0, 0.0), 1e-6)
        ekf.start_target(point, velocity, np.diag([0.01, 0.01, 0.01, 0.01, 0.01, 0.01]))
        expected = WidthModel(ekf.layout, rig["left"].geometry()).predict(ekf.state, 1.0, *ekf.angles("left"))
        assert expected is not None
        span_m = width_px / float(np.exp(expected.value[0]))
        at = ekf.layout.parameters[LOG_SPAN]
        for k in range(40):
            if k == 20:
                saved = ekf.snapshot()
            ekf.predict_to(0.25 * (k + 1))
            ekf._filter.imm.set_states(ekf.layout.target, np.concatenate([point, velocity]), 0.01 * np.eye(6))
            innovation = ekf.update_width("left", width_px, span_m, alone=False)
            assert innovation is not None
        sigmas[width_px] = ekf.covariance[at, at] ** 0.5
        # going back to a snapshot and doing the same gives the same
        ekf.restore(saved)
        for k in range(20, 40):
            ekf.predict_to(0.25 * (k + 1))
            ekf._filter.imm.set_states(ekf.layout.target, np.concatenate([point, velocity]), 0.01 * np.eye(6))
            ekf.update_width("left", width_px, span_m, alone=False)
        assert ekf.covariance[at, at] ** 0.5 == sigmas[width_px]
    assert sigmas[80.0] < 0.05 < 0.06 < sigmas[10.0]
