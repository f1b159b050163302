"""Whole drawn nights: errors against the stated sigmas, what heads share, and the rig file."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calibration.stars.calibrate import calibrate_night, sky_uncertainty, write_night_rig
from calibration.stars.head_start import StarFitError
from calibration.stars.joint_night import common_sigma, relative_sigma, rig_covariance, solve_jointly
from calibration.stars.operating_range import work_jacobian
from calibration.stars.simulated.night_score import direction_errors_deg, score_night
from calibration.stars.station_night import undetermined
from calibration.stars.text_report import format_night, needed_for, verdict
from groundstation.errors import RigError
from groundstation.rig.rig import load_rig
from tests.calibration.stars.nights import calibrated, night, pictures

pytestmark = pytest.mark.usefixtures("unrendered_pictures")

SEEDS = (0, 1, 2)


def test_every_derivative_has_its_numeric_twin(rng: np.random.Generator) -> None:
    problem = calibrated(0).joint.nights[0].fit.problem
    scale = problem.step_scale
    at = 0.1 * scale * rng.normal(size=len(scale))
    jacobian = problem.predict(at).jacobian
    for k, name in enumerate(problem.names):
        d = np.zeros(len(scale))
        d[k] = 1e-3 * scale[k]
        numeric = (problem.predict(at + d).pixel_px - problem.predict(at - d).pixel_px) / (2.0 * d[k])
        size = max(1.0, float(np.abs(numeric).max()))
        np.testing.assert_allclose(jacobian[:, :, k] / size, numeric / size, atol=2e-4, err_msg=name)


def test_parameters_err_as_their_covariance_says() -> None:
    """Expected: NEES of all parameters of six heads within the 99.9 % bounds of its χ²."""
    scores = [score_night(calibrated(seed), night(seed)) for seed in SEEDS]
    nees = np.array([n for score in scores for n in score.nees])
    size = len(calibrated(SEEDS[0]).joint.nights[0].fit.change)
    freedom = size * len(nees)
    low, high = chi2.ppf([0.0005, 0.9995], freedom) / freedom
    assert low < nees.mean() < high


def test_relative_directions_err_as_their_sigma_says() -> None:
    for seed in SEEDS:
        score, sigma = score_night(calibrated(seed), night(seed)), relative_sigma(calibrated(seed).joint, 0, 1)
        # ten pictures of each head; an encoder's step is 0.00625°
        assert sigma.pan_deg < 0.004
        assert np.all(np.abs(score.relative_deg) < 4.5 * np.array([sigma.pan_deg, sigma.tilt_deg]))


def test_a_common_clock_moves_both_heads_alike() -> None:
    """Expected: what the clock leaves open is in the common direction and not in the relative one."""
    poor = sky_uncertainty(night(1).site, 5.0, each_clock=False)
    found = calibrate_night(night(1).rig, pictures(1), night(1).site, poor)
    before, after = calibrated(1).joint, found.joint
    assert common_sigma(after).pan_deg > 4.0 * common_sigma(before).pan_deg
    assert relative_sigma(after, 0, 1).pan_deg < 1.02 * relative_sigma(before, 0, 1).pan_deg
    place = [after.names.index(f"{name}.runway_from_base.z") for name in ("left", "right")]
    block = after.covariance[np.ix_(place, place)]
    assert block[0, 1] / np.sqrt(block[0, 0] * block[1, 1]) > 0.9


def test_what_the_rig_file_states_is_the_direction_it_gives(tmp_path) -> None:
    """Expected: directions over the angles of operation by the rig's own parameters have the fit's sigmas."""
    found = calibrated(1)
    write_night_rig(tmp_path / "rig.toml", found)
    back = load_rig(tmp_path / "rig.toml")
    stated = back.calibration_covariance()
    for k, name in enumerate(("left", "right")):
        problem = found.joint.nights[k].fit.problem
        jacobian = work_jacobian(problem, found.joint.change[k])
        rows = [n for n in problem.names if f"{name}.{n}" in stated.names]
        own = jacobian[:, :, [problem.names.index(n) for n in rows]]
        block = [stated.names.index(f"{name}.{n}") for n in rows]
        by_rig = np.einsum("nia,ab,nib->ni", own, stated.matrix[np.ix_(block, block)], own).mean(axis=0)
        by_fit = np.einsum("nia,ab,nib->ni", jacobian, found.joint.of(k), jacobian).mean(axis=0)
        ratio = np.sqrt(by_rig / by_fit)
        assert np.all(ratio > 0.97), ratio
        assert np.all(ratio < 1.2), ratio
        assert back[name].known == ("position", "orientation", "lens")
        errors = direction_errors_deg(back[name], found.rig[name])
        assert np.abs(errors).max() < 1e-6
    # heads share clock and refraction: one covariance for both
    assert back.shared_covariance.names


def test_axes_that_cancel_in_operation_do_not_add_up_in_the_rig() -> None:
    """Expected: the marginal sigma of the base's heading is far above that of the direction it gives."""
    found = calibrated(0)
    stated = rig_covariance(found.joint)
    heading = np.sqrt(stated.matrix[stated.names.index("left.runway_from_base.z")].max())
    assert np.degrees(heading) > 0.0
    assert relative_sigma(found.joint, 0, 1).pan_deg < 0.004


