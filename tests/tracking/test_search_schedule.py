"""The schedule of searches: which frames are searched, and which searches are combined."""

import numpy as np
import pytest

from groundstation.estimation.camera_candidate import CameraCandidate
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


def searched(every: dict[str, tuple[int, int]], rate_hz: float, lost: tuple[int, ...] = ()) -> dict[str, set[int]]:
    """Return the epochs in which each camera's frame is searched in 300, of which it delivers every n-th from one on.

    The last camera loses its frames of the epochs ``lost``.
    """
    schedule = SearchSchedule()
    done: dict[str, set[int]] = {station: set() for station in every}
    for k in range(1, 301):
        for station, (step, first) in every.items():
            delivers = k >= first and (k - first) % step == 0 and not (station == list(every)[-1] and k in lost)
            if delivers and schedule.is_due(station, k / rate_hz, epoch=k, has_target=True):
                done[station].add(k)
    return done


@pytest.mark.parametrize(("rate_hz", "step"), [(10, 2), (10, 3), (20, 4), (30, 3), (30, 5), (60, 5)])
def test_a_camera_of_a_lower_rate_takes_part(rate_hz: int, step: int) -> None:
    """Expected: whatever its phase and with a frame lost, in about each of its frames that is 0.15 s after the last."""
    for first in range(1, step + 1):
        for lost in ((), tuple(range(40, 40 + step))):
            done = searched({"left": (1, 1), "right": (step, first)}, rate_hz, lost)
            both = done["left"] & done["right"]
            possible = min(300 / step, 300 / (0.15 * rate_hz + step))
            assert len(both) > 0.8 * possible, (first, lost, len(both))
            assert len(done["left"]) <= 2.2 * len(both)


@pytest.mark.parametrize("step", [2, 5])
def test_one_of_three_cameras_may_have_a_lower_rate(step: int) -> None:
    for first in range(1, step + 1):
        done = searched({"left": (1, 1), "right": (1, 1), "third": (step, first)}, 10.0 if step == 2 else 30.0)
        assert done["left"] == done["right"]
        assert len(done["left"] & done["third"]) >= 40


def test_no_camera_that_delivers_nothing_is_waited_for() -> None:
    assert len(searched({"left": (1, 1), "right": (1, 1000)}, 10.0)["left"]) == 150
    schedule = SearchSchedule()
    # the other one is lost after 10 s: two more searches, and then every 0.2 s as before
    done = [
        k
        for k in range(200)
        for station in ("left", "right")[: 2 if k < 100 else 1]
        if schedule.is_due(station, 0.1 * k, epoch=k, has_target=True) and station == "left"
    ]
    assert len(done) <= 104


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
    schedule.add("third", 1.02, [candidate("third", 1.02)])
    assert schedule.combined(1.02) is None
    left, right = candidate("left", 1.08), candidate("right", 1.1)
    schedule.add("left", 1.08, [left])
    schedule.add("right", 1.1, [right])
    assert schedule.combined(1.09) == [left, right]
