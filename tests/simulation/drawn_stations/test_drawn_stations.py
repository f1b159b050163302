"""Drawn stations: within the limits, wrong by what they state, and usable from end to end."""

import math
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from groundstation.errors import ConfigError, ScenarioError
from groundstation.files.toml_table import TomlTable
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, parameter_indices
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.messages import DgpsFix, PixelMeasurement, PtuSample, TrackStatus
from groundstation.rig.rig import Station
from groundstation.session import load_dgps, load_session, load_truth
from groundstation.simulation.drawn_stations import (
    CalibrationSpec,
    ClockSpec,
    DgpsQuality,
    DgpsSpec,
    HeadSpec,
    StationCamera,
    StationSpec,
    StationsSpec,
    TimeSpan,
    build_stations,
    draw_stations,
)
from groundstation.simulation.event_faults import FaultKind, with_faults
from groundstation.simulation.session_folder import write_session_folder
from groundstation.simulation.simulate import SimulatedFlight, simulate
from groundstation.simulation.specification_table import read_specification, rounded, specification_table
from groundstation.sources.folder_source import FolderSource
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.complaints import complaint
from tests.simulation.drawn_stations.worlds import DURATION_S, LENS, built, flight, simulated, stations

DRAWS = 300
DEG = math.radians(1.0)
TWO = (StationSpec(name="left"), StationSpec(name="right"))


@cache
def drawn() -> list[StationsSpec]:
    return [stations(seed) for seed in range(DRAWS)]


def bounds(count: int) -> tuple[float, float]:
    """Return where a sum of squares of so many standard normal numbers is, but for one time in 10,000."""
    low, high = chi2.ppf([5e-5, 1.0 - 5e-5], count)
    return float(low), float(high)


def test_stations_stand_within_their_limits() -> None:
    counts = [len(spec.stations) for spec in drawn()]
    assert set(counts) == {2, 3, 4}
    far = 0
    for spec in drawn():
        left, right = (np.array(s.position_m) for s in spec.stations[:2])
        assert 5.0 <= np.linalg.norm((right - left)[:2]) <= 40.2
        far += any(s.position_m[1] > 200.0 for s in spec.stations)
        for station in spec.stations:
            assert 1.0 <= station.position_m[2] <= 6.0
            head = station.head
            assert 0.0 <= head.resolution_rad <= 0.0201 * DEG
            assert 10.0 <= head.rate_hz <= 100.0
            assert abs(station.camera_clock.offset_s) <= 0.05
            assert all(0.3 <= s.to_s - s.from_s <= 2.0 for s in head.stalls)
    assert 10 < far < 0.4 * DRAWS


def test_everything_that_varies_is_drawn() -> None:
    heads = [s.head for spec in drawn() for s in spec.stations]
    assert {h.resolution_rad > 0.0 for h in heads} == {True, False}
    assert 0.05 < np.mean([bool(h.stalls) for h in heads]) < 0.3
    assert 0.1 < np.mean([spec.stations[0].head.late_s > 0.0 for spec in drawn()]) < 0.3
    qualities = [None if spec.dgps is None else spec.dgps.quality for spec in drawn()]
    assert set(qualities) == {None, *DgpsQuality}
    assert any(spec.dgps.gaps for spec in drawn() if spec.dgps is not None)
    stated = [s.camera_clock.sigma_s < 0.0021 for spec in drawn() for s in spec.stations]
    assert 0.5 < np.mean(stated) < 0.9


@pytest.mark.parametrize(
    "part",
    ["mount", "boresight", "position", "focal", "aspect", "principal_point", "readout"],
)
def test_each_error_is_drawn_from_its_sigma(part: str) -> None:
    """Expected: over 300 worlds, the errors squared over their variances are χ²."""
    squares: list[float] = []
    for spec in drawn():
        for station in spec.stations:
            values = {f.name: getattr(station.calibration, f.name) for f in fields(CalibrationSpec)}
            sigma = next(np.array(v) for name, v in values.items() if name.startswith(f"{part}_sigma"))
            error = next(np.array(v) for name, v in values.items() if name.startswith(f"{part}_error"))
            squares += np.atleast_1d((error / sigma) ** 2).tolist()
    low, high = bounds(len(squares))
    assert low < sum(squares) < high


