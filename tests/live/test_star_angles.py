"""Head angles by the stars in operation: in some frames, the encoder's error carried between, and what refuses."""

import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from calibration.stars.simulated.observed_night import night_solver
from calibration.stars.simulated.star_field import star_field
from calibration.stars.simulated.star_renderer import hot_pixel_map, render_stars
from calibration.stars.sky import SkyOverSite
from calibration.stars.star_angles import StarAngles, star_angles_in_operation
from calibration.stars.star_images import NO_STARS, StarImages
from groundstation.arrays import FloatArray, ImageArray
from groundstation.cli.main import main
from groundstation.cli.star_loader import load_stars
from groundstation.errors import ConfigError, InputError, MissingExtraError
from groundstation.live.check import check_station
from groundstation.live.command import LiveRequest
from groundstation.live.command import live as operate_live
from groundstation.live.core import LiveCore, LiveStep, live_config
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.input_queue import TimedPicture
from groundstation.live.live_stars import frames_apart, registered_heads
from groundstation.live.record import live_header
from groundstation.live.station_file import load_station
from groundstation.messages import CameraReport, FrameAngles, PtuSample, StepReport
from groundstation.picture import as_picture
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from groundstation.registration.head_registration import RegisteredAngles, RegistrationFault
from groundstation.rig.rig import Rig
from groundstation.session.folder import GeoOrigin
from groundstation.session.site_air import SiteAir
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.registered_heads import BETWEEN_STARS, RegisteredHeads
from tests.calibration.landmarks.sighting_set_up import true_rig, write_station
from tests.calibration.stars.test_star_angles import night, station, zero

RATE_HZ, EVERY, PAIRS = 10.0, 2, 10
# the left encoder's, and what its rig says
WRONG_DEG, SIGMA_DEG, NOISE_DEG = np.array([0.02, -0.015]), 0.02, 0.002
ORIGIN = "[origin]\nlat_deg = 47.1\nlon_deg = 8.6\nheight_m = 480\ny_axis_azimuth_deg = 35\n"


def rig() -> Rig:
    """Return the drawn night's heads, of which the left one's encoder is poor; nothing in it is uncertain but that."""
    left = replace(station(), ptu_sigma_rad=float(np.radians(SIGMA_DEG)))
    right = replace(left, name="right", ptu_position_m=left.ptu_position_m + np.array([5.0, 0.0, 0.0]))
    return Rig(stations=(left, right))


@cache
def sky_frames() -> tuple[tuple[float, ImageArray], ...]:
    """Return session times and pictures of a head that stands under a clear sky, at the frames that are looked at."""
    random, sky, solver = np.random.default_rng(41), SkyOverSite(night().site), night_solver(night())
    hot = hot_pixel_map(station().lens.image_size_px, random)
    first, found = night().pictures["left"][0], []
    for k in range(0, PAIRS, EVERY):
        t_s = 5.0 + k / RATE_HZ
        field = star_field(replace(first, utc_s=zero() + t_s), station(), solver, sky, 0.0, 0.0, random)
        found.append((t_s, render_stars(field, np.array([0.3, 0.1]), hot, random)))
    return tuple(found)


def core(heads: RegisteredHeads) -> LiveCore:
    config = live_config(Config(), RATE_HZ)
    # nothing flies: what would look for it takes most of the time
    pipeline = Pipeline(rig(), config, heads=heads, callbacks=dict.fromkeys(rig().names, lambda *_: ()))
    pattern = SearchPattern({s.name: s.geometry() for s in rig().stations}, SearchConfig())
    return LiveCore(pipeline, FramePairer(rig().names, 1.0 / RATE_HZ), {}, pattern)


def operate(live: LiveCore, pictures: Mapping[int, ImageArray]) -> LiveStep:
    """Give a core readings that are off and pictures, dark ones where there are no others; return what it made."""
    random, done = np.random.default_rng(42), LiveStep()
    true = np.degrees(night().pictures["left"][0].angles_rad)
    dark = np.full_like(sky_frames()[0][1], 12)

    def add(step: LiveStep) -> None:
        done.consumed.extend(step.consumed)
        done.reports.extend(step.reports)

    for k in range(PAIRS):
        t_s = 5.0 + k / RATE_HZ
        for name in rig().names:
            for at_s in (t_s - 0.02, t_s - 0.01, t_s + 0.01, t_s + 0.02):
                pan, tilt = np.radians(true + WRONG_DEG + random.normal(0.0, NOISE_DEG, 2)).tolist()
                add(live.take(PtuSample(t_s=at_s, station=name, pan_rad=pan, tilt_rad=tilt), at_s))
                if at_s == t_s - 0.01:
                    grey = pictures.get(k, dark) if name == "left" else dark
                    picture = as_picture(np.repeat(grey[:, :, None], 3, axis=2))
                    add(live.take(TimedPicture(t_s=t_s, station=name, picture=picture, arrived_s=t_s), t_s))
    add(live.finish())
    return done


