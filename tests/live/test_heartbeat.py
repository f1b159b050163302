"""A station whose cameras or source die: the operator's display, and that a replay of it is the same."""

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from groundstation.live.core import HEARTBEAT_EVERY_S, LiveCore, LiveStep, live_config
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.head_manager import HeadManager
from groundstation.live.input_queue import DeviceLogLine
from groundstation.live.operation import Operation, OperationOutputs
from groundstation.live.status_board import LiveStatus
from groundstation.messages import Heartbeat, Kinematics, PtuSample, Purpose, StepReport, TrackState, TrackStatus
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from groundstation.rig.rig import load_rig
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.closed_loop import ClosedLoopFault, ClosedLoopFaultKind, ClosedLoopSimulation
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.live.test_filter_reset import flown_and_replayed
from tests.stereo_rig import make_rig, with_angle_noise

STATIONS = ("left", "right")
LOSS_S = 2.5


def dead(*kinds: ClosedLoopFaultKind, to_s: float) -> list[ClosedLoopFault]:
    return [ClosedLoopFault(kind=kind, station=name, from_s=LOSS_S, to_s=to_s) for kind in kinds for name in STATIONS]


class PollStatistics(ClosedLoopSimulation):
    """A rehearsal that records the operator's display and the heads' commands at each turn."""

    def __init__(self, faults: list[ClosedLoopFault], seconds: float) -> None:
        flight = GlideApproach(start_y_m=360.0, end_y_m=360.0 - 20.0 * seconds, speed_m_s=20.0, aim_y_m=60.0)
        super().__init__(with_angle_noise(make_rig(), np.radians(0.01)), Config(), flight, faults=faults, seed=1)
        self.read: list[tuple[float, TrackStatus]] = []
        self.commanded: list[tuple[float, Purpose]] = []

    def _tick(self, now_s: float) -> None:
        super()._tick(now_s)
        self.read.append((now_s, self._core.status))

    def _done(self, taken: LiveStep) -> None:
        super()._done(taken)
        self.commanded += [(c.t_s, c.purpose) for c in taken.commands]

    def statuses(self, from_s: float, to_s: float) -> list[TrackStatus]:
        return list(dict.fromkeys(status for t_s, status in self.read if from_s <= t_s < to_s))


def test_both_cameras_lost_for_ten_seconds() -> None:
    """Expected: as was measured at an airstrip's rehearsal ("tracking at 442 ± 1.3 m" all the while) no more: coasting
    within half a second, a covariance that grows and holds the truth, lost within eight seconds and without a place."""
    flown = PollStatistics(dead(ClosedLoopFaultKind.CAMERA_LOST, to_s=LOSS_S + 10.0), 14.5)
    result = flown.run()
    assert flown.statuses(1.5, LOSS_S) == [TrackStatus.TRACKING]
    assert flown.statuses(LOSS_S + 0.5, LOSS_S + 10.0) == [TrackStatus.COASTING, TrackStatus.LOST]
    states = [s for s in result.states if LOSS_S + 0.5 <= s.t_s < LOSS_S + 10.0]
    coasting = [s for s in states if s.kinematics is not None]
    assert {s.status for s in coasting} == {TrackStatus.COASTING}
    lost = [s for s in states if s.kinematics is None]
    assert {s.status for s in lost} == {TrackStatus.LOST}
    assert lost[0].t_s <= LOSS_S + 8.2
    assert np.diff([s.t_s for s in states]).max() < 2.0 * HEARTBEAT_EVERY_S
    traces = [float(np.trace(s.kinematics.covariance[:3, :3])) for s in coasting if s.kinematics is not None]
    assert np.all(np.diff(traces) > 0.0)
    for state in coasting:
        assert state.kinematics is not None
        error = state.kinematics.position_runway_m - flown._position(state.t_s)
        square = float(error @ np.linalg.solve(state.kinematics.covariance[:3, :3], error))
        assert square < 3.0 * 9.0
    # nothing of it is a pair
    assert not [e for e in result.estimates if LOSS_S + 0.1 < e.t_s < LOSS_S + 10.0]
    # once lost, the heads point at the predicted position
    searching = [p for t_s, p in flown.commanded if lost[0].t_s + 0.1 < t_s < LOSS_S + 9.9]
    assert Purpose.SEARCH in searching
    assert Purpose.TRACK not in searching


