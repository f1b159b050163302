"""The rig's clocks and axes in operation: the same angles at the same times as a replay of its readings has."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.errors import RigError
from groundstation.files.text_file import AttachedFiles
from groundstation.geometry.aim import aim_at
from groundstation.live.core import LiveCore, live_config
from groundstation.live.devices import check_against_rig, drift_notes, of_one_host
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.record import live_header
from groundstation.live.station_file import load_station
from groundstation.messages import Epoch, Event, PixelMeasurement, PtuSample
from groundstation.pointing.head_limits import AxisLimits, HeadLimits
from groundstation.pointing.keep_out import KeepOut, LensAxis, SunZone
from groundstation.pointing.pointing_law import HeadController, PointingConfig
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from groundstation.pointing.sun import SunOverPlace
from groundstation.rig.ptu_axes import AxisCorrection, PtuAxes
from groundstation.rig.rig import ClockModel, Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.live.test_station_file import WHOLE, written
from tests.stereo_rig import make_rig

DEG = math.radians(1.0)
AXES = PtuAxes(
    pan_zero_rad=0.5 * DEG,
    tilt_zero_rad=-0.3 * DEG,
    pan_scale=5e-3,
    tilt_scale=-2e-3,
    pan_backlash_rad=0.04 * DEG,
    pan_sine_rad=0.02 * DEG,
    pan_cosine_rad=-0.01 * DEG,
    tilt_sag_rad=0.05 * DEG,
)
LAG = ClockModel(offset_s=-0.037)
LIMITS = AxisLimits(low_rad=-170 * DEG, high_rad=170 * DEG, fastest_rad_s=50 * DEG, acceleration_rad_s2=200 * DEG)
HEAD = HeadLimits(pan=LIMITS, tilt=LIMITS)


def deviating_rig() -> Rig:
    rig = make_rig()
    left = replace(rig["left"], ptu_axes=AXES, ptu_clock=LAG)
    return replace(rig, stations=(left, *rig.stations[1:]))


def core_of(rig: Rig) -> LiveCore:
    geometries = {s.name: s.geometry() for s in rig.stations}
    heads = {s.name: HeadController(s.geometry(), HEAD, PointingConfig(), axes=s.ptu_axes) for s in rig.stations}
    pattern = SearchPattern(geometries, SearchConfig())
    return LiveCore(Pipeline(rig, Config()), FramePairer(rig.names, 1.0 / 30.0), heads, pattern, rig)


def test_readings_reach_the_filter_as_angles_at_the_time_of_the_motion() -> None:
    """Expected: what `AxisCorrection` makes of the same readings in order, earlier by the lag; right is unchanged."""
    core, correction = core_of(deviating_rig()), AxisCorrection(AXES)
    random = np.random.default_rng(4)
    for k in range(60):
        t_s = 0.02 * k
        pan, tilt = 10 * DEG * math.sin(2.0 * t_s) + random.normal(0.0, 1e-4), 5 * DEG * math.cos(3.0 * t_s)
        for name in ("left", "right"):
            reading = PtuSample(t_s=t_s, station=name, pan_rad=pan, tilt_rad=tilt)
            (found,) = (e for e in core.take(reading, t_s).consumed if isinstance(e, PtuSample))
            if name == "right":
                assert found == reading
                continue
            assert found.t_s == pytest.approx(t_s - 0.037)
            assert (found.pan_rad, found.tilt_rad) == correction.angles(pan, tilt)


@pytest.mark.parametrize("lags_s", [(0.0, 0.0), (-0.06, -0.02), (-0.2, -0.05)])
def test_frames_are_paired_as_they_come_and_used_at_their_exposures(lags_s: tuple[float, float]) -> None:
    """Expected: as many pairs of two whatever the lags; stamps earlier by them, and a pair's by their mean."""
    rig = make_rig()
    cameras = [replace(s, camera_clock=ClockModel(offset_s=lag)) for s, lag in zip(rig.stations, lags_s, strict=True)]
    core, found = core_of(replace(rig, stations=tuple(cameras))), list[Event]()
    for k in range(12):
        for name in rig.names:
            t_s = 1.0 + k / 30.0
            item = PixelMeasurement(t_s=t_s, station=name, epoch=0, u_px=600.0, v_px=400.0)
            found += core.take(item, t_s).consumed
    found += core.finish().consumed
    pairs = [event for event in found if isinstance(event, Epoch)]
    assert [pair.stations for pair in pairs] == [rig.names] * 12
    for k, pair in enumerate(pairs):
        assert pair.t_s == pytest.approx(1.0 + k / 30.0 + sum(lags_s) / 2.0, abs=0.0 if lags_s == (0.0, 0.0) else 1e-12)
    frames = [event for event in found if isinstance(event, PixelMeasurement)]
    assert [f.t_s for f in frames[:2]] == pytest.approx([1.0 + lag for lag in lags_s])
    waits_s = live_config(Config(), 30.0, replace(rig, stations=tuple(cameras))).synchronise.hold_s
    assert waits_s == pytest.approx(Config().synchronise.hold_s + max(0.0, *lags_s, 0.0) - min(lags_s))


