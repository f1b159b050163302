"""The landing site file: what it means, and the errors for files that are none."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import ConfigError
from groundstation.integrity.approach_integrity import ApproachIntegrity
from groundstation.landing.touchdown import TouchdownForecast, TouchdownPredictor
from groundstation.landing_site.approach_prior import ApproachPrior, WheelPosition
from groundstation.landing_site.fault_table import FaultTable
from groundstation.landing_site.landing_site_file import LandingSite, load_landing_site
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import Kinematics
from groundstation.simulation.standard_cases import standard_rig

_WHOLE = """format = "groundstation-landing-site/1"
[runway]
threshold_m = [1.0, 100.0, 0.5]
direction_deg = 90.0
width_m = 20.0
length_m = 400.0
[approach]
glide_path_deg = 4.0
aim_past_threshold_m = 30.0
speed_m_s = 22.0
[alert_limits]
lateral_m = 2.0
"""


def _written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "landing-site.toml"
    path.write_text(text)
    return path


def test_a_whole_file_is_read(tmp_path: Path) -> None:
    site = load_landing_site(_written(tmp_path, _WHOLE))
    assert site.runway.threshold_m == (1.0, 100.0, 0.5)
    assert site.runway.width_m == 20.0
    assert site.runway.length_m == 400.0
    assert site.runway.direction_rad == pytest.approx(math.pi / 2)
    assert site.approach is not None
    # expected: tan 4° times the distance to the aim point, 130 m before which the aircraft is
    assert site.approach.height_m(-100.0) == pytest.approx(130.0 * math.tan(math.radians(4.0)))
    assert site.alert_limits.lateral_m == 2.0
    assert site.alert_limits.along_m == LandingSite().alert_limits.along_m


def test_the_aircrafts_wheels_and_prior_reach_the_forecast(tmp_path: Path) -> None:
    """Expected: what is stated replaces its default alone, and the monitor of landings has it."""
    text = _WHOLE + "[wheels]\nbelow_nose_m = 0.9\n[approach_prior]\nflare_height_m = 4\nfree_psd_m2_s3 = [1, 2, 3]\n"
    site = load_landing_site(_written(tmp_path, text))
    assert site.wheels == replace(WheelPosition(), below_nose_m=0.9)
    assert site.prior == replace(ApproachPrior(), flare_height_m=4.0, free_psd_m2_s3=(1.0, 2.0, 3.0))
    at = Kinematics(
        position_runway_m=np.array([-60.0, 100.0, 6.0]),
        velocity_runway_m_s=np.array([21.9, 0.0, -1.5]),
        covariance=1e-4 * np.eye(6),
    )
    stated, usual = (
        TouchdownPredictor(s).forecast(0.0, at)
        for s in (site, replace(site, wheels=WheelPosition(), prior=ApproachPrior()))
    )
    assert isinstance(stated, TouchdownForecast)
    assert isinstance(usual, TouchdownForecast)
    assert stated.point_m[0] != usual.point_m[0]


def test_a_file_without_tables_is_the_default_site(tmp_path: Path) -> None:
    assert load_landing_site(_written(tmp_path, 'format = "groundstation-landing-site/1"\n')) == LandingSite()


def test_the_vertical_limit_is_tighter_near_the_ground() -> None:
    limits = LandingSite().alert_limits
    assert (limits.vertical_at(5.1), limits.vertical_at(5.0), limits.vertical_at(-1.0)) == (1.5, 0.6, 0.6)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ('format = "groundstation-landing-site/2"', "format"),
        ('format = "groundstation-landing-site/1"\n[runway]\nwidth = 3', "width"),
        ('format = "groundstation-landing-site/1"\n[runway]\nwidth_m = 0', "width_m"),
        ('format = "groundstation-landing-site/1"\n[runway]\nthreshold_m = [0, 1e9, 0]', "threshold_m"),
        ('format = "groundstation-landing-site/1"\n[approach]\naim_past_threshold_m = 3', "glide_path_deg"),
        ('format = "groundstation-landing-site/1"\n[approach]\nglide_path_deg = nan', "glide_path_deg"),
        ('format = "groundstation-landing-site/1"\n[alert_limits]\nalong_m = -1', "along_m"),
        ('format = "groundstation-landing-site/1"\n[wheels]\nbelow_nose_m = -1', "below_nose_m"),
        ('format = "groundstation-landing-site/1"\n[wheels]\nbelow = 1', "below"),
        ('format = "groundstation-landing-site/1"\n[approach_prior]\nhold_rad_s = 0', "hold_rad_s"),
        ('format = "groundstation-landing-site/1"\n[approach_prior]\nfree_psd_m2_s3 = [1, 2]', "free_psd_m2_s3"),
    ],
)
def test_a_wrong_file_is_refused_by_the_name_of_its_key(tmp_path: Path, wrong: str, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        load_landing_site(_written(tmp_path, wrong))


def test_an_aircraft_that_lands_towards_the_stations_has_its_right_at_minus_x() -> None:
    runway = LandingRunway(threshold_m=(0.0, 100.0, 0.0))
    np.testing.assert_allclose(runway.threshold_coordinates(np.array([-2.0, 150.0, 7.0])), [-50.0, 2.0, 7.0])


_METRES = st.floats(-1e4, 1e4)


@given(st.tuples(_METRES, _METRES, _METRES), st.tuples(_METRES, _METRES, _METRES), st.floats(-math.pi, math.pi))
def test_there_and_back(point: tuple[float, ...], threshold: tuple[float, float, float], direction_rad: float) -> None:
    runway = LandingRunway(threshold_m=threshold, direction_rad=direction_rad)
    axes = runway.axes()
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    # along × up is right of it
    np.testing.assert_allclose(np.cross(axes[0], axes[2]), axes[1], atol=1e-12)
    np.testing.assert_allclose(
        runway.runway_position(runway.threshold_coordinates(np.array(point))), point, rtol=1e-12, atol=1e-9
    )


def test_stated_faults_reach_the_protection_levels(tmp_path: Path) -> None:
    """Expected: what is stated replaces its default alone; a rarer, smaller mount fault leaves a lower level."""
    text = _WHOLE + "[faults]\nmount_prior = 1e-4\nmount_deg = 0.02\ntarget_point_spans = [0.1, 0.1, 0.1]\n"
    site = load_landing_site(_written(tmp_path, text))
    assert site.faults == replace(
        FaultTable(), mount_prior=1e-4, mount_rad=math.radians(0.02), target_point_spans=(0.1, 0.1, 0.1)
    )
    monitor = ApproachIntegrity(standard_rig(), site)
    assert monitor.faults == site.faults


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("mount_deg = -1.0", "mount_deg"),
        ("mount_rad = 0.1", "mount_rad"),
        ("detection_prior = 0.9", "detection_prior"),
        ("risk = 0.0", "risk"),
        ("clock_s = nan", "clock_s"),
    ],
)
def test_faults_that_cannot_be_are_named(tmp_path: Path, line: str, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        load_landing_site(_written(tmp_path, _WHOLE + f"[faults]\n{line}\n"))


def test_a_risk_that_two_faults_at_once_exceed_is_refused(tmp_path: Path) -> None:
    site = load_landing_site(_written(tmp_path, _WHOLE + "[faults]\nrisk = 1e-6\n"))
    with pytest.raises(ConfigError, match="two faults"):
        ApproachIntegrity(standard_rig(), site)
