"""Heads calibrated by drawn airliners: relative direction, its sigma, the latency; what is refused; the command."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from calibration.combination.text_report import relative_direction
from calibration.sky.adsb import as_json
from calibration.sky.aircraft_mark import LATENCY, REFRACTION, aircraft_mark, lift_below
from calibration.sky.calibrate import SkyCalibration, calibrate_sky, passes
from calibration.sky.pass_results import pass_latency, station_residuals
from calibration.sky.simulated.day_draw import DrawnDay, draw_day
from calibration.sky.simulated.day_score import score_day
from calibration.sky.sky_fit import sky_priors
from calibration.sky.sky_objects import SeenMoon, SkyObjects
from calibration.sky.text_report import format_sky, what_is_open
from calibration.stars.head_start import StarFitError
from calibration.stars.identified_stars import SkyUncertainty
from calibration.stars.joint_night import common_sigma, relative_sigma
from calibration.stars.site_file import site_to_toml
from calibration.stars.sky import SkyOverSite
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import load_rig
from groundstation.rig.rig_toml import rig_to_toml

pytestmark = pytest.mark.usefixtures("unrendered_pictures")

UNCERTAIN = SkyUncertainty(clock_s=0.1, refraction=0.01)
SEEDS = (3, 4)


@cache
def day(seed: int) -> DrawnDay:
    return draw_day(seed, passes=3, stops=5, pictures=2)


@cache
def calibrated(seed: int) -> SkyCalibration:
    one = day(seed)
    return calibrate_sky(one.rig, one.pictures, one.reports, one.site, UNCERTAIN)


@pytest.mark.parametrize("seed", SEEDS)
def test_three_airliners_tell_the_heads_relative_direction_and_how_well(seed: int) -> None:
    """Expected: from a degree off each, and a latency of up to 2 s, to hundredths, and as well as is said."""
    found = calibrated(seed)
    score = score_day(found, day(seed))
    sigma = relative_sigma(found.night.joint, 0, 1)
    assert 0.001 < sigma.pan_deg < 0.012
    assert np.sqrt(np.mean(score.relative_deg[:, 0] ** 2)) < 2.6 * sigma.pan_deg
    assert np.sqrt(np.mean(score.relative_deg[:, 1] ** 2)) < 2.6 * sigma.tilt_deg
    low, high = chi2.ppf([0.0005, 0.9995], score.degrees)
    assert low < score.nees < high
    assert found.latency_s is not None
    # an aircraft's own, up to 0.4 s, is in it
    assert -0.3 < found.latency_s - day(seed).latency_s < 0.7
    # most of 10 pictures of each pass are found: one in ten shows none, and some have flown out
    assert all(count >= 4 for counts in found.pictures for count in counts.values())


def test_a_rig_file_states_the_relative_direction_as_well_as_the_fit_knows_it() -> None:
    """Expected: what both heads have in common, and what base and boresight do against each other, stays in it."""
    total, seeds = 0.0, (*SEEDS, 7, 8)
    for seed in seeds:
        found = calibrated(seed)
        by_fit, by_rig = relative_sigma(found.night.joint, 0, 1), relative_direction(found.night.rig, "left", "right")
        assert by_rig is not None
        assert 0.9 < by_rig.pan_deg / by_fit.pan_deg < 1.2
        assert 0.9 < by_rig.tilt_deg / by_fit.tilt_deg < 1.3
        total += score_day(found, day(seed)).written_nees
    low, high = chi2.ppf([0.0005, 0.9995], 2 * len(seeds))
    assert low < total < high


def test_the_report_says_what_was_used_and_what_it_is_good_for() -> None:
    text = format_sky(calibrated(SEEDS[0]))
    assert "left against right is known to" in text
    assert "airliner 3c0000: pictures left" in text
    assert "s late (sigma" in text
    assert "3 airliners; wanted 5 or more" in text


def test_each_pass_s_latency_is_the_receiver_s_and_the_aircraft_s_own() -> None:
    """Expected: each within 3.5 sigma of what was drawn, the receiver's and 0 to 0.4 s of the aircraft's own."""
    found, one = calibrated(SEEDS[0]), day(SEEDS[0])
    for number in range(len(found.flights)):
        late = pass_latency(found, number)
        assert late is not None
        assert 0.01 < late.sigma_s < 0.4
        assert one.latency_s - 3.5 * late.sigma_s < late.latency_s < one.latency_s + 0.4 + 3.5 * late.sigma_s


def test_what_is_left_over_is_that_of_the_fit() -> None:
    """Expected: rms over passes and axes, in pixels, is the fit's own."""
    found = calibrated(SEEDS[0])
    fit = found.night.joint.nights[0].fit
    own = station_residuals(found, 0)
    focal = fit.problem.station.lens.focal_px
    squares = np.radians(own.turned_deg[own.kept]) ** 2 * focal**2
    assert np.sqrt(squares.mean()) == pytest.approx(fit.rms_px)
    assert set(own.body.tolist()) <= set(range(len(found.flights)))
    rms = own.rms_deg(0)
    assert rms is not None
    assert 0.0 < rms.max() < 0.02
    assert own.rms_deg(len(found.flights)) is None


