"""Heads that follow airliners: chosen by reach, met in the picture, clear of the Sun; what is skipped, what ends it."""

import argparse
import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.sky.adsb import AdsbReport, as_json
from calibration.sky.airliner_choice import SkyReach, choose_airliner, course_of, courses_of, seconds_in_reach
from calibration.sky.simulated.day_draw import Airliner
from calibration.stars.pointing_plan import HeadRange
from calibration.stars.simulated.night_draw import drawn_station
from calibration.stars.site_file import site_to_toml
from calibration.stars.sky import ObservingSite, SkyOverSite
from groundstation.arrays import FloatArray
from groundstation.cli.adsb_receiver import AdsbReceiver
from groundstation.cli.head_pictures import unopened_head
from groundstation.cli.main import main
from groundstation.cli.sky_recorder import AirlinerOrders, AirlinerRecorder, RecorderClock
from groundstation.cli.standing_heads import StandingPlace
from groundstation.cli.star_recorder import PictureFolder
from groundstation.errors import InputError
from groundstation.geometry.aim import aim_at
from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef, runway_axes
from groundstation.live import sighting_station
from groundstation.live.head_device import DeviceError
from groundstation.live.keep_out_unit import KeepOutError
from groundstation.live.sighting_station import StandingPicture
from ptu_drivers.monitor import MoveResult
from ptu_drivers.simulated.server import SimulatedServer
from tests.calibration.landmarks.sighting_set_up import brisk_unit, true_rig, write_station
from tests.live.test_heads import COUNT_RAD, pan_rate_of, until

NOON = 1_779_364_800.0
SITE = ObservingSite(lat_deg=47.0, lon_deg=8.0, height_m=500.0, y_axis_azimuth_deg=0.0)
STATIONS = (drawn_station("left", -5.0, 10.96, 0.00625), drawn_station("right", 5.0, 10.96, 0.00625))
WITHIN = HeadRange(pan_deg=(-60.0, 60.0), tilt_deg=(5.0, 55.0))
ORDERS = AirlinerOrders(airliners=2, stops=6, most_s=600.0)
LATENCY_S = 1.7


def reach_of(sun: FloatArray | None = None) -> SkyReach:
    return SkyReach(stations=STATIONS, within=WITHIN, sun=sun, sun_rad=np.radians(20.0), pictures_s=ORDERS.pictures_s)


def passing(
    aside_m: float, away_m: float, up_m: float = 10_000.0, speed: float = 230.0, at_s: float = NOON
) -> Airliner:
    """Return an airliner that flies to the right, before the heads at a time."""
    return Airliner(
        nearest_m=np.array([aside_m, away_m, up_m]),
        velocity_m_s=np.array([speed, 0.0, 0.0]),
        turn_rad_s=0.0,
        utc_s=at_s,
    )


def reports_of_flight(
    name: str, airliner: Airliner, times: FloatArray, site: ObservingSite = SITE
) -> tuple[AdsbReport, ...]:
    """Return positions that are stamped late."""
    east_north_up = airliner.at(times) @ runway_axes(site.y_axis_azimuth_deg)
    lat, lon, height = geodetic_from_ecef(ecef_from_enu(east_north_up, (site.lat_deg, site.lon_deg, site.height_m)))
    return tuple(
        AdsbReport(
            aircraft=name,
            t_s=float(t) + LATENCY_S,
            lat_deg=float(lat[k]),
            lon_deg=float(lon[k]),
            height_m=float(height[k]),
            geometric=True,
        )
        for k, t in enumerate(times)
    )


class Scene:
    """Simulated time, its airliners, and a receiver that replays what came until now."""

    def __init__(self, flights: Mapping[str, Airliner], site: ObservingSite = SITE) -> None:
        self.now_s = NOON - 60.0
        self.flights = flights
        times = NOON + np.arange(-120.0, 400.0)
        self._all = {name: reports_of_flight(name, flight, times, site) for name, flight in flights.items()}
        self.ends_s = np.inf
        self.wait: Callable[[float], None] = self._pass

    def _pass(self, seconds: float) -> None:
        self.now_s += seconds

    def newest(self) -> Mapping[str, Sequence[AdsbReport]]:
        came = {n: [r for r in own if self.now_s - 120.0 < r.t_s <= self.now_s] for n, own in self._all.items()}
        return {name: own for name, own in came.items() if own}

    def ended(self) -> str:
        return "the receiver is off" if self.now_s >= self.ends_s else ""

    def clock(self) -> RecorderClock:
        def wait(seconds: float) -> None:
            self.wait(seconds)

        return RecorderClock(now=lambda: self.now_s, wait=wait)