def test_clock_errors_are_drawn_from_their_sigmas() -> None:
    clocks = [c for spec in drawn() for s in spec.stations for c in (s.ptu_clock, s.camera_clock)]
    low, high = bounds(len(clocks))
    assert low < sum((c.error_s / c.sigma_s) ** 2 for c in clocks) < high
    assert low < sum((c.drift_error_ppm / c.drift_sigma_ppm) ** 2 for c in clocks) < high


def difference(true: Station, stated: Station) -> np.ndarray:
    """Return by how much the truth differs from what is stated, (21,), by geometry alone."""

    def turned(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return Rotation.from_matrix(matrix_from_wxyz(one) @ matrix_from_wxyz(other).T).as_rotvec()

    return np.concatenate(
        [
            turned(true.runway_from_base_wxyz, stated.runway_from_base_wxyz),
            true.ptu_position_m - stated.ptu_position_m,
            turned(true.head_from_camera_wxyz, stated.head_from_camera_wxyz),
            true.camera_in_head_m - stated.camera_in_head_m,
            true.lens.focal_px - stated.lens.focal_px,
            true.lens.principal_point_px - stated.lens.principal_point_px,
            true.lens.distortion - stated.lens.distortion,
        ]
    )


def test_the_two_rigs_differ_by_what_the_file_states() -> None:
    """Expected: the squared Mahalanobis distance of true from stated station, by the file's matrix, is χ²."""
    squares, count = 0.0, 0
    exact = [k for k, name in enumerate(CALIBRATION_PARAMETERS) if name.startswith(("camera_in_head", "distortion"))]
    for spec in drawn():
        # a head with a constant aim takes no time to build
        steady = tuple(replace(s, head=HeadSpec()) for s in spec.stations)
        made = built(replace(spec, stations=steady), readout_s=0.01)
        for true, stated in zip(made.true_rig.stations, made.rig.stations, strict=True):
            off = difference(true, stated)
            assert off[exact] == pytest.approx(0.0, abs=1e-12)
            places = parameter_indices(stated.covariance_parameters)
            assert len(places) == 13
            squares += float(off[places] @ np.linalg.solve(stated.covariance, off[places]))
            squares += ((true.readout_s - stated.readout_s) / stated.readout_sigma_s) ** 2
            count += len(places) + 1
    low, high = bounds(count)
    assert low < squares < high


def test_what_the_rig_states_of_clocks_and_encoders() -> None:
    clock = ClockSpec(offset_s=0.03, error_s=-0.002, sigma_s=0.003, drift_error_ppm=40.0, drift_sigma_ppm=200.0)
    head = HeadSpec(encoder_sigma_rad=0.003 * DEG, backlash_rad=0.008 * DEG)
    spec = StationsSpec(stations=tuple(replace(s, camera_clock=clock, ptu_clock=clock, head=head) for s in TWO))
    made = built(spec)
    true, stated = made.true_rig["left"], made.rig["left"]
    for mine, given in ((true.camera_clock, stated.camera_clock), (true.ptu_clock, stated.ptu_clock)):
        assert mine is not None
        assert given is not None
        assert mine.offset_s == pytest.approx(0.028)
        assert mine.drift_ppm == pytest.approx(40.0)
        assert (given.offset_s, given.drift_ppm) == (0.03, 0.0)
        # 200 ppm are 4 ms after 20 s
        assert given.sigma_s == pytest.approx(0.005)
    assert true.ptu_sigma_rad == pytest.approx(0.003 * DEG)
    assert stated.ptu_sigma_rad == pytest.approx(0.005 * DEG)
    assert stated.covariance_parameters == ()


def test_the_same_seed_gives_the_same_stations() -> None:
    assert stations(3) == stations(3)
    assert stations(3) != stations(4)
    one, two, other = (simulate(built(stations(3), seed).scenario(flight(3), seed=5)) for seed in (1, 1, 2))
    angles = [f.truth.stations["left"].angles_rad for f in (one, two, other)]
    assert np.array_equal(angles[0], angles[1])
    assert not np.array_equal(angles[0], angles[2])


def test_stations_survive_their_file() -> None:
    for spec in drawn()[:20]:
        short = rounded(spec)
        assert read_specification(StationsSpec, TomlTable(specification_table(short), "w", ConfigError)) == short


def test_the_target_is_mostly_in_the_picture_but_not_always() -> None:
    seen, pairs = [], []
    for seed in range(14):
        truth = simulated(seed).truth
        visible = np.array([s.visible for s in truth.stations.values()])
        seen.append(visible.mean())
        pairs.append(np.mean(visible.sum(axis=0) >= 2))
    assert 0.9 < np.mean(seen) < 0.999
    assert min(seen) < 0.97
    assert min(pairs) > 0.5


def following(head: HeadSpec) -> SimulatedFlight:
    spec = StationsSpec(stations=tuple(replace(s, head=head, position_m=(10.0, 0.0, 1.5)) for s in TWO))
    return simulate(built(spec).scenario(flight(2)))


def test_a_late_head_waits_and_then_finds_its_target() -> None:
    truth = following(HeadSpec(late_s=2.0, late_pan_share=1.5)).truth
    visible = truth.stations["left"].visible
    assert not visible[truth.t_s < 1.9].any()
    assert visible[truth.t_s > 3.0].all()
    assert np.ptp(truth.stations["left"].angles_rad[truth.t_s < 1.9]) > 0.0
    assert np.ptp(truth.stations["left"].angles_rad[truth.t_s < 1.9], axis=0) == pytest.approx(0.0, abs=1e-9)


def test_a_stalled_head_stands_and_then_follows_again() -> None:
    stalled, free = (following(HeadSpec(stalls=s)).truth for s in ((TimeSpan(from_s=8.0, to_s=9.5),), ()))
    t, turned = stalled.t_s, stalled.stations["left"].rates_rad_s
    still = (t > 8.8) & (t < 9.5)
    assert np.abs(turned[still]).max() < 1e-3
    apart = np.abs(stalled.stations["left"].angles_rad - free.stations["left"].angles_rad).max(axis=1)
    assert apart[t < 8.0].max() == 0.0
    assert apart[still].max() > 10.0 * apart[t > 12.0].max()


def test_the_aim_wanders_as_far_as_it_was_asked_to() -> None:
    head = HeadSpec(aim_sigma_share=0.2, aim_correlation_s=0.5, natural_rad_s=40.0, max_acceleration_rad_s2=100.0)
    spec = StationsSpec(stations=tuple(replace(s, head=head, position_m=(10.0, 0.0, 1.5)) for s in TWO))
    calm = following(replace(head, aim_sigma_share=0.0)).truth.stations["left"].angles_rad
    off = [
        simulate(built(spec, seed).scenario(flight(2))).truth.stations["left"].angles_rad - calm for seed in range(6)
    ]
    half_rad = 480.0 / LENS.focal_px[1]
    assert np.std(off) == pytest.approx(0.2 * half_rad, rel=0.2)


def test_gaps_of_the_receiver_are_faults() -> None:
    dgps = DgpsSpec(clock_offset_s=0.3, gaps=(TimeSpan(from_s=5.0, to_s=7.0),))
    made = built(StationsSpec(stations=TWO, dgps=dgps))
    assert [f.kind for f in made.faults] == [FaultKind.DGPS_GAP]
    whole = simulate(made.scenario(flight(1)))
    times = np.array([f.t_s - 0.3 for f in with_faults(whole, made.faults).dgps])
    assert not np.any((times > 5.0) & (times < 6.99))
    assert len(whole.dgps) - times.size == pytest.approx(20, abs=1)


def readings(flown: SimulatedFlight) -> int:
    return sum(isinstance(e, PtuSample | PixelMeasurement) for e in flown.events)


@pytest.mark.parametrize("seed", [3, 6, 11])
def test_a_drawn_scenario_is_read_back(seed: int, tmp_path: Path) -> None:
    flown = simulated(seed, readout_s=0.008)
    write_session_folder(tmp_path / "s", flown, name="drawn")
    session = load_session(tmp_path / "s")
    for stated, read in zip(flown.rig.stations, session.rig.stations, strict=True):
        assert read.covariance == pytest.approx(stated.covariance, rel=1e-12)
        assert (read.camera_clock, read.ptu_clock) == (stated.camera_clock, stated.ptu_clock)
        assert read.readout_sigma_s == stated.readout_sigma_s
        assert read.ptu_sigma_rad == pytest.approx(stated.ptu_sigma_rad)
    truth, fixes = load_truth(session), load_dgps(session) if flown.dgps else ()
    assert truth is not None
    assert truth.position_runway_m == pytest.approx(flown.truth.position_runway_m, abs=1e-5)
    assert len(fixes) == len(flown.dgps)
    assert all(isinstance(f, DgpsFix) for f in fixes)
    with FolderSource(session) as source:
        # without what was before the first frame's second and after the last one's
        assert sum(isinstance(e, PtuSample | PixelMeasurement) for e in source) == readings(flown)


def test_the_filter_is_consistent_on_drawn_worlds() -> None:
    """Expected: pixels of 0.5 px and all errors as stated give a mean NEES of 3, within a factor, as the median world.

    The errors of one flight have the calibration in common, so that single worlds scatter widely.
    """
    config = Config()
    tuned = replace(config, estimation=replace(config.estimation, labelled_sigma_px=0.5))
    means = []
    for seed in range(5):
        flown = simulated(seed, count=2)
        pipeline = Pipeline(flown.rig, tuned)
        reports = [*(pipeline.step(event) for event in flown.events), pipeline.finish()]
        estimates = [e for report in reports for e in report.estimates if e.status is TrackStatus.TRACKING]
        nees = []
        for estimate in estimates:
            assert estimate.kinematics is not None
            truth = flown.scenario.trajectory.position(np.array([estimate.t_s]))[0]
            error = estimate.kinematics.position_runway_m - truth
            nees.append(error @ np.linalg.solve(estimate.kinematics.covariance[:3, :3], error) / 3.0)
        assert len(nees) > 100
        means.append(np.mean(nees))
    assert 0.5 < np.median(means) < 2.0
    assert max(means) < 8.0


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: StationsSpec(stations=TWO[:1]), "stations: got 1; wanted 2 to 4 stations"),
        (lambda: StationsSpec(stations=(TWO[0], TWO[0])), "got left, left; wanted names that differ"),
        (lambda: StationSpec(name="a/b"), "name: got 'a/b'"),
        (lambda: StationSpec(name="a", position_m=(0.0, math.inf, 1.0)), "wanted 3 numbers, each from -5000 to 5000"),
        (lambda: StationSpec(name="a", position_m=(0.0, 1.0)), "wanted 3 numbers"),  # type: ignore[arg-type]
        (lambda: HeadSpec(rate_hz=0.0), "HeadSpec: rate_hz: got 0.0; wanted a number from 1 to 1000"),
        (lambda: CalibrationSpec(focal_sigma_share=-0.1), "focal_sigma_share: got -0.1"),
        (lambda: ClockSpec(sigma_s=math.nan), "ClockSpec: sigma_s: got nan"),
        (lambda: DgpsSpec(rate_hz=0.0), "DgpsSpec: rate_hz: got 0.0"),
        (lambda: TimeSpan(from_s=2.0, to_s=2.0), "TimeSpan: got 2 to 2 s; wanted an end after the start"),
        (lambda: draw_stations(np.random.default_rng(0), duration_s=0.0), "duration_s: got 0.0"),
        (
            lambda: build_stations(
                StationsSpec(stations=TWO), [StationCamera(lens=LENS)], duration_s=DURATION_S, seed=0
            ),
            "cameras: got 1; wanted 2, one for each station",
        ),
    ],
)
def test_what_cannot_be_is_refused(make: Callable[[], object], said: str) -> None:
    assert said in complaint(ScenarioError, make)
