"""Three stations determine the errors of their mounts by the misclosure of their rays; two cannot, and do not try."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.estimation.config import CalibrationUse, EstimationConfig
from groundstation.estimation.journal import FilterJournal
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.rig.rig import Station
from tests.stereo_rig import make_station

FLIGHTS = 24
SIGMA = float(np.radians(0.05))
PAIRS, PAIR_S, NOISE_PX = 80, 0.1, 0.1
START, VELOCITY = np.array([0.5, 260.0, 16.0]), np.array([0.1, -20.0, -1.0])
NAMES = ("left", "right", "third")
QUIET = EstimationConfig(
    acceleration_psd_m2_s3=(0.05, 0.1, 0.05), manoeuvre_psd_m2_s3=(0.05, 0.1, 0.05), detection_lasting_share=0.0
)


def stations(names: tuple[str, ...] = NAMES) -> dict[str, Station]:
    """Cameras on stands, along the runway, with fields of view that cover all of the approach."""
    places = {"left": (-5.0, 0.0), "right": (5.0, 0.0), "third": (40.0, 60.0)}
    stands = {name: make_station(name, *places[name], fixed=True) for name in names}
    return {name: replace(s, lens=replace(s.lens, focal_px=np.array([500.0, 500.0]))) for name, s in stands.items()}


def mounts(names: tuple[str, ...]) -> ParameterPrior:
    parameters = tuple(f"{name}.runway_from_base.{axis}" for name in names for axis in "xz")
    return ParameterPrior.independent(parameters, [SIGMA] * len(parameters))


def new_filter(use: CalibrationUse, names: tuple[str, ...] = NAMES, journal: FilterJournal | None = None) -> StationEkf:
    ekf = StationEkf(
        {n: s.geometry() for n, s in stations(names).items()}, (), replace(QUIET, calibration=use), mounts(names)
    )
    ekf.predict_to(0.0)
    return ekf


def mount_sigmas(ekf: StationEkf) -> list[float]:
    return [error.sigma for error in ekf.carried_errors()]


@dataclass(frozen=True, kw_only=True)
class Flown:
    """Error (3,) of the position at the end and its covariance (3, 3)."""

    error: np.ndarray
    covariance: np.ndarray

    @property
    def square(self) -> float:
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


def flown(seed: int, use: CalibrationUse) -> Flown:
    """Fly straight past three cameras whose mounts are off by a draw from what the rig admits."""
    generator = np.random.default_rng([43, seed])
    true = {}
    for name, station in stations().items():
        change = np.zeros(21)
        change[[0, 2]] = SIGMA * generator.normal(size=2)
        true[name] = station.changed(change).geometry()
    ekf = new_filter(use)
    sigmas = np.array([1.0, 5.0, 1.0, 1.0, 2.0, 1.0])
    start = np.concatenate([START, VELOCITY]) + sigmas * generator.normal(size=6)
    ekf.start_target(start[:3], start[3:], np.diag(sigmas**2))
    at = START
    for k in range(PAIRS):
        ekf.predict_to(k * PAIR_S)
        at = START + k * PAIR_S * VELOCITY
        for name, geometry in true.items():
            projection = geometry.project(at, 0.0, 0.0)
            assert projection is not None
            z = projection.pixel + NOISE_PX * generator.normal(size=2)
            ekf.update_pixel(name, z, NOISE_PX**2 * np.eye(2))
    return Flown(error=ekf.state[:3] - at, covariance=ekf.covariance[:3, :3].copy())


def show(ekf: StationEkf, names: tuple[str, ...], t_s: float) -> None:
    ekf.predict_to(t_s)
    for name in names:
        prediction = ekf.predict_pixel(name)
        assert prediction is not None
        ekf.update_pixel(name, prediction.pixel, NOISE_PX**2 * np.eye(2))


def begun(use: CalibrationUse, names: tuple[str, ...] = NAMES, journal: FilterJournal | None = None) -> StationEkf:
    ekf = new_filter(use, names, journal)
    ekf.start_target(START, VELOCITY, np.diag([0.01] * 3 + [0.1] * 3))
    return ekf


def test_three_rays_make_up_for_their_mounts() -> None:
    """Without a reference: lower errors than where mounts are only considered, with a consistent covariance."""
    learnt = [flown(seed, CalibrationUse.REFERENCE) for seed in range(FLIGHTS)]
    considered = [flown(seed, CalibrationUse.CONSIDER) for seed in range(FLIGHTS)]
    low, high = chi2.ppf([0.001, 0.999], 3 * FLIGHTS)
    assert low < sum(f.square for f in learnt) < high
    rms, rms_considered = (np.sqrt(np.mean([f.error**2 for f in fs], axis=0)) for fs in (learnt, considered))
    # across, a mount error is equivalent to one of the aircraft: all three agree only on its height
    assert rms[2] < 0.8 * rms_considered[2]
    assert np.all(rms < 1.15 * rms_considered)


def test_two_rays_do_not() -> None:
    """Neither with a rig of two, nor while the third of three sees nothing."""
    for names in (NAMES[:2], NAMES):
        ekf = begun(CalibrationUse.REFERENCE, names)
        before = mount_sigmas(ekf)
        for k in range(5):
            show(ekf, NAMES[:2], k * PAIR_S)
            assert not ekf.learns
        assert mount_sigmas(ekf) == pytest.approx(before, rel=1e-12)


def test_learning_ends_soon_after_the_third_ray() -> None:
    ekf = begun(CalibrationUse.REFERENCE)
    show(ekf, NAMES, 0.0)
    assert ekf.learns
    show(ekf, NAMES[:2], 0.9 * QUIET.reference_hold_s)
    assert ekf.learns
    show(ekf, NAMES[:2], 1.1 * QUIET.reference_hold_s)
    assert not ekf.learns


def test_another_target_is_seen_anew() -> None:
    ekf = begun(CalibrationUse.REFERENCE)
    show(ekf, NAMES, 0.0)
    ekf.drop_target()
    ekf.start_target(START, VELOCITY, np.diag([0.01] * 3 + [0.1] * 3))
    assert not ekf.learns


def test_with_considered_parameters_the_filter_continues_to_consider() -> None:
    ekf = begun(CalibrationUse.CONSIDER)
    before = mount_sigmas(ekf)
    show(ekf, NAMES, 0.0)
    assert not ekf.learns
    assert mount_sigmas(ekf) == pytest.approx(before, rel=1e-12)


def test_reprocessing_resets_the_contributing_stations() -> None:
    """And doing the same again learns the same."""
    ekf = begun(CalibrationUse.REFERENCE, journal=FilterJournal())
    show(ekf, NAMES[:2], 0.0)
    before = ekf.snapshot()
    show(ekf, NAMES[2:], 0.1)
    show(ekf, NAMES, 0.2)
    after = ekf.state.copy(), ekf.covariance.copy()
    assert ekf.learns
    ekf.restore(before)
    assert not ekf.learns
    show(ekf, NAMES[2:], 0.1)
    show(ekf, NAMES, 0.2)
    np.testing.assert_array_equal(ekf.state, after[0])
    np.testing.assert_array_equal(ekf.covariance, after[1])
