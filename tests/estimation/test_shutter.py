"""A shutter whose time is not quite known: in the rig file, among the errors carried, and in the track's covariance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.errors import RigError
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.parameters import ParameterPrior, rig_prior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation import standard_rig
from tests.complaints import complaint

SIGMA_S = 0.01
NAMES = ("left.readout", "right.readout")
DRAWS, PIXEL_PX = 40, 0.5


def with_shutters(sigma_s: float) -> Rig:
    """Return two fixed stations with shutters of 20 ms, known so well."""
    plain = standard_rig()
    stations = tuple(replace(s, fixed=True, readout_s=0.02, readout_sigma_s=sigma_s) for s in plain.stations)
    return replace(plain, stations=stations)


def written(tmp_path: Path, rig: Rig) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(rig))
    return path


def test_the_file_keeps_it_and_the_filter_carries_it(tmp_path: Path) -> None:
    again = load_rig(written(tmp_path, with_shutters(SIGMA_S)))
    assert again["left"].readout_sigma_s == SIGMA_S
    prior = rig_prior(again)
    assert prior.names == NAMES
    np.testing.assert_array_equal(prior.covariance, SIGMA_S**2 * np.eye(2))


def test_a_rig_without_sigmas_adds_no_states(tmp_path: Path) -> None:
    path = written(tmp_path, with_shutters(0.0))
    assert "readout_sigma_s" not in path.read_text()
    assert rig_prior(load_rig(path)).names == ()


def test_the_whole_rigs_table_may_name_it_and_must_agree(tmp_path: Path) -> None:
    """The common part of two shutters is in the table; a station that contradicts it is refused."""
    shared = ParameterCovariance(names=NAMES, matrix=SIGMA_S**2 * np.array([[1.0, 0.5], [0.5, 1.0]]))
    rig = replace(with_shutters(SIGMA_S), shared_covariance=shared)
    prior = rig_prior(load_rig(written(tmp_path, rig)))
    assert prior.names == NAMES
    np.testing.assert_array_equal(prior.covariance, shared.matrix)
    other = replace(with_shutters(2.0 * SIGMA_S), shared_covariance=shared)
    reported = complaint(RigError, lambda: load_rig(written(tmp_path, other)))
    assert "'left.readout'" in reported
    assert "0.0004, as its station gives" in reported


@pytest.mark.parametrize("text", ["-0.001", '"long"', "inf"])
def test_no_sigma(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, with_shutters(SIGMA_S))
    path.write_text(path.read_text().replace(f"readout_sigma_s = {SIGMA_S}", f"readout_sigma_s = {text}"))
    assert "readout_sigma_s" in complaint(RigError, lambda: load_rig(path))


def nees(prior: ParameterPrior, seed: int) -> float:
    """Return the position's NEES (3 dof) after 1 s across the upper rows of both pictures, shutters drawn."""
    rig, generator = with_shutters(SIGMA_S), np.random.default_rng(seed)
    longer = SIGMA_S * generator.normal(size=2)
    first, velocity = np.array([-10.0, 150.0, 10.5]), np.array([20.0, 0.0, 0.0])
    config = EstimationConfig(acceleration_psd_m2_s3=(0.05, 0.05, 0.05), manoeuvre_psd_m2_s3=(0.05, 0.05, 0.05))
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, (), config, prior)
    ekf.predict_to(0.0)
    start = np.repeat([1.0, 0.5], 3) * generator.normal(size=6)
    ekf.start_target(first + start[:3], velocity + start[3:], np.diag(np.repeat([1.0, 0.5], 3) ** 2))
    for k in range(1, 31):
        t = k / 30.0
        ekf.predict_to(t)
        for station, late in zip(rig.stations, longer, strict=True):
            pixel, share = np.zeros(2), 0.0
            for _ in range(3):
                seen = station.geometry().project(first + (t + share * (0.02 + late)) * velocity, 0.0, 0.0)
                assert seen is not None
                pixel, share = seen.pixel, (seen.pixel[1] + 0.5) / 960.0 - 0.5
            assert share < -0.3
            noisy = pixel + PIXEL_PX * generator.normal(size=2)
            ekf.update_pixel(station.name, noisy, PIXEL_PX**2 * np.eye(2), share * 0.02)
    off = ekf.state[:3] - (first + velocity)
    return float(off @ np.linalg.solve(ekf.covariance[:3, :3], off))


def test_the_tracks_covariance_shows_it() -> None:
    """With it the NEES is that of three dimensions; without it the track would be many sigmas off."""
    known = rig_prior(with_shutters(SIGMA_S))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * DRAWS)
    assert low < sum(nees(known, seed) for seed in range(DRAWS)) < high
    assert sum(nees(ParameterPrior.nothing(), seed) for seed in range(5)) > 3.0 * chi2.ppf(0.9995, 15)
