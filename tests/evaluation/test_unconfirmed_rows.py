"""Rows of camera reports until the outcome of their track."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.box import Box
from groundstation.evaluation.collector import DETECTION_STATUSES, MISS_REASONS, ResultCollector
from groundstation.evaluation.unconfirmed_rows import UnconfirmedRows
from groundstation.messages import (
    INITIAL_PIXELS_S,
    CameraReport,
    Detection,
    DetectionStatus,
    InitialPixel,
    Innovation,
    Miss,
    MissReason,
    OutcomeKind,
    StepReport,
    TrackOutcome,
)
from groundstation.sinks.track_files import TrackFilesSink


def looked(t_s: float, track_id: int | None, *, found: bool = True, station: str = "left") -> CameraReport:
    """Return a camera's report of a frame of a track; without one, of a search."""
    reason = MissReason.NOT_ACQUIRED if track_id is None else MissReason.LOW_CONTRAST
    hit = found and track_id is not None
    innovation = Innovation(residual=np.zeros(2), covariance=np.eye(2), nis=1.5, dof=2, accepted=True)
    return CameraReport(
        t_s=t_s,
        station=station,
        epoch=round(10 * t_s),
        status=DetectionStatus.OK if hit else DetectionStatus.MISS,
        result=Detection(
            u_px=5.0,
            v_px=6.0,
            covariance_px2=np.eye(2),
            noise_px2=np.eye(2),
            centroid_px=np.array([5.0, 6.0]),
            box=Box(0.0, 0.0, 9.0, 9.0),
            area_px=20.0,
            contour_px=np.zeros((0, 2), np.float32),
            contrast_to_noise=9.0,
            channel="learned",
        )
        if hit
        else Miss(reason=reason),
        roi=None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=0.0,
        tilt_rad=0.0,
        innovation=innovation if hit else None,
        elapsed_s=0.0,
        track_id=track_id,
    )


def pixel(t_s: float, track_id: int, u_px: float = 30.0) -> InitialPixel:
    return InitialPixel(t_s=t_s, station="left", u_px=u_px, v_px=4.0, sigma_px=2.0, track_id=track_id)


def ended(track_id: int, outcome: OutcomeKind) -> StepReport:
    return StepReport(outcomes=(TrackOutcome(track_id=track_id, kind=outcome),))


def statuses(collector: ResultCollector) -> list[str]:
    return [DETECTION_STATUSES[k].value for k in collector.cameras()["status"]]


def file_rows(folder: Path) -> list[tuple[str, str]]:
    with (folder / "detections.csv").open(encoding="utf-8") as file:
        return [(row["status"], row["u_px"]) for row in csv.DictReader(file)]


# a search, a track that is displaced by a better one, the better one
DISPLACED = (
    StepReport(cameras=(looked(0.0, None), looked(0.1, None))),
    StepReport(cameras=(looked(0.2, None),), initial_pixels=(pixel(0.1, 1), pixel(0.2, 1))),
    StepReport(cameras=(looked(0.3, 1), looked(0.4, 1, found=False), looked(0.5, 1))),
    StepReport(
        cameras=(looked(0.6, 1),),
        outcomes=(TrackOutcome(track_id=1, kind=OutcomeKind.DISPLACED),),
        initial_pixels=(pixel(0.1, 2), pixel(0.4, 2), pixel(0.5, 2)),
    ),
    StepReport(cameras=(looked(0.7, 2),)),
)


def test_a_displaced_track_leaves_its_frames_to_the_next(tmp_path: Path) -> None:
    collector = ResultCollector()
    with TrackFilesSink(tmp_path) as sink:
        for report in (*DISPLACED, ended(2, OutcomeKind.CONFIRMED)):
            collector.write(report)
            sink.write(report)
    wanted = ["miss", "initial", "miss", "miss", "initial", "initial", "miss", "ok"]
    assert statuses(collector) == wanted
    assert [status for status, _ in file_rows(tmp_path)] == wanted
    rows = collector.cameras()
    assert np.isfinite(rows["pixel"]).all(axis=1).tolist() == [status != "miss" for status in wanted]
    # no innovation of what was not the target
    assert np.isfinite(rows["nis"]).tolist() == [False] * 7 + [True]
    assert rows["accepted"].tolist() == [False] * 7 + [True]
    for k, row in enumerate(rows):
        if wanted[k] == "miss":
            assert MISS_REASONS[row["reason"]] is MissReason.NOT_ACQUIRED


