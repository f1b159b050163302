"""The schedule of searches: which frames are searched, and which searches are combined."""

import numpy as np
import pytest

from groundstation.estimation.initialise import CameraCandidate
from groundstation.tracking.search_schedule import SearchSchedule


def candidate(station: str, t_s: float) -> CameraCandidate:
    return CameraCandidate(
        t_s=t_s,
        station=station,
        pixel=np.zeros(2),
        width_px=None,
        score=1.0,
        pan_rad=0.0,
        tilt_rad=0.0,
        angle_sigma_rad=0.0,
    )


def test_without_a_target_each_frame_is_searched() -> None:
    schedule = SearchSchedule()
    assert all(schedule.is_due("left", 0.01 * k, epoch=k, has_target=False) for k in range(50))


@pytest.mark.parametrize(
    ("rate_hz", "offsets_s", "share"),
    [
        (10, (0.0, 0.0), 0.5),
        (30, (0.0, 0.0), 0.2),
        (30, (0.0, 0.012), 0.2),
        (10, (0.0, 0.04), 0.5),
        # as far apart as the searches of different epochs are from each other: all frames of an epoch, or none
        (10, (0.0, 0.033, 0.052), 0.5),
        (10, (0.0, 0.07), 0.5),
    ],
)
def test_next_to_a_target_cameras_search_together_and_then_not_for_a_while(
    rate_hz: int, offsets_s: tuple[float, ...], share: float
) -> None:
    schedule = SearchSchedule()
    done: list[list[int]] = [[] for _ in offsets_s]
    for k in range(10 * rate_hz):
        for station, later_s in enumerate(offsets_s):
            if schedule.is_due(str(station), k / rate_hz + later_s, epoch=k, has_target=True):
                done[station].append(k)
    assert all(epochs == done[0] for epochs in done)
    assert len(done[0]) == pytest.approx(share * 10 * rate_hz, rel=0.05)


def test_a_camera_of_half_the_rate_takes_part() -> None:
    """Expected: a search that stayed with one camera does not count; no camera that delivers nothing is waited for."""
    for right_every, searched, together in ((2, (40, 60), 40), (10**9, (49, 51), 0)):
        schedule = SearchSchedule()
        done: dict[str, list[int]] = {"left": [], "right": []}
        for k in range(1, 101):
            for station in ("left", "right")[: 1 + (k % right_every == 0)]:
                if schedule.is_due(station, 0.1 * k, epoch=k, has_target=True):
                    done[station].append(k)
        assert searched[0] <= len(done["left"]) <= searched[1]
        assert len(set(done["left"]) & set(done["right"])) >= together


def test_epochs_that_interleave_are_decided_once() -> None:
    """Expected: no search that begins with the last camera of an epoch, whatever frame of another comes between."""
    schedule = SearchSchedule()
    done: list[tuple[int, str]] = []
    frames = sorted(
        (0.1 * k + later_s, k, station)
        for k in range(40)
        for station, later_s in (("a", 0.0), ("b", 0.06), ("c", 0.11))
    )
    for t_s, k, station in frames:
        if schedule.is_due(station, t_s, epoch=k, has_target=True):
            done.append((k, station))
    searched = {k for k, _ in done}
    assert len(searched) >= 18
    assert {(k, station) for k in searched if k < 39 for station in "abc"} <= set(done)


def test_frames_that_arrive_out_of_order_take_part_once() -> None:
    schedule = SearchSchedule()
    assert schedule.is_due("right", 1.02, epoch=10, has_target=True)
    assert schedule.is_due("left", 1.0, epoch=10, has_target=True)
    assert not schedule.is_due("left", 1.01, epoch=10, has_target=True)
    # a clock that was set back does not stop it
    assert schedule.is_due("left", 0.2, epoch=11, has_target=True)


def test_one_camera_s_candidates_wait_for_another_camera() -> None:
    """Expected: a pair that lost one of its frames is neither a fix nor a miss; 0.1 s later it is nothing any more."""
    schedule = SearchSchedule()
    assert schedule.combined(0.0) == []
    left, right = candidate("left", 1.0), candidate("right", 1.06)
    schedule.add("left", 1.0, [left])
    assert schedule.combined(1.0) is None
    schedule.add("right", 1.06, [right])
    assert schedule.combined(1.06) == [left, right]
    assert schedule.combined(1.1) is None
    schedule.add("left", 2.0, [left])
    assert schedule.combined(2.0) is None
    schedule.add("right", 2.2, [right])
    assert schedule.combined(2.2) is None


def test_a_search_that_finds_nothing_is_evidence() -> None:
    schedule = SearchSchedule()
    schedule.add("left", 1.0, [])
    schedule.add("right", 1.0, [])
    assert schedule.combined(1.0) == []


def test_what_waited_is_not_mixed_with_a_whole_epoch() -> None:
    """Expected: a frame that is a tenth of a second older than the others shows another place."""
    schedule = SearchSchedule()
    schedule.add("third", 1.0, [candidate("third", 1.0)])
    assert schedule.combined(1.0) is None
    left, right = candidate("left", 1.08), candidate("right", 1.1)
    schedule.add("left", 1.08, [left])
    schedule.add("right", 1.1, [right])
    assert schedule.combined(1.09) == [left, right]
