"""Head angles by the stars: rendered frames of a night, encoders with noise or withheld, what does not fit."""

from dataclasses import replace
from datetime import datetime
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from calibration.stars.simulated.night_draw import DrawnNight, draw_night
from calibration.stars.simulated.observed_night import night_solver
from calibration.stars.simulated.star_field import star_field
from calibration.stars.simulated.star_renderer import hot_pixel_map, render_stars
from calibration.stars.sky import SkyOverSite
from calibration.stars.star_angles import StarAngles, star_angles
from groundstation.arrays import FloatArray, ImageArray
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.messages import Frame, FrameAngles, PtuSample
from groundstation.picture import as_picture
from groundstation.registration.head_registration import RegisteredAngles, RegistrationFault
from groundstation.registration.panorama import GroundPanorama
from groundstation.rig.rig import PtuAxes, Station
from groundstation.session import load_session
from groundstation.tracking.registered_heads import RegisteredHeads
from groundstation.tracking.synchronise import InterpolatedAngles, ReadyFrame
from tests.session.folder import Tiny
from tests.stereo_rig import standing

NOISE_RAD = float(np.radians(0.01))
WITHHELD_DEG = 0.5
FRAMES = 10


@cache
def night() -> DrawnNight:
    return draw_night(12, FRAMES)


@cache
def station() -> Station:
    """Return the left head as a calibration has it: readings are corrected before they are angles."""
    return replace(night().true_rig["left"], ptu_sigma_rad=NOISE_RAD, ptu_resolution_rad=0.0)


@cache
def by_stars() -> StarAngles:
    return StarAngles(station(), SkyOverSite(night().site), night_solver(night()), zero())


def zero() -> float:
    return night().pictures["left"][0].utc_s - 5.0


@cache
def frames() -> tuple[tuple[float, FloatArray, ImageArray], ...]:
    """Return session time, true pan and tilt, and the picture of each frame: clouds, hot pixels, satellites in some."""
    random, sky, solver = np.random.default_rng(31), SkyOverSite(night().site), night_solver(night())
    hot = hot_pixel_map(station().lens.image_size_px, random)
    found = []
    for picture in night().pictures["left"]:
        field = star_field(picture, station(), solver, sky, 0.0, 0.0, random)
        image = render_stars(field, np.array([1.5, 0.5]), hot, random)
        found.append((picture.utc_s - zero(), picture.angles_rad, image))
    return tuple(found)


def errors_deg(sigma_rad: float, off_deg: FloatArray) -> FloatArray:
    """Return errors and sigmas (n, 3) of the frames that were registered from angles that are off by (n, 2)."""
    rows = []
    for (t_s, true, image), off in zip(frames(), np.radians(off_deg), strict=True):
        found = by_stars().register_at(image, t_s, *(true + off).tolist(), sigma_rad)
        if isinstance(found, RegisteredAngles):
            rows.append([found.pan_rad - true[0], found.tilt_rad - true[1], found.sigma_rad])
    return np.degrees(np.array(rows).reshape(-1, 3))


def test_noise_of_a_hundredth_degree_becomes_less_than_four_thousandths() -> None:
    off = np.random.default_rng(32).normal(0.0, 0.01, (FRAMES, 2))
    found = errors_deg(NOISE_RAD, off)
    assert len(found) >= FRAMES - 2
    rms = np.sqrt(np.mean(found[:, :2] ** 2, axis=0))
    assert rms.max() < 0.004, rms
    # and as well as is said, the same of both axes
    low, high = chi2.ppf([0.0005, 0.9995], 2 * len(found))
    assert low < np.sum((found[:, :2] / found[:, 2:]) ** 2) < high


def test_an_encoder_known_to_half_a_degree_becomes_one_of_hundredths() -> None:
    off = np.random.default_rng(33).uniform(-WITHHELD_DEG, WITHHELD_DEG, (FRAMES, 2))
    found = errors_deg(float(np.radians(WITHHELD_DEG / np.sqrt(3.0))), off)
    assert len(found) >= FRAMES - 2
    assert np.sqrt(np.mean(found[:, :2] ** 2, axis=0)).max() < 0.01


