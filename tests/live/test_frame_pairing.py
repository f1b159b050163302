"""Frames into pairs, as they arrive: none in two pairs, none lost, none waited for in vain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.live.frame_pairing import FramePairer, LoadShedder
from groundstation.live.input_queue import DeviceLogLine, InputQueue, TimedPicture
from groundstation.messages import Epoch, PtuSample
from groundstation.picture import BgrPicture

PERIOD = 1.0 / 30.0
CAMERAS = ("left", "right")


def paired(arrivals: list[tuple[str, float]]) -> tuple[list[tuple[str, float, int]], list[Epoch]]:
    pairing = FramePairer(CAMERAS, PERIOD)
    frames: list[tuple[str, float, int]] = []
    epochs: list[Epoch] = []
    for station, t_s in arrivals:
        placed = pairing.frame(station, t_s)
        epochs += placed.closed_before
        frames.append((station, t_s, placed.epoch))
        epochs += placed.closed_after
    return frames, epochs + list(pairing.flush())


def test_triggered_cameras_pair_in_order_of_arrival() -> None:
    arrivals = [(name, k * PERIOD) for k in range(5) for name in CAMERAS]
    frames, epochs = paired(arrivals)
    assert [e for _, _, e in frames] == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert [e.stations for e in epochs] == [CAMERAS] * 5
    np.testing.assert_allclose([e.t_s for e in epochs], [k * PERIOD for k in range(5)])


def test_a_pair_is_closed_by_its_last_frame() -> None:
    pairing = FramePairer(CAMERAS, PERIOD)
    assert pairing.frame("left", 0.0).closed_after == ()
    assert [e.epoch for e in pairing.frame("right", 0.004).closed_after] == [0]


def test_a_camera_that_is_lost_is_waited_for_and_then_no_more() -> None:
    pairing = FramePairer(CAMERAS, PERIOD)
    pairing.frame("left", 0.0)
    pairing.frame("right", 0.0)
    closed = [pairing.frame("left", k * PERIOD) for k in range(1, 10)]
    # while it may come: the next frame closes; once it does not: at once
    assert [len(c.closed_after) for c in closed] == [0, 0, 0, 0, 0, 1, 1, 1, 1]
    back = pairing.frame("right", 9.05 * PERIOD)
    assert back.epoch == 10
    assert not pairing.overdue(9.1 * PERIOD)
    assert pairing.overdue(11 * PERIOD)
    assert [e.epoch for e in pairing.flush()] == [10]


@given(st.lists(st.tuples(st.sampled_from(CAMERAS), st.floats(0.0, 2.0)), max_size=60))
def test_every_frame_has_one_pair_and_every_pair_is_closed_once(arrivals: list[tuple[str, float]]) -> None:
    frames, epochs = paired(arrivals)
    assert [e.epoch for e in epochs] == sorted({n for _, _, n in frames})
    for epoch in epochs:
        own = [(s, t) for s, t, n in frames if n == epoch.epoch]
        assert len({s for s, _ in own}) == len(own)
        assert sorted(epoch.stations) == sorted(s for s, _ in own)
        assert epoch.t_s == pytest.approx(np.mean([t for _, t in own]))
        assert np.ptp([t for _, t in own]) <= 0.5 * PERIOD


def test_a_pipeline_that_is_behind_splits_no_pairs() -> None:
    """Expected: what counts is how long a pair has been open, not how old its frames are."""
    pairing = FramePairer(("left", "right"), PERIOD)
    for k in range(5):
        t_s = k * PERIOD
        now_s = t_s + 4 * PERIOD
        first = pairing.frame("left", t_s, now_s)
        assert not pairing.overdue(now_s + PERIOD)
        assert pairing.frame("right", t_s, now_s + PERIOD).epoch == first.epoch
    pairing.frame("left", 5 * PERIOD, 9 * PERIOD)
    assert pairing.overdue(10.6 * PERIOD)


def shot(station: str, t_s: float) -> TimedPicture:
    return TimedPicture(t_s=t_s, arrived_s=t_s, station=station, picture=BgrPicture(np.zeros((2, 2, 3), np.uint8)))


def test_the_oldest_frame_of_the_same_camera_goes() -> None:
    input_queue = InputQueue(frames=2)
    for k in range(5):
        input_queue.put(shot("left", float(k)))
    input_queue.put(shot("right", 9.0))
    input_queue.put(PtuSample(t_s=0.5, station="left", pan_rad=0.0, tilt_rad=0.0))
    assert input_queue.dropped == {"frames of left": 3}
    got = [input_queue.get(0.0) for _ in range(5)]
    assert [getattr(i, "t_s", None) for i in got] == [3.0, 4.0, 9.0, 0.5, None]


def test_readings_are_bounded_too() -> None:
    input_queue = InputQueue(others=3)
    for k in range(5):
        input_queue.put(DeviceLogLine(t_s=float(k), level="info", text=str(k)))
    assert input_queue.dropped == {"readings": 2}
    assert [i.t_s for i in iter(lambda: input_queue.get(0.0), None)] == [2.0, 3.0, 4.0]
    with pytest.raises(ValueError, match="at least one"):
        InputQueue(frames=0)


def test_whole_pairs_are_left_out_while_behind() -> None:
    pairing = FramePairer(CAMERAS, PERIOD)
    shedding = LoadShedder(pairing, PERIOD, most=3)
    taken = []
    # (frames waiting behind, expected)
    waiting = [0, 0, 4, 3, 3, 0, 2, 0, 0, 0]
    for k, behind in enumerate(waiting):
        station, t_s = CAMERAS[k % 2], (k // 2) * PERIOD + 0.001 * (k % 2)
        if not shedding.drops(station, t_s, behind):
            taken.append((station, pairing.frame(station, t_s).epoch))
    # the second and the third pair are gone, with both frames each
    assert taken == [("left", 0), ("right", 0), ("left", 1), ("right", 1), ("left", 2), ("right", 2)]
    assert shedding.pairs == 2


@pytest.mark.parametrize("names", [("left", "right"), ("left", "right", "third", "fourth")])
@pytest.mark.parametrize("search_s", [0.05, 0.2])
def test_while_searching_delay_is_bounded_and_what_is_left_out_is_counted(
    names: tuple[str, ...], search_s: float
) -> None:
    """Pictures at 30 Hz that each take longer than a period: twenty seconds of them, in virtual time.

    A pair waits for no more than the frames that may wait, and its own. All that the time allows is searched.
    """
    period, most = 1.0 / 30.0, len(names) + 1
    pairing = FramePairer(names, period)
    shedding = LoadShedder(pairing, period, most=most)
    arrivals = [(k * period + 0.002 * i, name) for k in range(600) for i, name in enumerate(names)]
    now, at, delays, searched = 0.0, 0, [], []
    for t_s, name in arrivals:
        now = max(now, t_s)
        while at < len(arrivals) and arrivals[at][0] <= now:
            at += 1
        waiting = at - arrivals.index((t_s, name)) - 1
        if not shedding.drops(name, t_s, waiting):
            pairing.frame(name, t_s)
            now += search_s
            searched.append(t_s)
            delays.append(now - t_s)
    # the frames that waited when its pair was begun were of the pair before, or are left out at once
    assert max(delays) <= (2 * len(names)) * search_s + (most + 1) * period
    pairs = len(searched) / len(names)
    assert pairs + shedding.pairs == 600
    assert pairs >= 0.9 * 20.0 / (len(names) * search_s)
