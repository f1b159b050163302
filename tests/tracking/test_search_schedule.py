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
    assert all(schedule.is_due("left", 0.01 * k, has_target=False) for k in range(50))


@pytest.mark.parametrize(
    ("rate_hz", "later_s", "share"), [(10, 0.0, 0.5), (30, 0.0, 0.2), (30, 0.012, 0.2), (10, 0.04, 0.5)]
)
def test_next_to_a_target_cameras_search_together_and_then_not_for_a_while(
    rate_hz: int, later_s: float, share: float
) -> None:
    schedule = SearchSchedule()
    done: dict[str, list[int]] = {"left": [], "right": []}
    for k in range(10 * rate_hz):
        for station, at_s in (("left", k / rate_hz), ("right", k / rate_hz + later_s)):
            if schedule.is_due(station, at_s, has_target=True):
                done[station].append(k)
    assert done["left"] == done["right"]
    assert len(done["left"]) == pytest.approx(share * 10 * rate_hz, rel=0.05)


def test_frames_that_arrive_out_of_order_take_part_once() -> None:
    schedule = SearchSchedule()
    assert schedule.is_due("right", 1.02, has_target=True)
    assert schedule.is_due("left", 1.0, has_target=True)
    assert not schedule.is_due("left", 1.01, has_target=True)
    # a clock that was set back does not stop it
    assert schedule.is_due("left", 0.2, has_target=True)


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