def test_what_shows_no_stars_or_others_is_told() -> None:
    """Expected: a covered sky, dots that are no stars, and the sky of a minute later, 0.25° off."""
    random = np.random.default_rng(34)
    t_s, true, image = frames()[0]
    angles = true.tolist()
    w, h = station().lens.image_size_px
    cloud = np.asarray(np.clip(40.0 + random.normal(0.0, 2.0, (h, w)), 0, 255), dtype=np.uint8)
    assert by_stars().register_at(cloud, t_s, *angles, NOISE_RAD) is RegistrationFault.NO_STARS
    dots = cloud.astype(np.float64)
    v, u = np.mgrid[0:h, 0:w]
    for x, y in random.uniform((20, 20), (w - 20, h - 20), (30, 2)):
        part = np.s_[int(y) - 8 : int(y) + 9, int(x) - 8 : int(x) + 9]
        dots[part] += 120.0 * np.exp(-0.5 * ((u[part] - x) ** 2 + (v[part] - y) ** 2))
    dotted = np.asarray(np.clip(dots, 0, 255), dtype=np.uint8)
    assert by_stars().register_at(dotted, t_s, *angles, NOISE_RAD) is RegistrationFault.OTHER_STARS
    late = by_stars().register_at(image, t_s + 60.0, *angles, NOISE_RAD)
    assert late in (RegistrationFault.TOO_FAR, RegistrationFault.OTHER_STARS)


def test_a_clock_that_is_a_second_off_is_in_the_angles() -> None:
    """Expected: the sky turns by 0.0042 degrees in it, fewer across the head near the pole; nothing else tells."""
    t_s, true, image = frames()[0]
    found = by_stars().register_at(image, t_s + 1.0, *true.tolist(), NOISE_RAD)
    assert isinstance(found, RegisteredAngles)
    pan, tilt = np.degrees(np.array([found.pan_rad, found.tilt_rad]) - true)
    assert 0.001 < np.hypot(pan * np.cos(true[1]), tilt) < 0.0045


def test_times_without_an_ephemeris_are_refused_or_told(tmp_path: Path) -> None:
    """Expected: a moment of another century is an error before the solver is made, a session's own clock a reason."""
    folder = Tiny(rows=3).write(tmp_path / "s")
    place = "\n[origin]\nlat_deg = 47.3\nlon_deg = 8.5\nheight_m = 460.0\ny_axis_azimuth_deg = 30.0\n"
    (folder / "session.toml").write_text((folder / "session.toml").read_text() + place)
    for moment in ("2100-01-01T00:00:00+00:00", "0001-01-01T00:00:00+00:00"):
        with pytest.raises(InputError, match=r"--stars: got a moment of which .*wanted one from 1907 to 2048"):
            star_angles(load_session(folder), datetime.fromisoformat(moment).timestamp())
    _, true, image = frames()[0]
    assert by_stars().register_at(image, 1.7e9, *true.tolist(), NOISE_RAD) is RegistrationFault.NO_PLACES


def test_recorded_angles_stay_where_the_stars_do_not_tell() -> None:
    """Expected: those of a panorama in operation, by day; where the stars tell they are the frame's."""
    t_s, true, image = frames()[1]
    rig = replace(night().true_rig, stations=(station(), night().true_rig["right"]))
    heads = RegisteredHeads(rig, {}, stars={"left": by_stars()})
    pan, tilt = (true + np.radians([0.002, -0.002])).tolist()
    for k, grey in enumerate((image, np.full_like(image, 12))):
        of_panorama = FrameAngles(t_s=t_s, station="left", pan_rad=pan, tilt_rad=tilt, sigma_rad=1e-4)
        heads.recall(of_panorama)
        frame = Frame(t_s=t_s, station="left", epoch=k, image=as_picture(np.repeat(grey[:, :, None], 3, axis=2)))
        angles = InterpolatedAngles(pan_rad=pan, tilt_rad=tilt, variance_share=1.0)
        heads.improve(ReadyFrame(record=frame, angles=angles, following=None), lambda _: None, standing)
        (found,) = heads.take_found()
        assert (found == of_panorama) == (k == 1)
    assert heads.notes() == [
        "head angles of left from the picture in 1 of 1 frames",
        "head angles of left in 1 frames from the recording",
    ]