class TurningHead:
    """A head at 5 deg/s in simulated time; ``before_turn`` may raise."""

    def __init__(self, name: str, scene: Scene) -> None:
        self.name, self._scene = name, scene
        self._at = np.zeros(2)
        self.before_turn: Callable[[], None] = lambda: None

    def angles(self) -> FloatArray:
        return self._at

    def turn_to(self, pan_rad: float, tilt_rad: float) -> tuple[MoveResult, ...]:
        self.before_turn()
        wanted = np.array([pan_rad, tilt_rad])
        self._scene.now_s += 0.3 + float(np.abs(wanted - self._at).max()) / np.radians(5.0)
        self._at = wanted
        return ()

    def pictures(self, count: int, readings: int) -> Iterator[StandingPicture]:
        assert readings > 1
        for _ in range(count):
            self._scene.now_s += 0.4
            image = np.zeros((4, 4, 3), dtype=np.uint8)
            yield StandingPicture(t_s=self._scene.now_s, image=image, angles_rad=self._at, mean_rad=self._at)
            self._scene.now_s += 0.1


def recorder(
    folder: Path, scene: Scene, orders: AirlinerOrders = ORDERS, site: ObservingSite = SITE, sun_deg: float = 0.0
) -> tuple[AirlinerRecorder, list[TurningHead], list[str]]:
    heads, said = [TurningHead(s.name, scene) for s in STATIONS], list[str]()
    places = {s.name: StandingPlace(sun_rad=float(np.radians(sun_deg)), park_rad=(0.0, 0.0)) for s in STATIONS}
    made = AirlinerRecorder(
        heads, reach_of(), orders, scene, SkyOverSite(site), PictureFolder(folder), scene.clock(), said.append, places
    )
    return made, heads, said


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "pictures.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def off_middle(row: dict[str, str], airliner: Airliner) -> FloatArray:
    """Return how far (2,) an airliner is from a picture's middle, as a share of its size."""
    station = next(s for s in STATIONS if s.name == row["station"])
    senses = float(row["pan_from"]), float(row["tilt_from"])
    pan, tilt = np.radians([float(row["pan_deg"]), float(row["tilt_deg"])]).tolist()
    place = airliner.at(np.array([float(row["t_utc_s"])]))[0]
    projected = station.geometry().project(place, *station.ptu_axes.angles(pan, tilt, *senses))
    assert projected is not None
    return (projected.pixel - station.lens.principal_point_px) / np.array(station.lens.image_size_px)


def test_airliners_are_met_in_the_picture_by_heads_that_stand(tmp_path: Path) -> None:
    """Expected: the nearer one first, six stops of both heads, always well inside; one at 80 km never."""
    flights = {
        "a00001": passing(0.0, 30_000.0),
        "a00002": passing(0.0, 18_000.0),
        "a00003": passing(0.0, 80_000.0),
    }
    scene = Scene(flights)
    made, _, said = recorder(tmp_path, scene)
    assert made.run() == ("a00002", "a00001")
    rows = rows_of(tmp_path)
    assert len(rows) == 2 * 2 * 6 * 3
    half = len(rows) // 2
    for name, own in (("a00002", rows[:half]), ("a00001", rows[half:])):
        off = np.array([off_middle(row, flights[name]) for row in own])
        # half a picture is 0.5; a latency of 1.7 s where 1 s is taken is part of it
        assert np.abs(off).max() < 0.3
        assert {(row["pan_from"], row["tilt_from"]) for row in own} == {
            ("1", "1"), ("-1", "1"), ("1", "-1"), ("-1", "-1"),
        }  # fmt: skip
    assert "airliner a00002: 6 stops of each head" in said


def test_airliners_near_the_sun_are_let_go(tmp_path: Path) -> None:
    """Expected: heads that look south at noon take no picture within 20 deg of the Sun, and do take some."""
    site = replace(SITE, y_axis_azimuth_deg=180.0, lat_deg=70.0)
    sky = SkyOverSite(site)
    sun = sky.body("sun", NOON)
    assert 0.5 < sun[2] < 0.8
    near = passing(0.0, 16_000.0, up_m=16_000.0 * float(sun[2] / sun[1]), at_s=NOON + 60.0)
    scene = Scene({"a00001": near}, site)
    made, heads, _ = recorder(tmp_path, scene, replace(ORDERS, airliners=1, stops=60, most_s=240.0), site)
    del heads
    made.run()
    towards = []
    for row in rows_of(tmp_path):
        station = next(s for s in STATIONS if s.name == row["station"])
        pan, tilt = np.radians([float(row["pan_deg"]), float(row["tilt_deg"])]).tolist()
        towards.append(station.geometry().camera_pose(pan, tilt).runway_from_camera[:, 2])
    off = np.degrees(np.arccos(np.array(towards) @ sun))
    assert len(off) >= 12
    assert off.min() > 19.0


