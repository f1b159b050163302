"""A reference whose error lasts: recognised by its fixes, a Gauss-Markov process, and honest in the result."""

from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from drawn_rigs import RigRealisation, draw, errors
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import block_diag, vstack
from scipy.stats import chi2

from calibration.flight.calibrate import FlightCalibration, FlightRequest, calibrate_flight
from calibration.flight.fit import FlightFitError
from calibration.flight.html_report import FlightPage, flight_page
from calibration.flight.lasting_error import LastingError, joined, lasting_error, lasting_sigma, mean_sigma
from calibration.flight.path_parts import path_parts
from calibration.flight.problem import FlightProblem
from calibration.flight.reference_track import ReferenceTrack
from calibration.flight.text_report import lasting_lines
from calibration.flight.verdict import judge_flight
from groundstation.evaluation.position_series import ReferenceSeries
from groundstation.session.antenna import AntennaPosition, AntennaSource
from groundstation.simulation import Scenario, case_b, simulate
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.session_folder import write_session_folder

STATED_M = np.array([1.0, 1.0, 1.5])


def test_the_prior_is_a_constant_and_a_gauss_markov_process_of_equal_variance() -> None:
    """Expected: between fixes σ² (1 + exp(−|Δt| / 60 s)) / 2, an axis without the error at zero."""
    t = np.arange(0.0, 61.0, 2.0)
    error = LastingError(knots_s=t, sigma_m=np.array([0.9, 0.0]), white_m=np.array([0.3, 0.3]))
    design = error.prior().toarray()
    covariance = np.linalg.inv(design.T @ design)
    at = error.at(t).toarray()
    own = slice(0, error.each)
    apart = np.abs(np.subtract.outer(t, t))
    expected = 0.81 * 0.5 * (1.0 + np.exp(-apart / 60.0))
    np.testing.assert_allclose(at @ covariance[own, own] @ at.T, expected, rtol=1e-7)
    other = slice(error.each, error.size)
    assert np.abs(covariance[other, other]).max() < 1e-11
    assert error.centres_s.shape == (error.size,)


def test_it_goes_on_across_a_gap() -> None:
    """Expected: the covariance of both stretches is that of one process; a stretch alone has no prior of its own."""
    ends = ((0.0, 20.0), (35.0, 60.0))
    sigma, white = np.array([0.9]), np.array([0.3])
    one, two = (lasting_error(np.linspace(a, b, 50), sigma, white, continues=k > 0) for k, (a, b) in enumerate(ends))
    count = one.size + two.size
    prior = block_diag([one.prior(), two.prior()])
    design = vstack([prior, joined(one, 0, two, one.size, count)]).toarray()
    covariance = np.linalg.inv(design.T @ design)
    t = np.concatenate([one.knots_s, two.knots_s])
    at = block_diag([one.at(one.knots_s), two.at(two.knots_s)]).toarray()
    apart = np.abs(np.subtract.outer(t, t))
    np.testing.assert_allclose(at @ covariance @ at.T, 0.405 * (1.0 + np.exp(-apart / 60.0)), rtol=1e-4)


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 60.0), min_size=1, max_size=20))
def test_between_knots_it_is_linear(times_s: list[float]) -> None:
    error = LastingError(knots_s=np.linspace(0.0, 60.0, 31), sigma_m=np.ones(1), white_m=np.ones(1))
    t = np.array(times_s)
    coefficients = np.concatenate([[0.5], 2.0 - 0.1 * error.knots_s])
    np.testing.assert_allclose(error.at(t) @ coefficients, 2.5 - 0.1 * t, atol=1e-12)


@pytest.mark.parametrize(
    ("white_m", "count", "lasts"),
    [
        # as stated, and a receiver that smooths a little
        ((1.0, 1.0, 1.5), 200, (False, False, False)),
        ((0.6, 0.6, 0.9), 200, (False, False, False)),
        ((0.3, 0.3, 0.45), 200, (True, True, True)),
        ((0.3, 0.9, 0.45), 200, (True, False, True)),
        # within chance for so few
        ((0.3, 0.3, 0.45), 4, (False, False, False)),
        ((0.3, 0.3, 0.45), 3, (False, False, False)),
    ],
)
def test_what_neighbouring_fixes_do_not_show_of_the_stated_error_lasts(
    white_m: tuple[float, ...], count: int, lasts: tuple[bool, ...]
) -> None:
    found = lasting_sigma(STATED_M, np.array(white_m), count - 3)
    assert tuple(bool(s > 0.0) for s in found) == lasts
    for axis in np.flatnonzero(lasts):
        assert np.hypot(found[axis], white_m[axis]) == pytest.approx(STATED_M[axis])


def test_fixes_of_centimetres_have_none() -> None:
    """Expected: what is below a decimetre is hidden by labels and lenses."""
    assert not lasting_sigma(np.full(3, 0.03), np.full(3, 0.003), 197).any()


def test_the_mean_over_a_long_flight_is_the_constant() -> None:
    assert mean_sigma(np.array([1.0]), 1e-3) == pytest.approx(1.0, rel=1e-3)
    assert mean_sigma(np.array([1.0]), 1e6) == pytest.approx(np.sqrt(0.5), rel=1e-3)