def left_off_deg(reports: list[StepReport]) -> FloatArray:
    """Return how far pan and tilt (n, 2) of the left camera's frames are off."""
    true = np.degrees(night().pictures["left"][0].angles_rad)
    seen = [c for report in reports for c in report.cameras if c.station == "left"]
    assert len(seen) == PAIRS
    return np.degrees([angles(c) for c in seen]) - true


def angles(camera: CameraReport) -> tuple[float, float]:
    assert camera.pan_rad is not None
    assert camera.tilt_rad is not None
    return camera.pan_rad, camera.tilt_rad


def by_stars() -> RegisteredHeads:
    sky = StarAngles(rig()["left"], SkyOverSite(night().site), night_solver(night()), zero(), in_operation=True)
    return RegisteredHeads(rig(), {}, stars={"left": sky}, stars_every=EVERY)


def test_stars_remove_the_encoder_s_error_and_a_replay_has_it_without_them() -> None:
    """Expected: where stars are looked for the angles are theirs; between, the encoder's without what was found."""
    live = operate(core(by_stars()), {EVERY * k: image for k, (_, image) in enumerate(sky_frames())})
    off = np.abs(left_off_deg(live.reports))
    assert off[::EVERY].max() < 0.001
    # the first picture tells half of the error, each further one more
    assert off[1::EVERY].max() < 0.012
    assert off[5::EVERY].max() < 0.007
    notes = [event.text for report in live.reports for event in report.events]
    told = f"from the picture in {PAIRS // EVERY} of {PAIRS} frames; {PAIRS - PAIRS // EVERY} the encoder's"
    assert f"head angles of left {told}: {BETWEEN_STARS}" in notes
    assert len([e for e in live.consumed if isinstance(e, FrameAngles)]) == PAIRS // EVERY
    plain = Pipeline(rig(), live_config(Config(), RATE_HZ), callbacks=dict.fromkeys(rig().names, lambda *_: ()))
    again = [*(plain.step(event) for event in live.consumed), plain.finish()]
    assert np.array_equal(left_off_deg(again), left_off_deg(live.reports))


def test_clouds_leave_the_encoder_and_are_told() -> None:
    """Expected: readings as they came, of a head that has never seen a star, and the reason in the log."""
    live = operate(core(by_stars()), {})
    assert np.abs(left_off_deg(live.reports) - WRONG_DEG).max() < 4.0 * NOISE_DEG
    notes = [event.text for report in live.reports for event in report.events]
    told = f"head angles of left from the picture in 0 of {PAIRS} frames; {PAIRS // EVERY} the encoder's:"
    assert any(note.startswith(told) and RegistrationFault.NO_STARS.value in note for note in notes)
    assert not any(isinstance(event, FrameAngles) for event in live.consumed)


def test_operation_looks_at_the_brightest_dots_alone_and_as_often_as_it_may() -> None:
    """Expected: the accuracy of all dots; no solver for what encoders do not expect; by day nothing at all."""
    solver, asked = night_solver(night()), list[int]()

    def refuse(seen: StarImages) -> str:
        asked.append(len(seen))
        return "not solved"

    solver.solve = refuse  # type: ignore[method-assign]
    bounded, whole = (
        StarAngles(station(), SkyOverSite(night().site), solver, zero(), in_operation=bound) for bound in (True, False)
    )
    t_s, image = sky_frames()[0]
    true = night().pictures["left"][0].angles_rad
    found = bounded.register_at(image, t_s, *true.tolist(), station().angle_sigma_rad)
    assert isinstance(found, RegisteredAngles)
    assert np.degrees([found.pan_rad, found.tilt_rad]) == pytest.approx(np.degrees(true), abs=0.001)
    # half a degree off: the encoder's sigma does not reach so far
    off = (true + np.radians([0.5, 0.0])).tolist()
    for stars, times in ((bounded, 0), (whole, 1)):
        assert stars.register_at(image, t_s, *off, station().angle_sigma_rad) is RegistrationFault.OTHER_STARS
        assert len(asked) == times
    assert bounded.register_at(image, t_s + 43_200.0, *true.tolist(), 1e-4) is RegistrationFault.DAYLIGHT
    assert bounded.seconds > 0.0
    assert [frames_apart([s], 30.0) for s in (0.001, 0.03, 0.031, 0.1)] == [1, 9, 10, 30]