def test_stars_are_asked_where_the_ground_does_not_tell() -> None:
    """Expected: a frame of the sky gets the stars' angles though there is a panorama; without stars both reasons."""
    t_s, true, image = frames()[1]
    ground = GroundPanorama(
        grey=np.full((40, 60), 90.0, dtype=np.float32),
        known=np.ones((40, 60), dtype=np.uint8),
        left_rad=0.1,
        top_rad=0.0,
        step_rad=1e-3,
    )
    rig = replace(night().true_rig, stations=(station(), night().true_rig["right"]))
    heads = RegisteredHeads(rig, {"left": ground}, stars={"left": by_stars()})
    fused: list[PtuSample] = []
    dark = np.full_like(image, 12)
    for grey in (image, dark):
        frame = Frame(t_s=t_s, station="left", epoch=1, image=as_picture(np.repeat(grey[:, :, None], 3, axis=2)))
        off = true + np.radians([0.012, -0.008])
        angles = InterpolatedAngles(pan_rad=float(off[0]), tilt_rad=float(off[1]), variance_share=1.0)
        heads.improve(ReadyFrame(record=frame, angles=angles, following=None), fused.append, standing)
    (sample,) = fused
    assert np.degrees([sample.pan_rad, sample.tilt_rad]) == pytest.approx(np.degrees(true), abs=0.004)
    (note,) = heads.notes()
    assert "from the picture in 1 of 2 frames" in note
    assert "too little ground in view and too few stars in view" in note


def test_a_session_says_where_it_is(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["replay", str(Tiny(rows=3).write(tmp_path / "t")), "--out", str(tmp_path / "out"), "--no-rerun"]
    assert main([*words, "--stars", "2026-05-17T21:30:00Z"]) == 1
    assert "session.toml: got no [origin]; wanted a table [origin]" in capsys.readouterr().err
    for moment in ("2026-05-17T21:30:00", "tonight"):
        with pytest.raises(SystemExit) as end:
            main([*words, "--stars", moment])
        assert end.value.code == 2
        assert "wanted a moment with its zone, as 2026-05-17T21:30:00Z" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"got no \[origin\]; wanted a table \[origin\]"):
        star_angles(load_session(Tiny(rows=3).write(tmp_path / "s")), zero())


def test_axes_are_those_of_corrected_readings() -> None:
    """Expected: a rig's scales and offsets have no second effect on angles that are corrected already."""
    plain = replace(station(), ptu_axes=PtuAxes(lean_rad=station().ptu_axes.lean_rad))
    t_s, true, image = frames()[2]
    one, two = (
        StarAngles(s, SkyOverSite(night().site), night_solver(night()), zero()).register_at(
            image, t_s, *true.tolist(), NOISE_RAD
        )
        for s in (station(), plain)
    )
    assert isinstance(one, RegisteredAngles)
    assert one == two


def test_stars_of_a_rolling_shutter_tell_the_angles_of_their_rows() -> None:
    """Expected: a turn of 1 °/s moves a star by when its row is exposed; the angles are of the instant that is said."""
    random, rate = np.random.default_rng(33), np.radians([1.0, 0.0])
    one = replace(station(), readout_s=0.03)
    geometry, height = one.geometry(), one.lens.image_size_px[1]
    drawn = star_field(
        night().pictures["left"][0], one, night_solver(night()), SkyOverSite(night().site), 0.0, 0.0, random
    )
    t_s, true, _ = frames()[0]
    moved = []
    for pixel in drawn.pixel_px:
        ray = geometry.ray(*pixel.tolist(), *true.tolist())
        delay_s = row_delay_s(float(pixel[1]), height, one.readout_s)
        seen = geometry.project(ray.origin_runway_m + 1e9 * ray.direction_runway, *(true + delay_s * rate).tolist())
        assert seen is not None
        moved.append(seen.pixel)
    # the lower half of the picture shows nothing: a hill
    above = drawn.pixel_px[:, 1] < 0.5 * height
    field = replace(drawn, pixel_px=np.array(moved)[above], flux=30.0 * drawn.flux[above], number=drawn.number[above])
    image = render_stars(field, np.array([0.0, 0.0]), hot_pixel_map(one.lens.image_size_px, random), random)
    head = StarAngles(one, SkyOverSite(night().site), night_solver(night()), zero())
    found = head.register_at(image, t_s, *true.tolist(), NOISE_RAD, (float(rate[0]), float(rate[1])))
    assert isinstance(found, RegisteredAngles)
    assert -0.4 < found.delay_s / one.readout_s < -0.1
    off = np.array([found.pan_rad, found.tilt_rad]) - (true + found.delay_s * rate)
    assert np.abs(off).max() < 3.5 * found.sigma_rad
    assert abs(found.delay_s * rate[0]) > 5.0 * found.sigma_rad
