"""No lock-out: after any gap the pixels of two cameras that agree are accepted at once, those of one soon."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.estimation.tentative_track import InitiatedTarget
from groundstation.messages import (
    CameraReport,
    DetectionStatus,
    Epoch,
    Event,
    Kinematics,
    PixelMeasurement,
    TrackEvent,
    TrackStatus,
)
from groundstation.rig.rig import Rig
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.stereo_rig import make_rig, make_station

RATE_HZ = 15.0
DURATION_S = 22.0
MIDDLE_M = np.array([0.0, 80.0, 15.0])


def multirotor(seed: int) -> np.ndarray:
    """Times, positions (n, 4) of an aircraft that turns at will: up to 4 m/s², seldom faster than 10 m/s."""
    generator = np.random.default_rng(seed)
    t = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    legs = generator.uniform([-7.0, -7.0, -1.0], [7.0, 7.0, 1.0], (round(DURATION_S / 2.5) + 1, 3))
    wanted = legs[np.minimum((t / 2.5).astype(int), len(legs) - 1)]
    p, v = MIDDLE_M.copy(), wanted[0].copy()
    rows = []
    for k in range(len(t)):
        # back towards the middle, or it leaves the cameras' sight
        pull = 0.15 * (MIDDLE_M - p)
        step = wanted[k] + pull - v
        v = v + step / max(1.0, float(np.linalg.norm(step)) * RATE_HZ / 4.0)
        p = p + v / RATE_HZ
        rows.append([t[k], *p])
    return np.array(rows)


def fixed_rig() -> Rig:
    """Two fixed wide-angle cameras 40 m apart that look along the field."""
    stations = []
    for name, x_m in (("left", -20.0), ("right", 20.0)):
        station = make_station(name, x_m, fixed=True)
        object.__setattr__(station.lens, "focal_px", np.array([900.0, 900.0]))
        stations.append(station)
    rig = make_rig(fixed=True)
    object.__setattr__(rig, "stations", tuple(stations))
    return rig


class Flown:
    """A flight whose cameras have gaps, given as (station, from, to) in s."""

    def __init__(self, seed: int, gaps: list[tuple[str, float, float]]) -> None:
        generator, rig = np.random.default_rng(seed + 1000), fixed_rig()
        self.path = multirotor(seed)
        self.pipeline = Pipeline(rig, Config())
        self.cameras: list[CameraReport] = []
        self.events: list[TrackEvent] = []
        self.seen: dict[str, list[float]] = {"left": [], "right": []}
        self.estimates = []
        for k, (t, *place) in enumerate(self.path):
            for station in rig.stations:
                if any(name == station.name and low <= t < high for name, low, high in gaps):
                    continue
                projection = station.geometry().project(np.array(place), 0.0, 0.0)
                if projection is None or not station.geometry().contains(projection.pixel):
                    continue
                u, v = projection.pixel + generator.normal(0.0, 1.0, 2)
                self.seen[station.name].append(float(t))
                self._step(PixelMeasurement(t_s=float(t), station=station.name, epoch=k, u_px=u, v_px=v))
            self._step(Epoch(t_s=float(t), epoch=k, stations=rig.names))
        self._take(self.pipeline.finish())

    def _step(self, event: Event) -> None:
        self._take(self.pipeline.step(event))

    def _take(self, report) -> None:
        self.cameras += report.cameras
        self.events += report.events
        self.estimates += report.estimates

    def refused(self) -> list[tuple[float, str]]:
        return [(c.t_s, c.station) for c in self.cameras if c.status is DetectionStatus.GATED]


gaps = st.lists(
    st.tuples(st.sampled_from(["left", "right"]), st.floats(6.0, 16.0), st.floats(0.5, 6.0)).map(
        lambda g: (g[0], g[1], g[1] + g[2])
    ),
    min_size=1,
    max_size=4,
)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), gaps)
def test_no_gap_locks_a_camera_out(seed: int, gaps: list[tuple[str, float, float]]) -> None:
    """Rejected pixels of a camera never follow each other for longer than half a second."""
    flown = Flown(seed, gaps)
    for name in ("left", "right"):
        began = newest = -1.0
        refused = {t for t, station in flown.refused() if station == name}
        for t in flown.seen[name]:
            if t not in refused:
                began = -1.0
                continue
            if began < 0 or t - newest > 0.5:
                began = t
            newest = t
            assert t - began <= 0.5, (name, t)


def test_the_target_is_restarted_where_two_cameras_agree() -> None:
    """A filter that is put 60 m away has the target back within three looks, with a warning that says where."""
    pipeline, rig, rows = Pipeline(fixed_rig(), Config()), fixed_rig(), multirotor(3)
    events: list[TrackEvent] = []
    estimates = []

    def feed(k: int) -> None:
        t, place = float(rows[k, 0]), rows[k, 1:]
        for station in rig.stations:
            projection = station.geometry().project(place, 0.0, 0.0)
            assert projection is not None
            u, v = projection.pixel
            report = pipeline.step(PixelMeasurement(t_s=t, station=station.name, epoch=k, u_px=u, v_px=v))
            events.extend(report.events)
        report = pipeline.step(Epoch(t_s=t, epoch=k, stations=rig.names))
        events.extend(report.events)
        estimates.extend(report.estimates)

    for k in range(120):
        feed(k)
    wrong = rows[120, 1:] + [40.0, 30.0, 30.0]
    assert pipeline._ekf.has_target
    pipeline._ekf.start_target(wrong, np.zeros(3), np.diag([0.01] * 3 + [0.1] * 3))
    pipeline._ekf._filter.note(provisional=None)
    for k in range(121, 135):
        feed(k)
    (text,) = [e.text for e in events if "not with the filter" in e.text]
    assert "target restarted there" in text
    last = estimates[-1]
    assert last.kinematics is not None
    true = rows[[round(last.t_s * RATE_HZ)], 1:][0]
    assert np.linalg.norm(last.kinematics.position_runway_m - true) < 2.0


@pytest.mark.parametrize("lasts_s", [0.3, 0.8])
def test_wrong_pixels_of_one_camera_do_not_turn_the_track(lasts_s: float) -> None:
    """The other camera is accepted all the time, and two saw the target just before: no restart where rays meet."""
    pipeline, rig, rows = Pipeline(fixed_rig(), Config()), fixed_rig(), multirotor(5)
    events: list[TrackEvent] = []
    off_m = []
    for k in range(180):
        t, place = float(rows[k, 0]), rows[k, 1:]
        for station in rig.stations:
            projection = station.geometry().project(place, 0.0, 0.0)
            assert projection is not None
            u, v = projection.pixel
            if station.name == "right" and 8.0 <= t < 8.0 + lasts_s:
                u += 60.0
            events += pipeline.step(PixelMeasurement(t_s=t, station=station.name, epoch=k, u_px=u, v_px=v)).events
        report = pipeline.step(Epoch(t_s=t, epoch=k, stations=rig.names))
        events += report.events
        for e in report.estimates:
            if e.kinematics is not None and e.t_s > 7.0:
                true = [np.interp(e.t_s, rows[:, 0], rows[:, i]) for i in (1, 2, 3)]
                off_m.append(float(np.linalg.norm(e.kinematics.position_runway_m - true)))
    assert not [e.text for e in events if "not with the filter" in e.text]
    assert len(off_m) > 50
    assert max(off_m) < 3.0


def test_coasting_on_one_camera_is_honest() -> None:
    """Ten gaps of six seconds: errors while one camera is alone are what the covariance says, within a factor of 2."""
    squares = []
    for flight in range(10):
        flown = Flown(100 + flight, [("right", 14.0, 20.0)])
        for e in flown.estimates:
            if e.kinematics is None or not 14.6 < e.t_s < 20.0:
                continue
            true = np.array([np.interp(e.t_s, flown.path[:, 0], flown.path[:, i]) for i in (1, 2, 3)])
            off = e.kinematics.position_runway_m - true
            squares.append(off @ np.linalg.solve(e.kinematics.covariance[:3, :3], off) / 3.0)
    assert len(squares) > 600
    # ten gaps are some twenty independent values: the mean of as many χ² of 3 degrees of freedom
    assert 0.5 < np.mean(squares) < 2.0, np.mean(squares)


def test_each_label_is_taken_next_to_a_doubtful_target() -> None:
    """Expected: three labels of one camera in an epoch of the other are three candidates; they cost no search."""
    flown = Flown(3, [("left", 20.0, 30.0), ("right", 20.0, 30.0)])
    manager, t = flown.pipeline._track_manager, float(flown.path[-1, 0])
    assert manager.needs_search(t)
    labels = [
        PixelMeasurement(t_s=t - 0.033 * n, station="right", epoch=999, u_px=600.0, v_px=400.0) for n in (2, 1, 0)
    ]
    assert all(manager.searches(label) for label in labels)


PATH_M, PATH_M_S = np.array([0.0, 200.0, 12.0]), np.array([0.0, -25.0, -1.0])


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("where it may be", True),
        ("seen by one camera lately", False),
        ("not recognised", False),
        ("far less likely", False),
        ("parked next to its path", False),
        ("30 m away", False),
        ("a given target that was never seen", False),
    ],
)
def test_only_what_may_be_the_missed_target_takes_its_place(case: str, expected: bool) -> None:
    """A landing at 25 m/s, recognised with log odds of 4, that two cameras last saw at 0 s, and a find at 1.6 s.

    What is found has not moved by five sigmas yet. Each other case differs from the first in one thing.
    """
    pipeline = Pipeline(fixed_rig(), Config())
    manager, covariance = pipeline._track_manager, np.diag([0.1] * 3 + [0.5] * 3)

    def target(position: np.ndarray, velocity: np.ndarray, odds: float, *, recognised: bool) -> InitiatedTarget:
        state = Kinematics(position_runway_m=position, velocity_runway_m_s=velocity, covariance=covariance)
        return InitiatedTarget(kinematics=state, moving=False, recognised=recognised, odds=odds, age_s=0.3)

    pipeline._ekf.predict_to(0.0)
    own = target(PATH_M, PATH_M_S, 4.0, recognised=True)
    if case == "a given target that was never seen":
        manager._start_track(0.0, own.kinematics, "given")
    else:
        manager._start_track(0.0, own.kinematics, "acquired", own)
        manager.state_machine.add_fix(0.0)
    pipeline._ekf.predict_to(1.6)
    if case == "seen by one camera lately":
        manager.state_machine.add_pixel(1.0)
    assert manager.state_machine.is_doubtful(1.6)
    found = target(
        PATH_M + 1.6 * PATH_M_S + [30.0 if case == "30 m away" else 1.0, 0.0, 0.0],
        np.zeros(3) if case == "parked next to its path" else PATH_M_S,
        2.9 if case == "far less likely" else 3.1,
        recognised=case != "not recognised",
    )
    assert manager._is_better(1.6, found) is expected


def test_what_crosses_on_the_ground_is_logged_once() -> None:
    """A thing found at a height of 1 m that moves across at 8 m/s: held, not reported, and one line says why."""
    pipeline = Pipeline(fixed_rig(), Config())
    manager, covariance = pipeline._track_manager, np.diag([0.04] * 3 + [0.01] * 3)
    crossing = Kinematics(
        position_runway_m=np.array([0.0, 80.0, 1.0]),
        velocity_runway_m_s=np.array([8.0, 1.0, 0.0]),
        covariance=covariance,
    )
    pipeline._ekf.predict_to(1.0)
    found = InitiatedTarget(kinematics=crossing, moving=True, recognised=False, odds=0.5, age_s=1.0)
    manager._start_track(1.0, crossing, "acquired", found)
    for k in range(1, 6):
        pipeline._ekf.predict_to(1.0 + 0.1 * k)
        pipeline._ekf.start_target(crossing.position_runway_m, crossing.velocity_runway_m_s, covariance)
        manager._update_status(1.0 + 0.1 * k, True, True)
    assert manager.state_machine.status is TrackStatus.ACQUIRING
    assert manager.state_at(1.6).kinematics is None
    assert [e.text for e in manager.changes.events if "crosses" in e.text] == [
        "what was found crosses on the ground, and is not recognised: not reported"
    ]
