"""A filter that fails during a flight: it is reset, reports it, and its replay gives the same track."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from groundstation.live.core import LiveStep, live_config
from groundstation.live.record import LiveRecorder, live_header
from groundstation.messages import Epoch, Event, FilterReset, Frame, StepReport, TrackEvent, TrackStatus
from groundstation.recording.recorder import Recorder, RecorderConfig
from groundstation.replay.recording_replay import apply_filter_resets
from groundstation.replay.replay import ReplayRequest, ReplayResult, replay
from groundstation.rig.rig import Rig, load_rig
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.closed_loop import ClosedLoopSimulation
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.sinks.track_files import TrackFilesSink
from groundstation.tracking.config import Config
from tests.recording.recorded import events, header, looked_at, played, same, small_rig
from tests.stereo_rig import make_rig, with_angle_noise

FLIGHT = GlideApproach(start_y_m=300.0, end_y_m=230.0, speed_m_s=20.0, aim_y_m=60.0)


class Recorded(ClosedLoopSimulation):
    """A rehearsal whose recorder and tables are those of an operation, and whose filter is made to fail."""

    def __init__(self, out: Path, rig: Rig, config: Config, span_m: float | None, recorder: LiveRecorder) -> None:
        super().__init__(rig, config, FLIGHT, seed=3, span_m=span_m)
        self.reported: list[TrackEvent] = []
        self._recorder, self._tables = recorder, TrackFilesSink(out)
        self._step = self._core.pipeline.step

    def fail_at(self, fails: Callable[[Event], bool]) -> None:
        """Let the pipeline's step raise after it has done its work, which is lost then."""

        def step(event: Event) -> StepReport:
            report = self._step(event)
            if fails(event):
                raise np.linalg.LinAlgError("Singular matrix")
            return report

        self._core.pipeline.step = step  # type: ignore[method-assign]

    def fail_when_asked(self, at_s: float) -> None:
        """Let the question where the heads should turn raise once."""
        estimate_at, failed = self._core.pipeline.estimate_at, list[float]()

        def asked(t_s: float) -> object:
            if t_s > at_s and not failed:
                failed.append(t_s)
                raise OverflowError("math range error")
            return estimate_at(t_s)

        self._core.pipeline.estimate_at = asked  # type: ignore[method-assign,assignment]

    def run_and_close(self) -> None:
        self.result = self.run()
        self._tables.close()

    def _done(self, taken: LiveStep) -> None:
        for event in taken.consumed:
            self._recorder.take(event)
        for report in taken.reports:
            self.reported += report.events
            self._recorder.write(report)
            self._tables.write(report)
        super()._done(taken)


def flown_and_replayed(folder: Path, prepare: Callable[[Recorded], None]) -> tuple[Recorded, ReplayResult, Path]:
    file = simulated_station_file(folder / "live", 30.0, with_angle_noise(make_rig(), np.radians(0.01)))
    rig, config = load_rig(file.rig), live_config(Config(), 30.0)
    path = folder / "flight.mcap"
    with LiveRecorder(path, rig, live_header(file, config), RecorderConfig()) as recorder:
        flown = Recorded(folder / "live", rig, config, file.span_m, recorder)
        prepare(flown)
        flown.run_and_close()
    assert recorder.status.records_lost == 0
    request = ReplayRequest(session=path, out=folder / "again", rerun=False, report=False)
    return flown, replay(request), folder


def held_to(flown: Recorded, result: ReplayResult, folder: Path, times: int) -> None:
    """The replay's track is the live one, and both lost it and found it again."""
    assert result.fault is None
    assert result.output_comparison is not None
    assert "bit for bit" in result.output_comparison.line()
    assert result.output_comparison.alone == 0
    for name in ("track.csv", "triangulation.csv"):
        assert (folder / "again" / name).read_bytes() == (folder / "live" / name).read_bytes()
    assert flown._core.pipeline.counts["begun_anew"] == times
    reported = [event for event in flown.reported if "; reset" in event.text]
    assert [event.level for event in reported] == ["error"] * times
    assert flown.result.share(TrackStatus.TRACKING, 3.0, 3.5) > 0.9


@pytest.mark.parametrize("kind", ["frame", "epoch"])
def test_a_filter_that_fails_begins_anew_and_so_does_its_replay(tmp_path: Path, kind: str) -> None:
    """Expected: from the failure on the track is searched again; the replay, which does not fail, does the same."""
    failed: list[Event] = []

    def fails(event: Event) -> bool:
        due = event.t_s > 1.5 and not failed and isinstance(event, Epoch) is (kind == "epoch")
        if due:
            failed.append(event)
        return due

    flown, result, folder = flown_and_replayed(tmp_path, lambda r: r.fail_at(fails))
    held_to(flown, result, folder, 1)
    statuses = [e.status for e in flown.result.estimates if 1.5 < e.t_s < 2.0]
    # what was tracked is searched for again, not merely coasted over
    assert TrackStatus.SEARCHING in statuses


def test_a_failure_in_the_heads_target_resets_the_filter_too(tmp_path: Path) -> None:
    flown, result, folder = flown_and_replayed(tmp_path, lambda r: r.fail_when_asked(1.5))
    held_to(flown, result, folder, 1)


def test_what_failed_is_in_the_recording_with_its_pixels(tmp_path: Path) -> None:
    """Expected: frames without a report any more do not delay later ones, and none is missing."""
    path, given = tmp_path / "flight.mcap", list(events(20, np.random.default_rng(1)))
    reset = FilterReset(t_s=100.3, why="LinAlgError: Singular matrix", in_vain=True)
    failing = next(k for k, e in enumerate(given) if isinstance(e, Frame) and e.epoch == 9)
    given.insert(failing + 1, reset)
    with Recorder(path, small_rig(), header(), RecorderConfig(chunk_s=0.0)) as recorder:
        for k, event in enumerate(given):
            recorder.take(event)
            if k == failing:
                looked_at(event)
            elif event is not reset:
                recorder.write(looked_at(event))
        assert not recorder._unseen
    back, source = played(path)
    assert not source.missing
    assert all(same(one, other) for one, other in zip(given, back, strict=True))
    assert back[failing + 1] == reset
    taken = list(apply_filter_resets(iter(back)))
    assert len(taken) == len(given) - 1
    assert taken[failing] == FilterReset(t_s=100.3, why="LinAlgError: Singular matrix", in_vain=False)
    assert list(apply_filter_resets(iter(taken))) == taken