def test_the_report_says_what_few_pictures_leave_open() -> None:
    found = calibrated(SEEDS[0])
    said = " ".join(what_is_open(replace(found, taken={"left": 90, "right": 90})))
    assert "left: " in said
    assert "of 90 pictures show no airliner where one should be: haze, cloud, or too far off" in said
    assert "show no airliner" not in " ".join(what_is_open(found))


def test_the_moon_alone_tells_heads_against_the_sky() -> None:
    """Expected: no receiver at all, the Moon at many places of the pictures: the common direction, too."""
    one = day(SEEDS[0])
    sky = SkyOverSite(one.site)
    random = np.random.default_rng(5)
    start = next(t for t in 1.78e9 + 3600.0 * np.arange(200.0) if _in_front(sky.body("moon", float(t))))
    pictures = []
    for station in one.true_rig.stations:
        for k in range(12):
            utc_s = float(start) + 60.0 * k
            towards = sky.body("moon", utc_s)
            geometry = station.geometry()
            aim = np.array([np.arctan2(-towards[0], towards[1]), np.arcsin(towards[2])]) + np.radians(
                random.uniform(-2.5, 2.5, 2)
            )
            reading = np.round(aim / station.ptu_resolution_rad) * station.ptu_resolution_rad
            angles = station.ptu_axes.angles(float(reading[0]), float(reading[1]), 0.0, 0.0)
            projected = geometry.project(station.ptu_position_m + 1e8 * towards, *angles)
            assert projected is not None
            u, v = projected.pixel + random.normal(0.0, 0.5, 2)
            like = one.pictures[0]
            pictures.append(
                replace(
                    like,
                    label=f"{station.name}-{k}.png",
                    station=station.name,
                    reading_rad=reading,
                    sense=np.zeros(2),
                    utc_s=utc_s,
                    seen=SkyObjects(pixel_px=np.zeros((0, 2)), sigma_px=np.zeros(0), extent_px=np.zeros(0)),
                    moon=SeenMoon(pixel_px=(float(u), float(v)), sigma_px=0.7),
                )
            )
    pictures.sort(key=lambda p: p.utc_s)
    found = calibrate_sky(one.rig, tuple(pictures), {}, one.site, UNCERTAIN)
    assert found.latency_s is None
    assert sum(found.moon.values()) == 24
    assert "the Moon: pictures left 12, right 12" in format_sky(found)
    # where the Moon was, all is known to hundredths; a narrow patch of the sky tells little of elsewhere
    assert common_sigma(found.night.joint).pan_deg < 0.2
    fit = found.night.joint.nights[0].fit
    assert fit.rms_px < 1.0


def _in_front(unit: np.ndarray) -> bool:
    return bool(unit[1] > 0.5 and 0.2 < unit[2] < 0.8)


def test_what_cannot_be_is_refused() -> None:
    one = day(SEEDS[0])
    late = {name: tuple(replace(r, t_s=r.t_s + 3600.0) for r in own) for name, own in one.reports.items()}
    with pytest.raises(InputError, match=r"positions that begin .* s from the pictures' times; wanted both in UTC"):
        calibrate_sky(one.rig, one.pictures, late, one.site, UNCERTAIN)
    with pytest.raises(StarFitError, match="no object within 6 deg of an airliner's place, nor the Moon"):
        calibrate_sky(one.rig, one.pictures, {}, one.site, UNCERTAIN)
    with pytest.raises(StarFitError, match="got no picture"):
        calibrate_sky(one.rig, (), one.reports, one.site, UNCERTAIN)
    # other airliners than those in the pictures
    away = {name: tuple(replace(r, lat_deg=r.lat_deg + 0.4) for r in own) for name, own in one.reports.items()}
    with pytest.raises(StarFitError):
        calibrate_sky(one.rig, one.pictures, away, one.site, UNCERTAIN)


@pytest.mark.parametrize("shared", [False, True], ids=["own table", "rig's table"])
def test_what_the_rig_states_of_a_head_is_taken(shared: bool) -> None:
    names, matrix = ("head_from_camera.x", "runway_from_base.z"), np.diag([1e-8, 1e-12])
    rig = day(SEEDS[0]).rig
    if shared:
        table = ParameterCovariance(names=tuple(f"left.{name}" for name in names), matrix=matrix)
        rig = replace(rig, shared_covariance=table)
    else:
        own = replace(rig["left"], covariance_parameters=names, covariance=matrix)
        rig = replace(rig, stations=tuple(own if s.name == "left" else s for s in rig.stations))
    station, stated = rig["left"], rig.station_covariance("left").sigmas
    chosen = sky_priors(station, stated, ())
    assert chosen["head_from_camera.x"] == pytest.approx(1e-4)
    # heads that were put up since
    assert chosen["runway_from_base.z"] == pytest.approx(np.radians(3.0))
    unknown = sky_priors(replace(station, known=("position",)), stated, ())
    assert unknown["focal.x"] > 20.0 * chosen["focal.x"]