def drawn_rig() -> tuple[Scenario, RigRealisation]:
    """Return a flight by such a receiver and its rig, of the case `gnss`."""
    scenario = case_b(seed=0)
    drawn = draw(scenario.rig, "gnss", np.random.default_rng([77, 0]))
    dgps = DgpsModel(
        clock_offset_s=drawn.late_s,
        sigma_m=np.array([0.3, 0.3, 0.45]),
        wander_sigma_m=np.array([0.954, 0.954, 1.431]),
    )
    return replace(scenario, rig=drawn.stated, true_rig=drawn.true, dgps=dgps), drawn


def calibrated(folder: Path, edit: Callable[[list[str]], list[str]] = list) -> FlightCalibration:
    """Calibrate on that flight, with the rows of its log edited."""
    scenario, _ = drawn_rig()
    seen = replace(simulate(scenario), scenario=replace(scenario, dgps=DgpsModel()))
    write_session_folder(folder, seen, name="simulated")
    head, *rows = (folder / "dgps.csv").read_text().splitlines()
    (folder / "dgps.csv").write_text("\n".join([head, *edit(rows)]) + "\n")
    request = FlightRequest(session=folder, out=folder.parent / f"{folder.name}.toml", free="orientation")
    return calibrate_flight(request)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> FlightCalibration:
    return calibrated(tmp_path_factory.mktemp("gnss") / "whole")


def test_a_rig_by_a_receiver_without_corrections_is_within_its_sigmas(whole: FlightCalibration) -> None:
    """Expected: fixes off by 1/1/1.5 m calibrate mounts, and the cameras to each other nearly as DGPS does.

    Before their lasting error was estimated the flight was refused: pixels that fit to 114 px only.
    """
    error = errors(whole.fit, whole.rig, drawn_rig()[1])
    low, high = chi2.ppf([0.0005, 0.9995], len(error))
    assert low < float(error @ np.linalg.solve(whole.fit.covariance, error)) < high
    names = whole.fit.problem.names
    left, right = (error[names.index(f"{name}.runway_from_base.z")] for name in ("left", "right"))
    assert abs(np.degrees(left - right)) < 0.01
    assert "an error of 0.9" in whole.report


def test_the_page_says_what_lasts_as_the_terminal_does(whole: FlightCalibration) -> None:
    (line,) = lasting_lines(whole.fit)
    assert line in whole.report
    content = FlightPage(
        session="gnss",
        before=drawn_rig()[0].rig,
        after=whole.rig,
        fit=whole.fit,
        verdict=judge_flight(whole.rig, whole.fit),
        notes=[],
        excluded=[],
        antenna=AntennaPosition(in_body_m=None, sigma_m=None, source=AntennaSource.NONE),
    )
    assert line in unescape(flight_page(content, []))


def test_no_pixel_of_a_clean_flight_is_left_out(whole: FlightCalibration) -> None:
    """Expected: paths that follow what is kept take in what a poor start left out."""
    for fit in whole.fit.stations.values():
        assert fit.kept.sum() >= 0.99 * len(fit.kept)
        assert fit.rms_px < 1.0


def test_gaps_in_the_log_make_nothing_better(whole: FlightCalibration, tmp_path: Path) -> None:
    """Expected: the receiver's error goes on across them, and fewer fixes are less information."""
    without = {k for first in (60, 150) for k in range(first, first + 6)}
    gaps = calibrated(tmp_path / "gaps", lambda rows: [r for k, r in enumerate(rows) if k not in without]).fit
    parts = [part for part in gaps.parts if part.station is None]
    assert [part.lasting is not None and part.lasting.continues for part in parts] == [False, True, True]
    assert np.all(gaps.sigma > 0.9 * whole.fit.sigma)
    for fit in gaps.stations.values():
        # 0.7 px of noise
        assert fit.rms_px < 1.5
        # all but six at the end of a gap, whatever the processor's rounding: the rounds end when nothing changes
        assert fit.kept.sum() >= 0.97 * fit.usable.sum()


def test_fixes_of_another_frame_are_refused(tmp_path: Path) -> None:
    def higher(rows: list[str]) -> list[str]:
        cells = [row.split(",") for row in rows]
        return [",".join([t, x, y, str(float(z) + 12.0), *rest]) for t, x, y, z, *rest in cells]

    with pytest.raises(FlightFitError, match=r"DGPS: got fixes that are \d+\.\d m off in z all flight long"):
        calibrated(tmp_path / "higher", higher)


def test_carrier_phase_fixes_with_a_spell_of_float_have_none() -> None:
    """Expected: what is usual decides, not the mean of the squares."""
    rng = np.random.default_rng(4)
    t = 0.1 * np.arange(600)
    sigma = np.tile([0.02, 0.02, 0.04], (600, 1))
    sigma[200:260] = 0.4, 0.4, 0.8
    path = np.column_stack([0.1 * t, 300.0 - 25.0 * t, 20.0 - t])
    position = path + 0.3 * sigma * rng.normal(size=(600, 3))
    track = ReferenceTrack(ReferenceSeries(t_s=t, position_m=position, sigma_m=sigma), 0.5)
    problem = FlightProblem(
        stations={}, observations={}, track=track, antenna_in_body_m=np.zeros(3), names=(), prior_sigma=np.zeros(0)
    )
    assert all(part.lasting is None for part in path_parts(problem))
    poor = ReferenceTrack(ReferenceSeries(t_s=t, position_m=position, sigma_m=10.0 * sigma), 0.5)
    assert all(part.lasting is not None for part in path_parts(replace(problem, track=poor)))