def test_the_report_names_what_the_night_left_open() -> None:
    text = format_night(calibrated(0))
    assert "station left: " in text
    assert "arcsec" in text
    lines = verdict(calibrated(0))
    assert "left against right is known to" in lines[0]
    for name in undetermined(calibrated(0).joint.nights[0]):
        assert any(line.startswith(f"{name} (") for line in lines)
    assert any("stars do not see them" in line for line in lines)


def test_one_head_alone_is_calibrated_and_told_so() -> None:
    own = {"left": pictures(2)["left"]}
    uncertain = sky_uncertainty(night(2).site, 0.05, each_clock=False)
    found = calibrate_night(night(2).rig, own, night(2).site, uncertain)
    assert found.without == ("right",)
    assert found.rig["right"].known == ("position", "lens")
    assert "one head alone" in verdict(found)[0]


def test_faults_of_inputs_are_told() -> None:
    drawn = night(2)
    uncertain = sky_uncertainty(drawn.site, 0.05, each_clock=False)
    with pytest.raises(StarFitError, match="got no picture"):
        calibrate_night(drawn.rig, {}, drawn.site, uncertain)
    fixed = replace(drawn.rig, stations=(replace(drawn.rig["left"], fixed=True), drawn.rig["right"]))
    with pytest.raises(RigError, match="station left: got a station without PTU"):
        calibrate_night(fixed, pictures(2), drawn.site, uncertain)
    late = {"left": tuple(replace(p, utc_s=p.utc_s + 900.0 * k) for k, p in enumerate(pictures(2)["left"]))}
    with pytest.raises(StarFitError, match="angles that do not follow the stars"):
        calibrate_night(drawn.rig, late, drawn.site, uncertain)


@pytest.mark.parametrize(
    ("late_s", "lon_deg", "lat_sign", "complaint"),
    [
        (3600.0, 0.0, 1.0, "off level; wanted a pedestal level to 5 deg, t_utc_s in UTC"),
        (12.0 * 3600.0, 0.0, 1.0, "wanted t_utc_s in UTC"),
        (0.0, -40.0, 1.0, "t_utc_s in UTC"),
        (0.0, 0.0, -1.0, "t_utc_s in UTC"),
    ],
)
def test_a_wrong_time_or_place_is_refused(late_s: float, lon_deg: float, lat_sign: float, complaint: str) -> None:
    """Expected: the base takes up a sky that is turned as a whole; levels, daylight and horizon contradict it."""
    drawn = night(1)
    own = {"left": tuple(replace(p, utc_s=p.utc_s + late_s) for p in pictures(1)["left"][::2])}
    site = replace(drawn.site, lon_deg=drawn.site.lon_deg + lon_deg, lat_deg=drawn.site.lat_deg * lat_sign)
    with pytest.raises(StarFitError, match=complaint) as refused:
        calibrate_night(drawn.rig, own, site, sky_uncertainty(site, 0.05, each_clock=False))
    assert "\n" not in str(refused.value)