def test_the_moon_is_looked_at_while_no_airliner_is_in_reach(tmp_path: Path) -> None:
    """Expected: four stops of each head from all sides, the Moon in each picture and aside of its middle."""
    # the Moon stands in the south at this latitude
    site = replace(SITE, y_axis_azimuth_deg=180.0)
    sky = SkyOverSite(site)
    hours = NOON + 3600.0 * np.arange(700.0)
    utc_s = next(t for t in hours.tolist() if _is_in_front(sky.body("moon", t), sky.body("sun", t)))
    scene = Scene({})
    scene.now_s = utc_s
    made, _, said = recorder(tmp_path, scene, replace(ORDERS, most_s=120.0), site)
    assert made.run() == ()
    rows = rows_of(tmp_path)
    assert len(rows) == 2 * 4 * 3
    off = []
    for row in rows:
        station = next(s for s in STATIONS if s.name == row["station"])
        pan, tilt = np.radians([float(row["pan_deg"]), float(row["tilt_deg"])]).tolist()
        place = station.ptu_position_m + 1e8 * sky.body("moon", float(row["t_utc_s"]))
        projected = station.geometry().project(place, pan, tilt)
        assert projected is not None
        off.append((projected.pixel - station.lens.principal_point_px) / np.array(station.lens.image_size_px))
    assert np.abs(off).min() > 0.1
    assert np.abs(off).max() < 0.35
    assert {(row["pan_from"], row["tilt_from"]) for row in rows} == {
        ("1", "1"), ("-1", "1"), ("1", "-1"), ("-1", "-1"),
    }  # fmt: skip
    assert any(line.startswith("left: the Moon, pan") for line in said)


def _is_in_front(moon: FloatArray, sun: FloatArray) -> bool:
    return bool(
        moon[1] > 0.7 * np.hypot(moon[0], moon[1]) and 0.3 < moon[2] < 0.6 and sun[2] > 0.1 and moon @ sun < 0.9
    )


def test_what_is_out_of_reach_is_not_chosen() -> None:
    now = NOON - 10.0
    flights = {
        "near": passing(0.0, 3_000.0, up_m=2_000.0),
        "low": passing(0.0, 40_000.0, up_m=2_000.0),
        "behind": passing(0.0, -20_000.0),
        "far": passing(0.0, 70_000.0),
        "good": passing(0.0, 20_000.0),
    }
    reports = {n: reports_of_flight(n, f, now - LATENCY_S - np.arange(20.0)[::-1]) for n, f in flights.items()}
    courses = courses_of(reports, now, SITE)
    assert len(courses) == 5
    seconds = {course.aircraft: seconds_in_reach(course, reach_of(), now) for course in courses}
    assert {name for name, value in seconds.items() if value > 0.0} == {"good"}
    chosen = choose_airliner(courses, reach_of(), now, 30.0, ())
    assert chosen is not None
    assert chosen.aircraft == "good"
    assert choose_airliner(courses, reach_of(), now, 30.0, ("good",)) is None
    # a minute later the positions are old
    assert courses_of(reports, now + 60.0, SITE) == ()
    assert course_of(reports["good"][:2], now, SITE) is None


def test_a_course_leads_where_the_airliner_will_be() -> None:
    """Expected: a latency of 1.7 s of which 1 s is allowed for is 0.7 s of its way, and no more."""
    flight = passing(0.0, 20_000.0)
    course = course_of(reports_of_flight("a", flight, NOON + np.arange(-30.0, 0.0)), NOON + LATENCY_S, SITE)
    assert course is not None
    off = course.at(NOON + 10.0) - flight.at(np.array([NOON + 10.0]))[0]
    assert off[0] == pytest.approx(-0.7 * 230.0, abs=5.0)
    assert np.abs(off[1:]).max() < 5.0


