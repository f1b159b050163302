"""Pixels of a fixed camera that are off for seconds: found, written as an error of its axis, and never estimated."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.flight.covariance import lasting_misfit_px
from calibration.flight.fit import FlightFit, StationFit
from calibration.flight.rig import _shared, _with_misfit
from groundstation.estimation.config import CalibrationUse, EstimationConfig
from groundstation.estimation.consider_parameters import ConsiderPolicy
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig
from tests.stereo_rig import make_station

RATE_HZ, DURATION_S = 20.0, 120.0


def residuals(seed: int, lasting_px: float, lasts_s: float = 5.0) -> tuple[np.ndarray, StationFit]:
    """Times (n,) and residuals of white noise of 0.3 px and a Gauss-Markov error."""
    generator = np.random.default_rng(seed)
    n = round(RATE_HZ * DURATION_S)
    kept, drive = np.exp(-1.0 / (RATE_HZ * lasts_s)), generator.normal(size=(n, 2))
    error = np.zeros((n, 2))
    error[0] = drive[0]
    for k in range(1, n):
        error[k] = kept * error[k - 1] + np.sqrt(1.0 - kept**2) * drive[k]
    off = lasting_px * error + generator.normal(0.0, 0.3, (n, 2))
    everywhere = np.ones(n, np.bool_)
    return np.arange(n) / RATE_HZ, StationFit(residual_px=off, usable=everywhere, kept=everywhere, noise_factor=1.0)


def test_lasting_part_is_found() -> None:
    found = [lasting_misfit_px(*residuals(seed, 0.8)) for seed in range(30)]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.8, rel=0.2)


def test_white_noise_does_not_last() -> None:
    assert np.mean([lasting_misfit_px(*residuals(seed, 0.0)) == 0.0 for seed in range(60)]) > 0.9


def test_few_pixels_say_nothing() -> None:
    t, fit = residuals(1, 0.8)
    few = replace(fit, residual_px=fit.residual_px[:50], usable=fit.usable[:50], kept=fit.kept[:50])
    assert lasting_misfit_px(t[:50], few) == 0.0


@pytest.mark.parametrize("fixed", [True, False])
def test_misfit_is_an_error_of_a_fixed_camera_s_axis(fixed: bool) -> None:
    station = make_station("left", 0.0, fixed=fixed)
    fit = FlightFit.__new__(FlightFit)
    object.__setattr__(fit, "misfit_px", {"left": 2.0})
    names, covariance = _with_misfit(station, fit, ("runway_from_base.x",), np.eye(1))
    assert (len(names) == 4) == fixed
    if fixed:
        assert names[1:] == ("head_from_camera.x", "head_from_camera.y", "head_from_camera.z")
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)[1:]) * station.lens.focal_px.mean(), 2.0)


def test_misfit_of_an_earlier_flight_does_not_outlive_it() -> None:
    """Nor where the rig's own table has it: the station's would state another variance, and no rig may."""
    names = tuple(f"{station}.runway_from_base.z" for station in ("left", "right"))
    fit = FlightFit.__new__(FlightFit)
    object.__setattr__(fit, "problem", SimpleNamespace(names=names))
    object.__setattr__(fit, "covariance", np.diag([1e-8, 1e-8]))
    known = ParameterCovariance(
        names=("left.head_from_camera.x", "right.head_from_camera.x"), matrix=np.diag([4e-8, 4e-8])
    )
    stations = (make_station("left", 0.0, fixed=True), make_station("right", 1.0))
    found = _shared(Rig(stations=stations, shared_covariance=known), stations, fit)
    # the right head turns: what is known of its camera is no misfit
    assert found.names == ("right.head_from_camera.x", *names)


@pytest.mark.parametrize("use", list(CalibrationUse))
def test_filter_never_estimates_it(use: CalibrationUse) -> None:
    names = tuple(f"left.{group}.{axis}" for group in ("runway_from_base", "head_from_camera") for axis in "xyz")
    prior = ParameterPrior.independent(names, (1e-3,) * 6)
    config = EstimationConfig(calibration=use)
    geometry = make_station("left", 0.0, fixed=True).geometry()
    ekf = StationEkf({"left": geometry}, (), config, prior)
    policy = ConsiderPolicy(ekf.layout, config, ("left",))
    places = [ekf.layout.parameters[name] for name in names]
    assert not policy.ever_estimated[places[3:]].any()
    assert policy.ever_estimated[places[:3]].all() == (use is not CalibrationUse.CONSIDER)