def test_what_a_frame_takes_counts_threads_of_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: at least what a thread that looks for the dots has spent."""
    spent_s = 0.02

    def spend() -> None:
        began_s = time.thread_time()
        while time.thread_time() < began_s + spent_s:
            pass

    def found_in_a_thread(*_: object, **__: object) -> StarImages:
        thread = Thread(target=spend)
        thread.start()
        thread.join()
        return NO_STARS

    monkeypatch.setattr("calibration.stars.star_angles.find_stars", found_in_a_thread)
    stars = StarAngles(station(), SkyOverSite(night().site), night_solver(night()), zero(), in_operation=True)
    assert stars.seconds >= spent_s


class Timed:
    """Stars that tell nothing, of a known duration."""

    seconds = 0.04

    def searches(self, sigma_rad: float) -> bool:
        return False

    def register_at(self, *_: object) -> RegistrationFault:
        return RegistrationFault.NO_STARS


def with_stars(folder: Path, more: str = ORIGIN) -> Path:
    path = write_station(folder, true_rig())
    path.write_text(path.read_text().replace("rate_hz = 50\n", f"rate_hz = 50\nstars = true\n{more}"))
    return path


def test_a_station_file_asks_for_stars(tmp_path: Path) -> None:
    file = load_station(with_stars(tmp_path, ORIGIN + "[air]\npressure_hpa = 950\nair_c = -3.5\n"))
    assert file.stars
    asked: list[tuple[GeoOrigin, SiteAir, float]] = []

    def load(rig: Rig, origin: GeoOrigin, air: SiteAir, zero_utc_s: float) -> dict[str, Timed]:
        asked.append((origin, air, zero_utc_s))
        return {name: Timed() for name in rig.names}

    assert registered_heads(file, file.load_rig(), load, 1.7e9).names == ("left", "right")
    ((origin, air, zero_utc_s),) = asked
    assert (origin.lat_deg, air, zero_utc_s) == (47.1, SiteAir(pressure_hpa=950.0, air_c=-3.5), 1.7e9)
    assert "[air]\npressure_hpa = 950" in live_header(file, Config()).files["session.toml"].decode()
    with pytest.raises(ConfigError, match=r"field\.toml: stars: got true; wanted false"):
        registered_heads(file, file.load_rig(), None, 1.7e9)

    def no_patterns(*_: object) -> dict[str, Timed]:
        raise InputError("stars", got="a field of view of 2 deg", wanted="3 to 60 deg")

    with pytest.raises(ConfigError, match=r"field\.toml: stars: .*got a field of view of 2 deg"):
        registered_heads(file, file.load_rig(), no_patterns, 1.7e9)
    with pytest.raises(
        ConfigError, match=r"field\.toml: stars: this machine's clock: got .*wanted one from 1907 to 2048"
    ):
        registered_heads(file, file.load_rig(), star_angles_in_operation, 4e9)


def test_a_station_that_does_not_say_where_it_is_has_no_stars(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = with_stars(tmp_path, "")
    assert main(["live", str(path), "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert f"{path}: origin: got nothing; wanted a table [origin]" in said
    assert not (tmp_path / "out").exists()


def test_without_the_extra_it_is_said_before_a_device_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: `live` does not begin and says what to install; `check` has a line of it; without stars both do."""
    monkeypatch.setitem(sys.modules, "tetra3rs", None)
    path = with_stars(tmp_path)
    request = LiveRequest(station=path, out=tmp_path / "out", seconds=1.0, stars=load_stars)
    with pytest.raises(MissingExtraError, match=r"pip install 'groundstation\[stars\]'"):
        operate_live(request, stop=lambda: False, tell=lambda _: None, say=lambda _: None)
    assert not (tmp_path / "out").exists()
    lines = list(islice(check_station(path, 0.1, move=False, stars=load_stars), 3))
    assert not lines[2].good
    assert "pip install 'groundstation[stars]'" in lines[2].text