def test_a_way_that_is_closed_is_skipped_and_a_head_that_fails_ends_it(tmp_path: Path) -> None:
    scene = Scene({"a00001": passing(0.0, 20_000.0)})
    made, heads, said = recorder(tmp_path / "closed", scene, replace(ORDERS, airliners=1))
    turns = []

    def closed() -> None:
        turns.append(scene.now_s)
        if len(turns) % 3 == 0:
            raise DeviceError("left: PTU: closed") from KeepOutError("closed")

    heads[0].before_turn = closed
    made.run()
    assert any(line.startswith("left: no picture: left: PTU: closed") for line in said)
    assert {row["station"] for row in rows_of(tmp_path / "closed")} == {"left", "right"}

    scene = Scene({"a00001": passing(0.0, 20_000.0)})
    made, heads, _ = recorder(tmp_path / "broken", scene)

    def broken() -> None:
        raise DeviceError("PTU: no answer")

    heads[0].before_turn = heads[1].before_turn = broken
    with pytest.raises(DeviceError, match="no answer"):
        made.run()


def test_an_airliner_to_which_ways_are_closed_is_let_go_and_counts_for_none(tmp_path: Path) -> None:
    """Expected: five airliners in reach and no way open: none is followed, the time passes."""
    scene = Scene({f"a0000{k}": passing(0.0, 18_000.0 + 4_000.0 * k) for k in range(5)})
    made, heads, said = recorder(tmp_path, scene, replace(ORDERS, airliners=5))
    began_s = scene.now_s

    def closed() -> None:
        raise DeviceError("PTU: closed") from KeepOutError("closed")

    for head in heads:
        head.before_turn = closed
    assert made.run() == ()
    assert scene.now_s >= began_s + ORDERS.most_s
    let_go = [line for line in said if "let go" in line]
    assert len(let_go) == 5
    assert "airliner a00000: 0 stops of each head" in said
    assert made.refused == 5 * 5
    assert said[-1] == "25 of 25 ways were refused, the last: PTU: closed"


def test_heads_that_wait_are_turned_away_before_the_sun_comes(tmp_path: Path) -> None:
    """Expected: 10 deg are kept though the Sun moves 20 deg in the hour, in which no airliner comes; then parked."""
    site = replace(SITE, y_axis_azimuth_deg=180.0)
    sky = SkyOverSite(site)
    scene = Scene({}, site)
    sun = sky.body("sun", scene.now_s + 1800.0)
    made, heads, said = recorder(tmp_path, scene, replace(ORDERS, most_s=3600.0), site, sun_deg=10.0)
    off = []
    for head, station in zip(heads, STATIONS, strict=True):
        aim = aim_at(station.geometry(), station.ptu_position_m + 1e9 * sun)
        assert aim is not None
        # some degrees ahead of the Sun
        head.turn_to(aim.pan_rad + 0.2, aim.tilt_rad)

    def watched(seconds: float) -> None:
        scene.now_s += 60.0 * seconds
        towards = sky.body("sun", scene.now_s)
        for head, station in zip(heads, STATIONS, strict=True):
            axis = station.geometry().camera_pose(*head.angles()).runway_from_camera[:, 2]
            off.append(float(np.degrees(np.arccos(axis @ towards))))

    scene.wait = watched
    assert made.run() == ()
    assert min(off) > 9.9
    assert {line.split(",")[0] for line in said if "turned away" in line} == {
        f"{head.name}: turned away from the Sun" for head in heads
    }
    made.leave()
    assert [head.angles().tolist() for head in heads] == [[0.0, 0.0]] * 2
    assert said[-1].startswith("right: left at pan 0.0, tilt 0.0")


def test_a_head_that_cannot_park_is_turned_clear_or_told_of(tmp_path: Path) -> None:
    site = replace(SITE, y_axis_azimuth_deg=180.0)
    scene = Scene({}, site)
    made, heads, said = recorder(tmp_path, scene, ORDERS, site, sun_deg=10.0)
    sun = SkyOverSite(site).body("sun", scene.now_s)
    for head, station in zip(heads, STATIONS, strict=True):
        aim = aim_at(station.geometry(), station.ptu_position_m + 1e9 * sun)
        assert aim is not None
        head.turn_to(aim.pan_rad, aim.tilt_rad)
    turns = []

    def first_closed() -> None:
        turns.append(0)
        if len(turns) == 1:
            raise DeviceError("left: PTU: closed") from KeepOutError("closed")

    def closed() -> None:
        raise DeviceError("right: PTU: closed") from KeepOutError("closed")

    heads[0].before_turn, heads[1].before_turn = first_closed, closed
    made.leave()
    axis = STATIONS[0].geometry().camera_pose(*heads[0].angles()).runway_from_camera[:, 2]
    assert np.degrees(np.arccos(axis @ sun)) > 20.0
    assert said[0] == "left: not parked: left: PTU: closed"
    assert "the Sun comes to its lens at" not in said[1]
    assert "right: left at" in said[-1]
    assert said[-1].endswith("the Sun comes to its lens at 11:59 UTC: cover it")