def test_the_source_killed_to_the_end() -> None:
    """Expected: with neither pictures nor angles it is lost sooner, and stays so; the heads get no new command."""
    flown = PollStatistics(dead(ClosedLoopFaultKind.CAMERA_LOST, ClosedLoopFaultKind.PTU_SILENT, to_s=math.inf), 9.0)
    result = flown.run()
    assert flown.statuses(LOSS_S + 0.5, 9.0) == [TrackStatus.COASTING, TrackStatus.LOST]
    lost_s = next(t_s for t_s, status in flown.read if status is TrackStatus.LOST)
    assert LOSS_S + 0.5 < lost_s < LOSS_S + 5.0
    assert all(s.kinematics is None for s in result.states if s.t_s >= lost_s)
    # a head without a reading for so long is halted
    assert {p for t_s, p in flown.commanded if t_s > lost_s + 0.1} <= {Purpose.SEARCH, Purpose.HOLD}


def test_it_tracks_again_when_they_are_back() -> None:
    flown = PollStatistics(dead(ClosedLoopFaultKind.CAMERA_LOST, to_s=LOSS_S + 1.5), 6.5)
    result = flown.run()
    assert flown.statuses(LOSS_S + 0.5, LOSS_S + 1.5) == [TrackStatus.COASTING]
    assert result.share(TrackStatus.TRACKING, LOSS_S + 2.5, 6.5) > 0.95