@pytest.mark.parametrize(
    ("zero_deg", "low_deg", "high_deg"), [(-180, 0, 360), (180, -360, 0), (180, -270, 270), (90, -170, 170)]
)
def test_a_zero_of_a_unit_may_be_anywhere(zero_deg: float, low_deg: float, high_deg: float) -> None:
    """Expected: targets either side of straight ahead, each with its axis on it, without a turn round the back."""
    axes = PtuAxes(pan_zero_rad=zero_deg * DEG)
    limits = replace(LIMITS, low_rad=low_deg * DEG, high_rad=high_deg * DEG)
    geometry = make_rig()["left"].geometry()
    controller = HeadController(geometry, HeadLimits(pan=limits, tilt=LIMITS), PointingConfig(latency_s=0.0), axes=axes)
    begin = aim_at(geometry, np.array([0.0, 300.0, 20.0]))
    assert begin is not None
    reading = np.array([controller._pan.nearest_turn(begin.pan_rad - zero_deg * DEG), begin.tilt_rad])
    most = 0.0
    for k in range(400):
        t_s = 0.02 * k
        point = np.array([60.0 * math.sin(0.8 * t_s), 300.0, 20.0])
        controller.read(PtuSample(t_s=t_s, station="left", pan_rad=reading[0], tilt_rad=reading[1]))
        command = controller.follow(t_s, lambda _, point=point: point)
        reading = reading + 0.02 * np.array([command.pan_rate_rad_s, command.tilt_rate_rad_s])
        aim = aim_at(geometry, point)
        assert aim is not None
        off = (reading[0] + zero_deg * DEG - aim.pan_rad + math.pi) % math.tau - math.pi
        most = max(most, abs(off)) if t_s > 2.0 else most
    assert most < 5.0 * DEG


def test_a_head_is_parked_at_readings() -> None:
    core = core_of(deviating_rig())
    core.park({"left": (0.2, 0.1)})
    core.take(PtuSample(t_s=1.0, station="left", pan_rad=0.2, tilt_rad=0.1), 1.0)
    assert core.not_parked(1.0, 1e-6) == []


def test_a_head_meets_its_target_by_its_true_axis() -> None:
    """Expected: the angle error of a standing target falls below half the backlash, though readings are 0.5° off."""
    station = deviating_rig()["left"]
    controller = HeadController(station.geometry(), HEAD, PointingConfig(latency_s=0.0), axes=AXES)
    point = np.array([3.0, 300.0, 20.0])
    aim = aim_at(station.geometry(), point)
    assert aim is not None
    reading, correction = np.array([0.0, 0.0]), AxisCorrection(AXES)
    for k in range(400):
        t_s = 0.02 * k
        controller.read(PtuSample(t_s=t_s, station="left", pan_rad=reading[0], tilt_rad=reading[1]))
        command = controller.follow(t_s, lambda _: point)
        reading = reading + 0.02 * np.array([command.pan_rate_rad_s, command.tilt_rate_rad_s])
        angles = correction.angles(float(reading[0]), float(reading[1]))
    assert abs(angles[0] - aim.pan_rad) < 0.5 * AXES.pan_backlash_rad + 1e-5
    assert abs(angles[1] - aim.tilt_rad) < 1e-5
    assert abs(reading[0] - aim.pan_rad) > 0.4 * DEG


READINGS = st.tuples(st.floats(-3.0, 3.0), st.floats(-1.4, 1.4))
SUN = SunOverPlace(lat_deg=50.0, lon_deg=8.0, height_m=100.0, y_axis_azimuth_deg=90.0)


def noon(lens: LensAxis) -> KeepOut:
    """Return a cone about the Sun of 2026-06-21, 12:00 UTC."""
    return KeepOut(lens=lens, sun=SunZone(sun=SUN, angle_rad=10 * DEG), sectors=(), utc_zero_s=1_782_043_200.0)


@given(READINGS)
def test_the_sun_is_kept_off_by_the_true_axis(reading: tuple[float, float]) -> None:
    """Expected: the Sun's distance from an ideal head at the angles; the clearance is less by the backlash."""
    geometry = make_rig()["left"].geometry()
    zones = noon(LensAxis.of(geometry, AXES)).zones(0.0)
    ideal = noon(LensAxis.of(geometry)).zones(0.0)
    assert not zones.is_empty
    angles = AXES.angles(*reading, 0.0, 0.0)
    direction = zones.sun_runway
    assert direction is not None
    off = zones.keep_out.lens.angle_at(direction, *reading)
    assert off == pytest.approx(ideal.keep_out.lens.angle_at(direction, *angles), abs=1e-9)
    wanted = (ideal.at(angles) - 0.5 * AXES.pan_backlash_rad) / AXES.most_turn
    assert zones.at(reading) == pytest.approx(wanted, abs=1e-9)
    assert float(zones.clearance(*np.array(reading))) == pytest.approx(wanted, abs=1e-9)