def test_a_rig_and_a_site_that_are_given_keep_heads_off_the_sun(tmp_path: Path, monkeypatch) -> None:
    """Expected: the head is opened with the rig of --rig and the place of --site, not with the station file's."""
    opened = []

    class NotOpened:
        def __init__(self, *_: object, **given: object) -> None:
            opened.append((given["rig"], given["origin"]))

    monkeypatch.setattr(sighting_station, "GuardedHead", NotOpened)
    write_station(tmp_path, true_rig())
    other = true_rig()
    options = argparse.Namespace(station_file=tmp_path / "field.toml", rate=5.0, exposure=None, gain=None)
    made = unopened_head(options, "left", other, SITE)
    assert made.calibrated is other["left"]
    rig, origin = opened[0]
    assert rig is other
    assert (origin.lat_deg, origin.lon_deg, origin.y_axis_azimuth_deg) == (47.0, 8.0, 0.0)


def test_without_airliners_it_ends_with_the_time_or_the_receiver(tmp_path: Path) -> None:
    scene = Scene({"a00001": passing(0.0, 80_000.0)})
    made, _, said = recorder(tmp_path, scene, replace(ORDERS, most_s=120.0))
    assert made.run() == ()
    assert said[-1] == "2 minutes are over"
    assert sum("none in reach" in line for line in said) == 4
    scene.ends_s = scene.now_s + 20.0
    assert made.run() == ()
    assert said[-1] == "the receiver is off"


def test_a_file_that_grows_or_is_written_again_is_a_receiver(tmp_path: Path) -> None:
    """Expected: lines that are there, lines added in parts, and whole files put in its place, each position once."""
    path = tmp_path / "aircraft.json"
    own = reports_of_flight("a00001", passing(0.0, 20_000.0), NOON + np.arange(4.0))
    first, second, third, fourth = (as_json(report) for report in own)
    path.write_text(first + "\n" + second[:20])
    with AdsbReceiver(f"file:{path}", tmp_path / "kept.jsonl") as receiver:
        assert until(lambda: receiver.count == 1, 5.0)
        with path.open("a") as file:
            file.write(second[20:] + "\n")
        assert until(lambda: receiver.count == 2, 5.0)
        for line in (third, third, fourth):
            (tmp_path / "new").write_text(json.dumps({"now": NOON, "aircraft": [json.loads(line)]}))
            (tmp_path / "new").replace(path)
            time.sleep(0.6)
        assert until(lambda: receiver.count == 4, 5.0)
        assert [r.t_s for r in receiver.newest()["a00001"]] == pytest.approx([r.t_s for r in own], abs=1e-3)
        assert receiver.ended() == ""
    assert len((tmp_path / "kept.jsonl").read_text().splitlines()) == 4
    with pytest.raises(InputError, match="no such file"), AdsbReceiver("file:/none", tmp_path / "kept.jsonl"):
        pass


def write_field(folder: Path, seconds: float) -> list[str]:
    """Write a station whose heads have an airliner in reach now, and return the command's words."""
    write_station(folder, true_rig())
    (folder / "site.toml").write_text(site_to_toml(SITE))
    flight = passing(0.0, 25_000.0, speed=200.0, at_s=time.time())
    times = time.time() + np.arange(-30.0, seconds)
    lines = [as_json(r) for r in reports_of_flight("a00001", flight, times)]
    (folder / "lines.jsonl").write_text("\n".join(lines) + "\n")
    words = ["calibrate", "sky", str(folder / "field.toml"), "--site", str(folder / "site.toml")]
    words += ["--receive", f"file:{folder}/lines.jsonl", "--out", str(folder / "sky.toml")]
    # the Sun may stand anywhere now: the rule itself is tested above
    return [*words, "--airliners", "1", "--stops", "1", "--sun", "0.01"]