def test_rows_are_written_once_a_track_is_confirmed(tmp_path: Path) -> None:
    sink = TrackFilesSink(tmp_path)
    for report in DISPLACED:
        sink.write(report)
    sink.flush()
    assert file_rows(tmp_path) == []
    sink.write(ended(2, OutcomeKind.CONFIRMED))
    sink.flush()
    assert len(file_rows(tmp_path)) == 8
    sink.write(StepReport(cameras=(looked(0.8, 2),)))
    sink.flush()
    assert len(file_rows(tmp_path)) == 9
    # what was confirmed is not withdrawn when it is lost
    sink.write(StepReport(cameras=(looked(0.9, None),)))
    sink.close()
    assert [status for status, _ in file_rows(tmp_path)][-2:] == ["ok", "miss"]


def test_a_track_that_is_open_at_the_end_keeps_its_pixels(tmp_path: Path) -> None:
    """Expected: an aircraft that stands until the session ends was seen, though no estimate was reported."""
    with TrackFilesSink(tmp_path) as sink:
        for report in DISPLACED:
            sink.write(report)
    assert [status for status, _ in file_rows(tmp_path)][-1] == "ok"


def test_rows_wait_for_five_seconds_at_most(tmp_path: Path) -> None:
    sink = TrackFilesSink(tmp_path)
    collector = ResultCollector()
    times = 0.1 * np.arange(100)
    for t_s in times:
        report = StepReport(cameras=(looked(float(t_s), 1),))
        sink.write(report)
        collector.write(report)
    sink.flush()
    waiting = times[-1] - times <= INITIAL_PIXELS_S
    assert len(file_rows(tmp_path)) == np.count_nonzero(~waiting)
    for each in (sink, collector):
        each.write(ended(1, OutcomeKind.DISPLACED))
    sink.close()
    wanted = ["miss" if late else "ok" for late in waiting]
    assert [status for status, _ in file_rows(tmp_path)] == wanted
    assert statuses(collector) == wanted


def test_a_track_displaced_in_the_step_of_its_start_leaves_nothing() -> None:
    """Expected: a step of several epochs may have a whole track in it."""
    rows = UnconfirmedRows[str]()
    report = StepReport(
        cameras=(looked(0.0, None), looked(0.1, 1)),
        initial_pixels=(pixel(0.0, 1),),
        outcomes=(TrackOutcome(track_id=1, kind=OutcomeKind.DISPLACED),),
    )
    assert rows.take(report, ["a", "b"]) == [("b", None)]
    assert list(rows.final()) == []
    assert list(rows.rest()) == ["a", "b"]


@pytest.mark.parametrize(("near_s", "u_px", "kept"), [(0.5, 8.0, True), (0.5, 10.0, False), (1.0, 8.0, False)])
def test_a_track_displaced_by_the_same_target_keeps_its_pixels(near_s: float, u_px: float, kept: bool) -> None:
    """Expected: a better range for what is in the same silhouettes, box 0 to 9, takes none of them away."""
    collector = ResultCollector()
    collector.write(StepReport(cameras=(looked(0.3, 1), looked(0.4, 1, found=False))))
    first = pixel(near_s, 2, u_px)
    outcomes = ended(1, OutcomeKind.DISPLACED).outcomes
    collector.write(StepReport(outcomes=outcomes, initial_pixels=(first, replace(first, t_s=near_s + 0.1))))
    assert statuses(collector) == ["ok" if kept else "miss", "miss"]
    # of the new track, that may be displaced as well
    collector.write(ended(2, OutcomeKind.DISPLACED))
    assert statuses(collector) == ["miss", "miss"]


@pytest.mark.parametrize(("u_px", "common", "kept"), [(8.0, 3, True), (8.0, 2, False), (30.0, 3, False)])
def test_frames_before_the_better_track_are_judged_by_the_camera_s_others(u_px: float, common: int, kept: bool) -> None:
    """Expected: an aircraft that stood was seen before it moved; a bird that was followed was none before, either."""
    collector = ResultCollector()
    times = [2.0 + 0.1 * k for k in range(common)]
    collector.write(StepReport(cameras=(looked(0.0, None),)))
    # the other camera has seen something else
    other = looked(0.1, 1, station="right")
    collector.write(StepReport(initial_pixels=(pixel(0.0, 1),), cameras=(looked(0.1, 1), other)))
    collector.write(StepReport(cameras=tuple(looked(t_s, 1) for t_s in times)))
    outcomes = ended(1, OutcomeKind.DISPLACED).outcomes
    collector.write(StepReport(outcomes=outcomes, initial_pixels=tuple(pixel(t_s, 2, u_px) for t_s in times)))
    collector.write(ended(2, OutcomeKind.CONFIRMED))
    assert statuses(collector)[:3] == (["initial", "ok", "miss"] if kept else ["miss", "miss", "miss"])
    # the frames in which the better one has pixels keep theirs, or get these
    assert statuses(collector)[3:] == (["ok"] if u_px < 9.0 else ["initial"]) * common


