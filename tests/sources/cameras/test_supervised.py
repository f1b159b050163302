"""A camera's life by script: losses are named, counted and recovered; no wait is unbounded."""

import pytest

from groundstation.sources.cameras.camera import (
    CameraEndedError,
    CameraError,
    CameraEventKind,
    CameraLostError,
    CameraSupervision,
    CameraTiming,
)
from tests.sources.cameras.scripted import Life, Step, grab


def frames(first: int, last: int) -> list[Step]:
    return [grab(i, device_s=0.04 * i) for i in range(first, last + 1)]


def test_frames_are_numbered_and_stamped_before_their_arrival() -> None:
    life = Life(frames(1, 20))
    life.camera.open()
    got = life.run(0.8)
    assert [f.index for f in got] == list(range(20))
    # 1 MB at 1 Gbit/s takes 8 ms, half of the exposure is 2 ms
    assert all(f.arrival_s - f.t_s == pytest.approx(0.010, abs=1e-6) for f in got)
    assert (got[-1].exposure_s, got[-1].gain, got[-1].camera) == (0.004, 3.0, "left")
    assert life.kinds == [CameraEventKind.OPENED]


def test_lost_incomplete_and_overtaken_frames_are_counted_apart() -> None:
    script: list[Step] = [
        *frames(1, 3),
        grab(5, device_s=0.2),
        grab(6, whole=False),
        grab(4, device_s=0.16),
        grab(5, device_s=0.2),
        *frames(7, 9),
    ]
    life = Life(script)
    life.camera.open()
    got = life.run(0.4)
    counts = life.camera.counts()
    assert [f.index for f in got] == [0, 1, 2, 4, 6, 7, 8]
    assert (counts.frames, counts.lost, counts.incomplete, counts.overtaken) == (7, 1, 1, 2)


def test_a_discarded_frame_without_a_number_is_not_lost_as_well() -> None:
    life = Life([*frames(1, 3), grab(None, whole=False), *frames(5, 6), *frames(8, 9)])
    life.camera.open()
    life.run(0.32)
    counts = life.camera.counts()
    assert (counts.incomplete, counts.lost) == (1, 1)


def test_unplugged_it_is_opened_again_with_longer_and_longer_pauses() -> None:
    away = [CameraError("got no answer; wanted a camera")] * 6
    life = Life([*frames(1, 5), CameraLostError("pulled")], *away, frames(1, 5))
    life.camera.open()
    got = life.run(30.0, until=lambda: CameraEventKind.REOPENED in life.kinds)
    got += life.run(0.3)
    pauses = [b - a for a, b in zip(life.attempts_s[1:], life.attempts_s[2:], strict=False)]
    assert pauses == pytest.approx([0.5, 1.0, 2.0, 4.0, 4.0, 4.0], abs=0.11)
    assert life.kinds == [
        CameraEventKind.OPENED,
        CameraEventKind.LOST,
        *[CameraEventKind.NOT_OPENED] * 6,
        CameraEventKind.REOPENED,
    ]
    assert "pulled" in life.events[1].text
    assert life.devices[0].closed
    assert [f.index for f in got] == list(range(10))
    assert [f.opening for f in got] == [0] * 5 + [1] * 5
    assert life.camera.counts().reconnects == 1


def test_a_silent_camera_is_opened_again() -> None:
    life = Life(frames(1, 3), frames(4, 6), care=CameraSupervision(silent_after_s=1.0))
    life.camera.open()
    got = life.run(2.0, until=lambda: len(life.devices) == 2 and life.time.now_s > life.attempts_s[1] + 0.2)
    assert CameraEventKind.SILENT in life.kinds
    assert life.attempts_s[1] - life.attempts_s[0] == pytest.approx(1.0 + 0.12 + 0.25, abs=0.25)
    assert len(got) == 6


def test_a_frozen_picture_is_marked_and_then_the_camera_is_opened_again() -> None:
    stuck: list[Step] = [grab(i, level=7) for i in range(4, 60)]
    life = Life([*frames(1, 3), *stuck], frames(1, 3))
    life.camera.open()
    got = life.run(3.0)
    assert life.kinds == [CameraEventKind.OPENED, CameraEventKind.FROZEN, CameraEventKind.REOPENED]
    repeated = [f.repeated for f in got]
    assert repeated[:4] == [False] * 4
    assert all(repeated[4:-3])
    assert repeated[-3:] == [False] * 3
    # a second of them, of 25 a second
    assert 22 <= sum(repeated) <= 26


def test_a_dark_or_blinded_camera_is_not_frozen() -> None:
    script: list[Step] = []
    for i in range(60):
        step = grab(i + 1)
        assert step.pixels is not None
        step.pixels[:] = 0
        script.append(step)
    life = Life(script)
    life.camera.open()
    assert len(life.run(2.4)) == 60
    assert life.kinds == [CameraEventKind.OPENED]


def test_a_file_that_ends_ends_the_camera() -> None:
    life = Life([*frames(1, 2), CameraEndedError("the file ends after 2 frames")])
    life.camera.open()
    assert len(life.run(5.0)) == 2
    assert life.camera.ended
    assert life.kinds[-1] is CameraEventKind.ENDED


def test_a_camera_that_is_not_there_yet_may_be_waited_for() -> None:
    life = Life(CameraError("got no answer; wanted a camera"), frames(1, 3))
    with pytest.raises(CameraError, match="no answer") as error:
        life.camera.open()
    life.camera.wait_before_reopening(error.value)
    assert len(life.run(0.6)) == 3


def test_a_camera_that_restarts_alone_is_recounted_and_its_clock_fitted_again() -> None:
    again: list[Step] = [grab(i, device_s=0.04 * i) for i in range(1, 10)]
    life = Life([*[grab(i, device_s=50.0 + 0.04 * i) for i in range(1000, 1100)], *again])
    life.camera.open()
    got = life.run(4.36)
    assert life.kinds == [CameraEventKind.OPENED, CameraEventKind.RECOUNTED, CameraEventKind.CLOCK_RESET]
    assert [f.index for f in got] == list(range(109))
    assert all(f.t_s <= f.arrival_s for f in got)


def test_a_step_never_waits_longer_than_a_tenth_of_a_second() -> None:
    life = Life([*frames(1, 2), *[None] * 5, CameraLostError("pulled")], timing=CameraTiming())
    life.camera.open()
    for _ in range(200):
        before_s = life.time.now_s
        life.camera.step()
        assert life.time.now_s - before_s <= 0.1 + 1e-9
