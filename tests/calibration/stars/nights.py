"""Drawn nights that several tests share: short ones, their catalogue read once."""

from functools import cache

from calibration.stars.calibrate import NightCalibration, calibrate_night, sky_uncertainty
from calibration.stars.night import StarPicture
from calibration.stars.simulated.night_draw import DrawnNight, NightErrors, draw_night
from calibration.stars.simulated.observed_night import night_solver, observed_night
from calibration.stars.star_solver import StarSolver

POINTINGS = 10


@cache
def night(seed: int) -> DrawnNight:
    return draw_night(seed, POINTINGS)


@cache
def solver() -> StarSolver:
    """The catalogue of the first night; a year's proper motion is less than a hundredth of a pixel."""
    return night_solver(night(0))


@cache
def pictures(seed: int) -> dict[str, tuple[StarPicture, ...]]:
    return observed_night(night(seed), seed, solver())


@cache
def calibrated(seed: int) -> NightCalibration:
    uncertain = sky_uncertainty(night(seed).site, NightErrors().clock_s, each_clock=False)
    return calibrate_night(night(seed).rig, pictures(seed), night(seed).site, uncertain)