def test_of_several_tracks_in_a_report_the_newest_takes_the_place() -> None:
    rows = UnconfirmedRows[str]()
    rows.take(StepReport(cameras=(looked(0.3, 1),)), ["a"])
    outcomes = (
        TrackOutcome(track_id=1, kind=OutcomeKind.DISPLACED),
        TrackOutcome(track_id=2, kind=OutcomeKind.DROPPED),
    )
    pixels = (pixel(0.3, 2, 8.0), pixel(0.3, 3, 8.0))
    assert rows.take(StepReport(outcomes=outcomes, initial_pixels=pixels), []) == []
    assert list(rows.final()) == []
    assert rows.take(ended(3, OutcomeKind.DISPLACED), []) == [("a", None)]


def test_a_source_without_tracks_gets_its_initial_pixels(tmp_path: Path) -> None:
    """Expected: also where the first detection is in the same report, after which nothing waits."""
    first = replace(pixel(0.1, 1), track_id=None)
    found = replace(looked(0.2, 1), track_id=None)
    report = StepReport(cameras=(looked(0.0, None), looked(0.1, None), found), initial_pixels=(first,))
    collector = ResultCollector()
    collector.write(report)
    with TrackFilesSink(tmp_path) as sink:
        sink.write(report)
        sink.flush()
        written = [status for status, _ in file_rows(tmp_path)]
    assert written == statuses(collector) == ["miss", "initial", "ok"]


@pytest.mark.parametrize("reason", [MissReason.LATE, MissReason.NO_PTU_ANGLE])
def test_frames_that_no_one_looked_at_keep_their_reason(reason: MissReason) -> None:
    """Expected: that a head gave no angles is not hidden by a track that was displaced."""
    collector = ResultCollector()
    unseen = replace(looked(0.3, 1, found=False), result=Miss(reason=reason))
    collector.write(StepReport(cameras=(unseen, looked(0.4, 1))))
    collector.write(ended(1, OutcomeKind.DISPLACED))
    assert [MISS_REASONS[row["reason"]] for row in collector.cameras()] == [reason, MissReason.NOT_ACQUIRED]


def test_a_track_that_is_dropped_keeps_its_pixels() -> None:
    """Expected: it may have been the target; frames searched before it may still get pixels of the next track."""
    collector = ResultCollector()
    collector.write(StepReport(cameras=(looked(0.0, None), looked(0.1, 1))))
    collector.write(ended(1, OutcomeKind.DROPPED))
    collector.write(StepReport(cameras=(looked(0.2, None),), initial_pixels=(pixel(0.0, 2), pixel(0.1, 2))))
    assert statuses(collector) == ["initial", "ok", "miss"]


@given(
    st.lists(st.sampled_from(["search", "start", "look", "miss", "confirm", "drop", "displace", "wait"]), max_size=60)
)
def test_every_row_once_in_order_and_none_of_a_displaced_track(actions: list[str]) -> None:
    """Expected: by whatever happens, what a track that was displaced has seen lately is no detection."""
    rows = UnconfirmedRows[int]()
    written: list[int] = []
    held: dict[int, int | None] = {}
    decided: set[int] = set()
    t_s, track_id, confirmed = 0.0, None, False
    count = tracks = 0

    def write(report: StepReport, owner: int | None) -> None:
        nonlocal count
        numbers = range(count, count + len(report.cameras))
        count += len(report.cameras)
        held.update(dict.fromkeys(numbers, owner))
        for row, initial in rows.take(report, numbers):
            assert row not in decided
            held[row] = None if initial is None else initial.track_id
        for row in rows.final():
            written.append(row)
            decided.add(row)

    for action in actions:
        t_s += 1.7 if action == "wait" else 0.1
        if action in ("search", "wait") and track_id is None:
            write(StepReport(cameras=(looked(t_s, None),)), None)
        elif action == "start" and track_id is None:
            tracks += 1
            track_id, confirmed = tracks, False
            pixels = tuple(pixel(t_s - 0.1 * k, track_id) for k in range(4))
            write(StepReport(cameras=(looked(t_s, None),), initial_pixels=pixels), None)
        elif action in ("look", "miss") and track_id is not None:
            write(StepReport(cameras=(looked(t_s, track_id, found=action == "look"),)), track_id)
        elif action == "confirm" and track_id is not None and not confirmed:
            confirmed = True
            write(ended(track_id, OutcomeKind.CONFIRMED), None)
        elif action == "displace" and track_id is not None and not confirmed:
            tracks += 1
            gone, track_id = track_id, tracks
            outcomes = ended(gone, OutcomeKind.DISPLACED).outcomes
            write(StepReport(outcomes=outcomes, initial_pixels=(pixel(t_s - 0.1, track_id),)), None)
            assert all(held[row] != gone for row in held if row not in decided)
        elif action == "drop" and track_id is not None:
            if not confirmed:
                write(ended(track_id, OutcomeKind.DROPPED), None)
            track_id, confirmed = None, False
    written += rows.rest()
    assert written == list(range(count))
    assert len(rows) == 0
