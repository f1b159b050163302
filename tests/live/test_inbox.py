"""What waits for the pipeline: of each camera so many frames, the oldest of that camera goes, nothing of another."""

import threading

import numpy as np
import pytest

from groundstation.live.input_queue import DeviceLogLine, InputQueue, Item, TimedPicture
from groundstation.messages import PtuSample, ReferenceFix
from groundstation.picture import as_picture

PICTURE = as_picture(np.zeros((2, 2, 3), np.uint8))


def shot(station: str, t_s: float) -> TimedPicture:
    return TimedPicture(t_s=t_s, arrived_s=t_s, station=station, picture=PICTURE)


def sample(t_s: float, station: str = "left") -> PtuSample:
    return PtuSample(t_s=t_s, station=station, pan_rad=0.0, tilt_rad=0.0)


def drained(input_queue: InputQueue) -> list[Item]:
    found = []
    while (item := input_queue.get(0.0)) is not None:
        found.append(item)
    return found


def shots(items: list[Item]) -> list[tuple[str, float]]:
    return [(item.station, item.t_s) for item in items if isinstance(item, TimedPicture)]


def test_a_full_camera_costs_its_own_oldest_frame_and_no_other_cameras() -> None:
    """Expected: the other camera's frames, which are older, stay; so does the order of what is left."""
    input_queue = InputQueue(frames=2)
    for station, t_s in (("left", 0.0), ("left", 0.1), ("right", 0.2), ("right", 0.3), ("right", 0.4)):
        input_queue.put(shot(station, t_s))
    assert input_queue.dropped == {"frames of right": 1}
    assert input_queue.frames_waiting == len(input_queue) == 4
    assert shots(drained(input_queue)) == [("left", 0.0), ("left", 0.1), ("right", 0.3), ("right", 0.4)]
    assert input_queue.frames_waiting == 0


def test_where_frames_pile_up_whole_pairs_are_dropped() -> None:
    """Expected: what is left are pairs, also of cameras that do not expose at the same instant, and of three."""
    input_queue = InputQueue(frames=3, together_s=0.05)
    for k in range(10):
        for station, later_s in (("left", 0.0), ("right", 0.02), ("third", 0.04)):
            input_queue.put(shot(station, 0.1 * k + later_s))
            input_queue.put(sample(0.1 * k))
    assert input_queue.dropped == {f"frames of {name}": 7 for name in ("left", "right", "third")}
    left = shots(drained(input_queue))
    assert left == [(n, 0.1 * k + s) for k in (7, 8, 9) for n, s in (("left", 0.0), ("right", 0.02), ("third", 0.04))]
    assert input_queue.frames_waiting == 0


@pytest.mark.parametrize("stations", [("left", "right"), ("right", "left"), ("left", "third", "right")])
def test_a_camera_that_floods_keeps_its_newest_and_costs_no_other(stations: tuple[str, ...]) -> None:
    input_queue, flooding = InputQueue(frames=3), stations[-1]
    for k, station in enumerate(stations[:-1]):
        input_queue.put(shot(station, 0.01 * k))
    for k in range(20):
        input_queue.put(shot(flooding, 1.0 + k))
    assert input_queue.dropped == {f"frames of {flooding}": 17}
    own = [(station, 0.01 * k) for k, station in enumerate(stations[:-1])]
    assert shots(drained(input_queue)) == [*own, *[(flooding, 1.0 + k) for k in (17, 18, 19)]]


def test_what_was_taken_makes_room() -> None:
    input_queue = InputQueue(frames=2, others=2)
    for k in range(10):
        input_queue.put(sample(float(k)))
        assert input_queue.get(0.0) == sample(float(k))
        input_queue.put(shot("left", float(k)))
        input_queue.put(shot("right", float(k)))
        assert shots([i for i in (input_queue.get(0.0), input_queue.get(0.0)) if i is not None]) == [
            ("left", float(k)),
            ("right", float(k)),
        ]
    assert input_queue.dropped == {}


def test_readings_do_not_push_out_frames_nor_frames_readings() -> None:
    """Expected: of too many readings the oldest is dropped, of any head; log lines count among them."""
    input_queue = InputQueue(frames=1, others=3)
    input_queue.put(shot("left", 0.0))
    words = DeviceLogLine(t_s=0.1, level="info", text="left: ready")
    fix = ReferenceFix(t_s=0.4, position_runway_m=np.zeros(3), sigma_m=np.ones(3))
    for item in (words, sample(0.2), sample(0.3, "right"), fix):
        input_queue.put(item)
    assert input_queue.dropped == {"readings": 1}
    input_queue.put(shot("left", 0.5))
    assert input_queue.dropped == {"readings": 1, "frames of left": 1}
    left = drained(input_queue)
    assert left[:3] == [sample(0.2), sample(0.3, "right"), fix]
    assert shots(left) == [("left", 0.5)]


def test_arriving_data_wake_the_waiting_thread() -> None:
    input_queue, got = InputQueue(), []
    waiting = threading.Thread(target=lambda: got.append(input_queue.get(60.0)))
    waiting.start()
    input_queue.put(sample(1.0))
    waiting.join(20.0)
    assert got == [sample(1.0)]
    assert input_queue.get(0.0) is None


@pytest.mark.parametrize("room", [{"frames": 0}, {"others": 0}])
def test_an_input_queue_without_room_is_refused(room: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="at least one frame"):
        InputQueue(**room)