def test_both_angles_with_the_wrong_sign_are_a_head_upside_down() -> None:
    drawn = night(1)
    own = {"left": tuple(replace(p, reading_rad=-p.reading_rad) for p in pictures(1)["left"])}
    with pytest.raises(StarFitError, match=r"off level; .* signs of docs/conventions\.md"):
        calibrate_night(drawn.rig, own, drawn.site, sky_uncertainty(drawn.site, 0.05, each_clock=False))


def test_readings_that_jump_by_a_turn_are_refused() -> None:
    drawn = night(1)
    turn = np.array([2.0 * np.pi, 0.0])
    own = {
        "left": tuple(
            replace(p, reading_rad=p.reading_rad + turn * (p.reading_rad[0] < 0.0)) for p in pictures(1)["left"]
        )
    }
    with pytest.raises(StarFitError, match="wanted angles"):
        calibrate_night(drawn.rig, own, drawn.site, sky_uncertainty(drawn.site, 0.05, each_clock=False))


def test_readings_worse_than_the_rig_says_are_found(rng: np.random.Generator) -> None:
    """Expected: five times the stated noise is in the sigmas and in the verdict, and the rig's own number stays."""
    drawn = night(0)
    noise = np.radians(0.01)
    own = {
        name: tuple(replace(p, reading_rad=p.reading_rad + noise * rng.normal(size=2)) for p in seen)
        for name, seen in pictures(0).items()
    }
    found = calibrate_night(drawn.rig, own, drawn.site, sky_uncertainty(drawn.site, 0.05, each_clock=False))
    assert relative_sigma(found.joint, 0, 1).pan_deg > 2.0 * relative_sigma(calibrated(0).joint, 0, 1).pan_deg
    assert all(one.reading_factor > 2.0 for one in found.joint.nights)
    assert any("readings repeat to 0.0" in line for line in verdict(found))
    assert found.rig["left"].ptu_sigma_rad == drawn.rig["left"].ptu_sigma_rad
    size = 2 * len(found.joint.nights[0].fit.change)
    assert np.mean(score_night(found, drawn).nees) < chi2.ppf(0.9995, size) / size
    assert all(one.reading_factor == 1.0 for seed in SEEDS for one in calibrated(seed).joint.nights)


def test_a_clock_of_each_station_leaves_their_relative_direction_less_sure() -> None:
    """Expected: each clock is a parameter of its own; two of 0.05 s add 0.0003° at the equator of the sky at most."""
    nights = calibrated(1).joint.nights
    one, two = solve_jointly(nights), solve_jointly(nights, station_clocks=True)
    assert "mark sky.clock" in one.names
    assert {"left.mark sky.clock", "right.mark sky.clock", "mark sky.refraction"} <= set(two.names)
    together, apart = relative_sigma(one, 0, 1), relative_sigma(two, 0, 1)
    assert together.pan_deg < apart.pan_deg < np.hypot(together.pan_deg, 0.0005)


def test_a_wider_range_is_asked_for_only_where_it_is_too_narrow() -> None:
    nights = calibrated(1).joint.nights
    assert "suffice" in needed_for("pan_scale", nights)
    assert needed_for("pan_sine", nights) == "pictures over 120 deg or more of pan"
    assert needed_for("pan_backlash", nights).startswith("each axis come to from both sides")
    assert needed_for("focal.x", nights) == "other pictures"
