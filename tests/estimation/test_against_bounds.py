"""The filter on simulated flights: accuracy at the bound, with a consistent covariance.

Ranges are two-sided χ² of the independent flights; seeds are fixed, so a failure is a change of the filter. With 20
flights, pixel noise assumed 30 % too small or 40 % too large fails by NIS in both cases, as with 30.
"""

import numpy as np
import pytest
from filter_flights import adaptation, calibration, consistency, out_of_view, through_pipeline
from scipy.stats import chi2

from groundstation.estimation.config import OutOfViewWeighting

RUNS = 20


@pytest.fixture(scope="module", params=["B", "C"])
def sample(request: pytest.FixtureRequest) -> consistency.Sample:
    return consistency.sample_case(request.param, 10.0, range(RUNS))


def test_error_is_at_the_bound(sample: consistency.Sample) -> None:
    """One epoch of 20 flights gives an RMSE to 1/√40; a bin has two or three epochs' worth of them."""
    for low, high in ((400, 600), (250, 400), (150, 250), (60, 150)):
        assert np.all(sample.rmse_over_bound(low, high) < 1.0 + 2.5 / np.sqrt(2 * 2 * RUNS))


@pytest.mark.parametrize("y_m", [600.0, 595.0, 590.0, 550.0, 400.0, 200.0, 100.0])
def test_position_and_velocity_are_consistent_with_their_covariance(sample: consistency.Sample, y_m: float) -> None:
    """From the very first pair on, although 10 m at 600 m bends the pixel by more than its noise."""
    low, high = consistency.chi2_range(6, RUNS, 0.99)
    assert low < sample.anees(y_m, 6) < high


def test_innovations_are_consistent_with_their_covariance(sample: consistency.Sample) -> None:
    low, high = consistency.chi2_range(2, sample.nis_count(), 0.99)
    assert low < sample.nis() < high


def test_gain_over_triangulation() -> None:
    """From the bounds' start at 600 m: 1.59/2.31/2.04 in 200 flights by the bound itself."""
    found = consistency.gain_over_triangulation(10.0, range(12))
    assert np.all(found.filtered > [1.4, 2.2, 1.9])
    assert np.all(found.filtered > (1.0 - 2.5 / np.sqrt(2 * 2 * 12)) * found.bound)


def test_the_pipeline_is_as_good() -> None:
    through = through_pipeline.sample_case_b(range(12))
    assert np.all(through.rmse_over_bound(60, 450) < 1.0 + 2.5 / np.sqrt(2 * 4 * 12))
    low, high = consistency.chi2_range(3, 12, 0.99)
    assert low < through.anees(200.0) < high


def test_outliers_have_little_effect() -> None:
    """From a start that is known well, and from one that lets an outlier pass as its first pixel."""
    near, wide = consistency.outlier_ratio(10.0, range(12))
    assert np.all(near < 1.1)
    assert np.all(wide < 1.1)


def test_considered_errors_are_in_the_covariance_and_ignored_ones_are_not() -> None:
    names = calibration.PAN_AND_TILT + calibration.CLOCK_OFFSETS[:3]
    considered = calibration.considered(names, range(RUNS), known=True)
    ignored = calibration.considered(names, range(RUNS // 4), known=False)
    low, high = consistency.chi2_range(3, RUNS, 0.99)
    for y_m in (400.0, 200.0, 100.0):
        assert low < considered.anees(y_m) < high
        assert ignored.anees(y_m) > 20.0


def test_mounts_are_estimated_from_a_reference_and_kept() -> None:
    """8 s of 2 cm DGPS; then a Schmidt filter loses some of the bound's accuracy, which learns on."""
    sample = calibration.after_reference(calibration.PAN_AND_TILT, range(16), rate_hz=10.0)
    assert np.all(sample.rmse_over_bound(150, 250) < 1.3 * (1.0 + 2.0 / np.sqrt(2 * 2 * 16)))
    low, high = consistency.chi2_range(3, 16, 0.99)
    assert low < sample.anees(400.0) < high


def test_clocks_are_estimated_to_the_bound() -> None:
    """Offsets of 20 ms, mounts, rolls and boresights, drawn from the filter's own model; 140 flights: 1.0 to 1.1."""
    names = ("left.camera_clock.offset", *calibration.CLOCK_OFFSETS[:3])
    biases = calibration.PAN_AND_TILT + calibration.ROLL_AND_BORESIGHT
    learned = calibration.learned_clocks(calibration.clock_drawn(), names, range(6), biases)
    clocks = [k for k, name in enumerate(learned.names) if "clock" in name]
    ratio = (learned.rms() / learned.rms_bound())[clocks]
    for k in clocks:
        print(f"{learned.names[k]}: {1e3 * learned.rms()[k]:.2f} ms rms, bound {1e3 * learned.rms_bound()[k]:.2f} ms")
    assert np.all(ratio < 1.3 * np.sqrt(chi2.ppf(0.99, 6) / 6))
    np.testing.assert_allclose(np.sqrt((learned.sigma**2).mean(axis=0))[clocks], learned.rms_bound()[clocks], rtol=0.15)


def test_clocks_of_heads_that_are_not_as_modelled_are_not_learnt() -> None:
    """Heads in a smooth loop at the default PSD: their rates are mostly noise, which would bias clocks."""
    names = ("left.camera_clock.offset", *calibration.CLOCK_OFFSETS[:3])
    learned = calibration.learned_clocks(calibration.clock_take_off(), names, range(2))
    clocks = [k for k, name in enumerate(learned.names) if "clock" in name]
    assert np.all(learned.sigma[:, clocks] > 0.5 * calibration.CLOCK_SIGMA_S)
    assert np.all(np.abs(learned.error / learned.sigma)[:, clocks] < 4.0)


@pytest.mark.parametrize("border", list(out_of_view.BORDERS))
def test_beyond_the_border_only_the_consistent_form_is_consistent(border: str) -> None:
    consistent = out_of_view.fly_scene(border, OutOfViewWeighting.CONSISTENT, range(80))
    paper = out_of_view.fly_scene(border, OutOfViewWeighting.PAPER, range(80))
    low, high = consistency.chi2_range(3, 80, 0.99)
    assert low < consistent.nees.mean() < high
    assert paper.nees.mean() > 50.0


def test_two_ways_of_flying_follow_a_take_off_and_do_not_disturb_a_glide() -> None:
    glide, large = (0.05, 0.1, 0.05), (1.0, 4.0, 2.0)
    flights = adaptation.flights(None)
    alone, both = adaptation.tuning(glide, glide), adaptation.tuning(glide, large, 20.0, 2.0)
    steady = [adaptation.errors(flights["glide"], config, range(4))[0] for config in (alone, both)]
    assert np.all(steady[1] < 1.06 * steady[0])
    lost = adaptation.errors(flights["take-off"], alone, range(2))[0]
    followed = adaptation.errors(flights["take-off"], both, range(2))[0]
    assert np.all(followed < [0.04, 2.0, 0.06])
    assert lost[1] > 10.0 * followed[1]
