"""Frames that share their memory one after the other, and never at the same time."""

import gc

import numpy as np

from groundstation.sources.frame_pool import FramePool


def test_a_frame_has_the_requested_size() -> None:
    assert FramePool((64, 48)).take().shape == (48, 64, 3)


def test_memory_is_reused_when_a_frame_is_gone() -> None:
    pool = FramePool((64, 48))
    first = pool.take()
    place = first.ctypes.data
    assert pool.take().ctypes.data != place
    del first
    gc.collect(1)
    assert place in {frame.ctypes.data for frame in [pool.take(), pool.take()]}


def test_a_slice_keeps_its_frame() -> None:
    pool = FramePool((64, 48))
    frame = pool.take()
    frame[:] = 7
    window = frame[10:20, 10:20][::2, 1:]
    del frame
    gc.collect(1)
    others = [pool.take() for _ in range(3)]
    for other in others:
        other[:] = 9
    assert np.all(window == 7)


def test_a_frame_outlives_its_pool() -> None:
    frame = FramePool((64, 48)).take()
    frame[:] = 3
    gc.collect(1)
    assert np.all(frame == 3)