def test_the_command_turns_heads_to_an_airliner_and_keeps_pictures_and_positions(tmp_path: Path, capsys) -> None:
    """Expected: cameras that show no airliner end it with the reason; pictures and positions stay, unmixed."""
    words = write_field(tmp_path, 90.0)
    with brisk_unit(tmp_path / "left"), brisk_unit(tmp_path / "right"):
        assert main([*words, "--rate", "50"]) == 1
    said = capsys.readouterr()
    assert "airliner a00001: 1 stops of each head" in said.out
    assert "airliner" in said.err
    rows = rows_of(tmp_path / "sky.pictures")
    assert [row["station"] for row in rows] == ["left"] * 3 + ["right"] * 3
    assert (tmp_path / "sky.pictures" / "adsb.jsonl").is_file()
    assert main([*words, "--rate", "50"]) == 1
    assert "got pictures of another night or day" in capsys.readouterr().err


@pytest.mark.usefixtures("interrupts_heard")
def test_heads_stand_after_ctrl_c(tmp_path: Path) -> None:
    words = write_field(tmp_path, 90.0)
    with brisk_unit(tmp_path / "left") as left, brisk_unit(tmp_path / "right"):
        command = [sys.executable, "-m", "groundstation", *words, "--rate", "1.5"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert until(lambda: abs(pan_rate_of(left)) > 0.0, 180.0)
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=120.0)
        assert process.returncode == 130
        assert "pictures until now are in" in out
        assert until(lambda: pan_rate_of(left) == 0.0, 2.0)


def test_heads_stand_where_the_program_is_killed(tmp_path: Path) -> None:
    """Expected: the motion guard halts the head on its way to the airliner, long before it is there."""
    words = write_field(tmp_path, 90.0)
    with brisk_unit(tmp_path / "left") as left, brisk_unit(tmp_path / "right") as right:
        command = [sys.executable, "-m", "groundstation", *words, "--rate", "1.5"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, text=True) as process:
            assert until(lambda: abs(tilt_of(left, "speed")) > np.radians(1.0), 60.0)
            process.kill()
        assert until(lambda: all(tilt_of(s, "speed") == pan_rate_of(s) == 0.0 for s in (left, right)), 6.0)
        # the airliner is 17 deg high and more: at 1.5 deg/s that is 11 s
        assert np.degrees(tilt_of(left, "head")) < 14.0


def tilt_of(server: SimulatedServer, what: str) -> float:
    """Return a head's tilt, rad ("head"), or its speed, rad/s ("speed"), now."""
    with server.lock:
        return float(getattr(server.line.unit.flir.axes["T"], what)(time.monotonic())) * COUNT_RAD


def test_heads_that_would_not_be_kept_off_the_sun_do_not_turn(tmp_path: Path, capsys) -> None:
    """Expected: refused before any device is opened, unless the station file says that the Sun does not matter."""
    words = write_field(tmp_path, 90.0)
    path = tmp_path / "field.toml"
    path.write_text(path.read_text().replace("[safety]\nsun_angle_deg = 0\n", ""))
    assert main(words) == 1
    assert (
        "field.toml: got no [origin]; wanted [origin], so that lenses are kept off the Sun" in capsys.readouterr().err
    )
    assert not (tmp_path / "sky.pictures").exists()
    lost = [replace(station, known=("position", "lens")) for station in true_rig().stations]
    write_station(tmp_path, replace(true_rig(), stations=tuple(lost)))
    assert main(words) == 1
    assert "wanted a calibrated orientation" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["f.toml", "--out", "o.toml"], "STATION.toml: got no --receive"),
        (["f.toml", "--receive", "h:1"], "got no --out"),
        (["f.toml", "--receive", "h:1", "--out", "o.toml", "--keep", "k"], "--keep: got --out as well"),
        (["f.toml", "--from", ".", "--receive", "h:1", "--out", "o.toml"], "--receive: got --from as well"),
        (["f.toml", "--from", ".", "--out", "o.toml", "--stops", "3"], "--stops: got --from as well"),
        (["f.toml", "--receive", "h", "--out", "o.toml"], "wanted HOST:PORT, as localhost:30003, or file:PATH"),
        (["f.toml", "--adsb", "f.toml", "--receive", "h:1", "--out", "o.toml"], "--adsb: got no --from"),
    ],
)
def test_arguments_that_cannot_be_are_usage_errors(tmp_path, monkeypatch, capsys, arguments, complaint) -> None:
    monkeypatch.chdir(tmp_path)
    write_station(tmp_path, true_rig())
    text = (tmp_path / "field.toml").read_text() + "\n" + site_to_toml(SITE)
    (tmp_path / "f.toml").write_text(text)
    assert main(["calibrate", "sky", *arguments]) == 2
    assert complaint in capsys.readouterr().err