def test_an_aircraft_s_mark_has_the_derivatives_of_its_points() -> None:
    """Expected: central differences agree, for latency, refraction and each deviation of its path."""
    one = day(SEEDS[0])
    flights, _ = passes(one.pictures, one.reports, one.site)
    mark = aircraft_mark("a", flights[0], 2.0, 0.01)
    station_m, body = np.array([-5.0, 0.0, 1.6]), np.array([[-8.0, 0.0, 0.0], [11.0, 0.0, 0.0]])
    at = np.random.default_rng(1).normal(0.0, 0.3, len(mark.names))
    _, derivative = mark.points(at, station_m, body)
    assert mark.names[:2] == (LATENCY, REFRACTION)
    for k in range(len(at)):
        step = np.zeros(len(at))
        step[k] = 1e-3
        (after, _), (before, _) = (mark.points(at + sign * step, station_m, body) for sign in (1.0, -1.0))
        moved = (after - before) / 2e-3
        # that refraction changes with the place is left out
        assert np.linalg.norm(derivative[:, :, k] - moved) < 0.01 * np.linalg.norm(moved) + 1e-6


def test_refraction_below_is_less_than_of_a_star() -> None:
    """Expected: 41.5 % of a star's at 10 km height, nothing at the lens, all of it far above the air."""
    away = np.array([[0.0, 3e4, 1e4], [0.0, 3.0, 1.0], [0.0, 3e8, 1e8]])
    lifted = np.linalg.norm(lift_below(away), axis=1)
    assert lifted[0] / lifted[2] == pytest.approx(0.415, abs=0.005)
    assert lifted[1] < 1e-3 * lifted[2]


def test_a_folder_of_pictures_becomes_a_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: the pictures of a drawn day, rendered, and its receiver's lines, through the command."""
    one = draw_day(6, passes=2, stops=4, pictures=1)
    folder = tmp_path / "day"
    folder.mkdir()
    rows = ["file,station,pan_deg,tilt_deg,t_utc_s,pan_from,tilt_from"]
    grey = np.clip(150.0 + np.random.default_rng(2).normal(0.0, 1.2, (960, 1280)), 0, 255).astype(np.uint8)
    for k, picture in enumerate(one.pictures):
        drawn = grey.copy()
        for (u, v), extent in zip(picture.seen.pixel_px, picture.seen.extent_px, strict=True):
            axes = (max(2, int(0.5 * extent)), 2)
            cv2.ellipse(drawn, (round(float(u)), round(float(v))), axes, 20.0, 0.0, 360.0, 90, -1)
        name = f"{k:03d}.png"
        cv2.imwrite(str(folder / name), drawn, [cv2.IMWRITE_PNG_COMPRESSION, 0])
        pan, tilt = np.degrees(picture.reading_rad).tolist()
        came = ",".join(f"{int(s)}" for s in picture.sense)
        rows.append(f"{name},{picture.station},{pan:.6f},{tilt:.6f},{picture.utc_s:.3f},{came}")
    (folder / "pictures.csv").write_text("\n".join(rows) + "\n")
    lines = [as_json(r) for own in one.reports.values() for r in own]
    (folder / "adsb.jsonl").write_text("\n".join(lines) + "\n")
    (tmp_path / "rig.toml").write_text(rig_to_toml(one.rig))
    (tmp_path / "site.toml").write_text(site_to_toml(one.site))
    words = ["--rig", str(tmp_path / "rig.toml"), "--site", str(tmp_path / "site.toml"), "--from", str(folder)]
    out = tmp_path / "sky.toml"
    assert main(["calibrate", "sky", *words, "--out", str(out), "--report", str(tmp_path / "report")]) == 0
    said = capsys.readouterr().out
    assert "left against right is known to" in said
    page = (tmp_path / "report" / "report.html").read_text()
    for heading in ("What the pictures could not tell", "Latency of positions", "Where the head looked"):
        assert heading in page
    assert {p.name for p in (tmp_path / "report").glob("*.png")} == {
        "latency.png",
        *(f"{name}-{kind}.png" for name in ("left", "right") for kind in ("left-over", "pointings")),
    }
    found = load_rig(out)
    # eight pictures each, drawn to a whole pixel: half a degree's turn is found to hundredths
    assert found.shared_covariance.names
    (folder / "adsb.sbs").write_text("")
    assert main(["calibrate", "sky", *words, "--out", str(out)]) == 1
    assert "adsb.jsonl and adsb.sbs; wanted one of them" in capsys.readouterr().err