def test_a_replay_of_it_is_the_same_bit_for_bit(tmp_path: Path) -> None:
    """Expected: the pairs' track and the answers to the heartbeats, with both cameras lost midway."""
    faults = [ClosedLoopFault(kind=ClosedLoopFaultKind.CAMERA_LOST, station=n, from_s=1.5, to_s=2.6) for n in STATIONS]
    flown, result, folder = flown_and_replayed(tmp_path, lambda r: setattr(r, "_faults", faults))
    assert TrackStatus.COASTING in {s.status for s in flown.result.states if 1.5 < s.t_s < 2.6}
    assert result.fault is None
    assert result.output_comparison is not None
    compared = result.output_comparison
    assert (compared.differing, compared.states_differing, compared.alone) == (0, 0, 0)
    assert result.output_comparison.states == len(flown.result.states) >= 11
    assert "bit for bit" in result.output_comparison.line()
    for name in ("track.csv", "triangulation.csv"):
        assert (folder / "again" / name).read_bytes() == (folder / "live" / name).read_bytes()
    rows = (folder / "live" / "track.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert len(rows) == len(flown.result.estimates), "one row for each pair, none for a heartbeat"


# ------------------------------------------------------------------------------------ when there is one
def fresh() -> LiveCore:
    rig = make_rig()
    geometries = {s.name: s.geometry() for s in rig.stations}
    pipeline = Pipeline(rig, live_config(Config(), 30.0))
    return LiveCore(pipeline, FramePairer(rig.names, 1.0 / 30.0), {}, SearchPattern(geometries, SearchConfig()))


def beats(taken: LiveStep) -> list[float]:
    return [e.t_s for e in taken.consumed if isinstance(e, Heartbeat)]


def test_one_every_tenth_of_a_second_without_a_pair() -> None:
    core = fresh()
    assert beats(core.pass_time(5.0)) == [5.0]
    assert beats(core.pass_time(5.099)) == []
    taken = core.pass_time(5.101)
    assert beats(taken) == [5.101]
    assert [s.t_s for r in taken.reports for s in r.states] == [5.101]
    reading = PtuSample(t_s=5.19, station="left", pan_rad=0.0, tilt_rad=0.0)
    assert beats(core.take(reading, 5.2)) == []
    assert beats(core.take(reading, 5.3)) == [5.3]
    assert beats(core.take(DeviceLogLine(t_s=5.4, level="info", text="parking"), 5.41)) == [5.41]


def test_with_more_waiting_it_is_no_later_than_the_processed_records() -> None:
    """Expected: after a stall of the computer waiting data are processed at their time, before the track is lost."""
    core = fresh()
    core.pass_time(5.0)
    reading = PtuSample(t_s=5.05, station="left", pan_rad=0.0, tilt_rad=0.0)
    assert beats(core.take(reading, 14.0, known_s=5.05)) == []
    assert beats(core.take(reading, 14.0, known_s=5.12)) == [5.12]
    assert beats(core.pass_time(14.0, known_s=-1e9)) == []
    assert beats(core.pass_time(14.0, known_s=20.0)) == [14.0]


@pytest.mark.parametrize(("rate_hz", "coast_after_s"), [(30.0, 0.25), (10.01, 0.25), (5.0, 0.5), (1.0, 2.5)])
def test_slow_cameras_do_not_coast_from_pair_to_pair(rate_hz: float, coast_after_s: float) -> None:
    assert live_config(Config(), rate_hz).estimation.coast_after_s == pytest.approx(coast_after_s)
    assert live_config(live_config(Config(), rate_hz), 30.0).estimation.coast_after_s == pytest.approx(coast_after_s)


# ------------------------------------------------------------------------------------ the display
class Canned(LiveCore):
    """A core whose status is set, and whose time passes with a heartbeat's answer or without."""

    def __init__(self) -> None:
        self.status, self.beating, self.known = TrackStatus.TRACKING, True, list[float | None]()
        self.refused = Counter()

    def pass_time(self, now_s: float, known_s: float | None = None) -> LiveStep:
        self.known.append(known_s)
        if not self.beating:
            return LiveStep()
        place = Kinematics(
            position_runway_m=np.array([0.0, 442.0, 9.0]), velocity_runway_m_s=np.zeros(3), covariance=np.eye(6)
        )
        here = None if self.status is TrackStatus.LOST else place
        state = TrackState(t_s=now_s, status=self.status, kinematics=here)
        return LiveStep(reports=[StepReport(states=(state,))])

    def take(self, item: object, now_s: float, known_s: float | None = None) -> LiveStep:  # type: ignore[override]
        return self.pass_time(now_s, known_s)


class Operator:
    def __init__(self) -> None:
        self.read: list[LiveStatus] = []

    def update(self, status: LiveStatus) -> None:
        self.read.append(status)


def operated(tmp_path: Path) -> tuple[Operation, Operator, list[float]]:
    file = simulated_station_file(tmp_path, 30.0, None)
    now, operator = [0.0], Operator()
    outputs = OperationOutputs(operators=[operator])
    operation = Operation(file, load_rig(file.rig), Config(), outputs, clock=lambda: now[0], start_s=0.0)
    operation._core(HeadManager({}, 0.0))
    return operation, operator, now


def test_a_status_changed_by_time_is_shown_at_once(tmp_path: Path) -> None:
    """Expected: otherwise twice a second; a change that a pair brought waits for that."""
    operation, operator, now = operated(tmp_path)
    core, heads = Canned(), HeadManager({}, 0.0)

    def turn(t_s: float) -> int:
        now[0] = t_s
        operation._cycle(core, heads, [], None)
        return len(operator.read)

    assert [turn(t_s) for t_s in (10.0, 10.1, 10.49, 10.5)] == [1, 1, 1, 2]
    core.status = TrackStatus.COASTING
    assert turn(10.6) == 3
    assert operator.read[-1].lines[0].startswith("coasting: predicted, no fix of two cameras at 442 ± 1.0 m")
    assert [turn(t_s) for t_s in (10.7, 11.09, 11.1)] == [3, 3, 4]
    core.status = TrackStatus.LOST
    assert turn(11.2) == 5
    assert operator.read[-1].lines == ("lost: searching the predicted region",)
    core.status, core.beating = TrackStatus.TRACKING, False
    assert turn(11.3) == 5
    # a result that is a second old is not shown
    assert turn(12.3) == 6
    assert operator.read[-1].lines[0] == "unknown: was tracking, no status for the last 1.1 s"


def test_a_turn_reports_whether_more_waits(tmp_path: Path) -> None:
    operation, _, now = operated(tmp_path)
    core, heads = Canned(), HeadManager({}, 0.0)
    reading = PtuSample(t_s=9.5, station="left", pan_rad=0.0, tilt_rad=0.0)
    reported = DeviceLogLine(t_s=9.5, level="info", text="parking")
    now[0] = 10.0
    operation._cycle(core, heads, [], reading)
    operation.input_queue.put(reading)
    operation._cycle(core, heads, [], reading)
    operation._cycle(core, heads, [], reported)
    operation._cycle(core, heads, [], None)
    assert core.known[:2] == [10.0, 9.5]
    assert all(known_s is not None and known_s < -1e6 for known_s in core.known[2:])
