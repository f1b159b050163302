"""A survey of heads that the stars have oriented: marks give the common heading, the stars the relative direction."""

from dataclasses import replace

import numpy as np
import pytest
from landmark_study.simulated import SurveyScene, look, morning, turned_rad
from scipy.stats import chi2

from calibration.joint_covariance import with_covariance
from calibration.landmarks.survey import Survey, solve_survey
from groundstation.errors import RigError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig

AXES = "xyz"
STAR_RAD = float(np.radians(0.001))
HEADING_RAD = float(np.radians(0.5))


def by_stars(day: SurveyScene, generator: np.random.Generator) -> Rig:
    """Return the rig as stars have oriented it: each head to 0.001°, all of them with a heading of their own frame."""
    heading = generator.normal(0.0, HEADING_RAD)
    stations, names = [], []
    for stated, true in zip(day.stated.stations, day.true.stations, strict=True):
        change = np.zeros(len(CALIBRATION_PARAMETERS))
        place = CALIBRATION_PARAMETERS.index("runway_from_base.x")
        change[place : place + 3] = generator.normal(0.0, STAR_RAD, 3) + np.array([0.0, 0.0, heading])
        turned = true.changed(change)
        known = tuple(dict.fromkeys((*stated.known, "orientation")))
        stations.append(replace(stated, runway_from_base_wxyz=turned.runway_from_base_wxyz, known=known))
        names += [f"{true.name}.runway_from_base.{axis}" for axis in AXES]
    covariance = ParameterCovariance(names=tuple(names), matrix=STAR_RAD**2 * np.eye(len(names)))
    return with_covariance(replace(day.stated, stations=tuple(stations)), covariance)


def surveyed(day: SurveyScene, generator: np.random.Generator, sigma_rad: float | None) -> Survey:
    rig = by_stars(day, generator)
    return solve_survey(rig, look(day.true, day.stands, generator, 6), day.table, heading_sigma_rad=sigma_rad)


def test_errors_are_consistent_with_their_sigmas() -> None:
    nees, n, size = 0.0, 12, 0
    for seed in range(n):
        generator = np.random.default_rng([seed, 11])
        day = morning(generator, total_station=True)
        survey = surveyed(day, generator, HEADING_RAD)
        names = [f"{s.name}.runway_from_base.{axis}" for s in day.true.stations for axis in AXES]
        off = np.concatenate([turned_rad(survey.rig[s.name], s) for s in day.true.stations])
        # the boresights are the rig's, and off by what it states: the base takes them up
        nees += off @ np.linalg.solve(survey.fit.block(names), off)
        size += len(names)
    low, high = chi2.ppf([0.001, 0.999], size)
    assert low < nees < high


def test_the_relative_heading_is_the_stars_and_the_common_one_the_marks() -> None:
    generator = np.random.default_rng(5)
    day = morning(generator, total_station=True)
    with_stars, alone = (surveyed(day, np.random.default_rng(6), sigma) for sigma in (HEADING_RAD, None))
    names = [f"{s.name}.runway_from_base.z" for s in day.true.stations]
    relative, common = np.array([1.0, -1.0]), np.array([0.5, 0.5])
    sigma = {
        word: [float(np.degrees(np.sqrt(v @ one.fit.block(names) @ v))) for v in (relative, common)]
        for word, one in (("stars", with_stars), ("marks", alone))
    }
    assert sigma["stars"][0] < 0.7 * sigma["marks"][0]
    assert sigma["stars"][0] < 1.05 * np.sqrt(2.0) * np.degrees(np.hypot(STAR_RAD, np.radians(0.0002)))
    assert sigma["stars"][1] < 0.05
    for one, true in zip(with_stars.rig.stations, day.true.stations, strict=True):
        assert abs(np.degrees(turned_rad(one, true)[2])) < 0.05


def test_a_rig_without_orientation_is_refused() -> None:
    generator = np.random.default_rng(5)
    day = morning(generator, total_station=True)
    blind = replace(day.stated, stations=tuple(replace(s, known=("position", "lens")) for s in day.stated.stations))
    with pytest.raises(RigError, match="wanted a calibrated orientation"):
        solve_survey(blind, look(day.true, day.stands, generator, 6), day.table, heading_sigma_rad=HEADING_RAD)