@settings(max_examples=60)
@given(READINGS, READINGS)
def test_no_reading_changes_a_clearance_by_more_than_it_changes(
    one: tuple[float, float], other: tuple[float, float]
) -> None:
    """Expected: the bound that boxes of readings are searched by, also where axes turn 10 % farther than they read."""
    steep = replace(AXES, pan_scale=0.1, tilt_scale=0.1)
    zones = noon(LensAxis.of(make_rig()["left"].geometry(), steep)).zones(0.0)
    way = np.linspace(one, other, 20)
    values = zones.clearance(way[:, 0], way[:, 1])
    for (a, b), (here, there) in zip(pairwise(way), pairwise(values), strict=True):
        assert abs(there - here) <= float(np.abs(b - a).sum()) + 1e-9


@pytest.mark.parametrize(
    ("clocks", "words"),
    [
        ({"ptu_clock": ClockModel(drift_ppm=300.0)}, "left: ptu_clock: got drift_ppm = 300; wanted at most 100: in op"),
        ({"ptu_clock": ClockModel(offset_s=-0.35)}, "left: ptu_clock: got offset_s = -0.35; wanted at most 0.3 s"),
        (
            {"camera_clock": ClockModel(offset_s=-12.5)},
            "left: camera_clock: got offset_s = -12.5; wanted at most 0.4 s",
        ),
    ],
)
def test_clocks_of_another_recorder_are_refused(tmp_path: Path, clocks: dict[str, ClockModel], words: str) -> None:
    file = load_station(written(tmp_path, WHOLE))
    rig = make_rig()
    check_against_rig(file, replace(rig, stations=(replace(rig["left"], ptu_clock=LAG), *rig.stations[1:])))
    with pytest.raises(RigError, match=words.replace("(", r"\(")):
        check_against_rig(file, replace(rig, stations=(replace(rig["left"], **clocks), *rig.stations[1:])))


def test_a_drift_that_a_calibration_found_is_left_out(tmp_path: Path) -> None:
    """Expected: of the same host's stamps; the recording has the rig that was used, and a line names what it lacks."""
    rig = make_rig()
    drifting = replace(rig["left"], ptu_clock=replace(LAG, drift_ppm=3.0, sigma_s=0.002), camera_clock=LAG)
    one = replace(rig, stations=(drifting, *rig.stations[1:]), path="rig.toml")
    found = of_one_host(one)
    assert found["left"].ptu_clock == replace(LAG, sigma_s=0.002)
    assert found["left"].camera_clock == LAG
    (line,) = drift_notes(one)
    assert line == (
        "rig.toml: station left: ptu_clock: drift_ppm = 3 is left out: stamps in operation are of this host's clock"
    )
    assert of_one_host(rig) is rig
    file = load_station(written(tmp_path, WHOLE))
    file.rig.write_text(rig_to_toml(one))
    header = live_header(file, Config())
    assert load_rig(AttachedFiles("test", header.files) / "rig.toml")["left"].ptu_clock == replace(LAG, sigma_s=0.002)
    recorded, used = load_rig(AttachedFiles("test", header.files) / "rig.toml"), of_one_host(load_rig(file.rig))
    for station in recorded.stations:
        np.testing.assert_array_equal(station.geometry().packed, used[station.name].geometry().packed)
    file.rig.write_text(rig_to_toml(rig))
    assert live_header(file, Config()).files["rig.toml"] == file.rig.read_bytes()


def test_a_simulated_station_has_a_rig_of_its_devices(tmp_path: Path) -> None:
    """Expected: what the simulated devices do not do is not corrected; geometry, lean and sigmas stay."""
    leaning = replace(AXES, lean_rad=0.2 * DEG)
    rig = make_rig()
    left = replace(rig["left"], ptu_axes=leaning, ptu_clock=replace(LAG, sigma_s=0.002), camera_clock=LAG)
    file = simulated_station_file(tmp_path, 10.0, replace(rig, stations=(left, *rig.stations[1:])))
    found = load_rig(file.rig)["left"]
    assert found.ptu_axes.is_ideal_apart_from_lean
    assert found.ptu_axes.lean_rad == pytest.approx(0.2 * DEG)
    assert found.ptu_clock == ClockModel(sigma_s=0.002)
    assert found.camera_clock == ClockModel()
    np.testing.assert_allclose(found.ptu_position_m, left.ptu_position_m)
