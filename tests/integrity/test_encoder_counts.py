"""Whole numbers where degrees are wanted, and what only looks like them."""

import math
import re

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.integrity.encoder_counts import EncoderCountsMonitor
from groundstation.messages import PtuSample

STEP_DEG = 92.5714 / 3600.0
TIMES_S = np.arange(0.0, 10.0, 0.05)


def line_of(pan: FloatArray, tilt: FloatArray, step_deg: float = STEP_DEG) -> str | None:
    monitor = EncoderCountsMonitor({"left": math.radians(step_deg)})
    for t_s, p, q in zip(TIMES_S, np.radians(pan), np.radians(tilt), strict=True):
        list(monitor.watched([PtuSample(t_s=float(t_s), station="left", pan_rad=float(p), tilt_rad=float(q))]))
    return monitor.line()


def turning() -> tuple[FloatArray, FloatArray]:
    """Pan and tilt (n,), deg, of a head that follows an aircraft."""
    return -8.0 + 0.9 * TIMES_S, 2.0 + 0.1 * TIMES_S


@pytest.mark.parametrize("step_deg", [STEP_DEG, 0.5 * STEP_DEG, 360.0 / 65536.0, 0.01])
def test_counts_of_any_step_are_told(step_deg: float) -> None:
    pan, tilt = turning()
    line = line_of(np.round(pan / step_deg), np.round(tilt / step_deg), step_deg)
    assert line is not None
    assert "all angles of left are whole numbers" in line
    assert "an encoder's counts, or hundredths of degrees?" in line
    low, high = map(float, re.findall(r"would be (\S+) to (\S+) deg", line)[0])
    assert low == pytest.approx(-8.0, abs=step_deg)
    assert high == pytest.approx(2.995, abs=step_deg)


def test_unsigned_counts_are_told() -> None:
    pan, tilt = turning()
    counts = np.round(np.stack([pan, tilt]) / 360.0 * 65536.0) % 65536.0
    line = line_of(*counts)
    assert line is not None
    assert "whole numbers" in line


def test_degrees_are_not_accused() -> None:
    """Expected: none of a head in fine steps, one that rests, one that goes to whole degrees, one in whole degrees."""
    pan, tilt = turning()
    assert line_of(np.round(pan / STEP_DEG) * STEP_DEG, np.round(tilt / STEP_DEG) * STEP_DEG) is None
    assert line_of(np.full_like(pan, 12.0), np.full_like(pan, 3.0)) is None
    stops = 5.0 * np.round(TIMES_S / 2.0)
    assert line_of(stops, np.full_like(pan, 3.0)) is None
    assert line_of(np.round(20.0 * pan), np.round(tilt), step_deg=1.0) is None
    assert line_of(np.round(20.0 * pan), np.round(tilt), step_deg=0.5) is None
    whole = np.round(20.0 * pan)
    whole[-1] += 0.4
    assert line_of(whole, np.round(tilt)) is None


def test_without_a_stated_step_nothing_is_wrong_with_whole_numbers() -> None:
    pan, tilt = turning()
    assert line_of(np.round(20.0 * pan), np.round(tilt), step_deg=0.0) is None


def test_readings_that_are_degrees_by_something_else_are_not_accused() -> None:
    pan, tilt = turning()
    monitor = EncoderCountsMonitor(dict.fromkeys(("left", "right"), math.radians(0.1)))
    for t_s, p, q in zip(TIMES_S, np.radians(np.round(20.0 * pan)), np.radians(np.round(tilt)), strict=True):
        for name in ("left", "right"):
            list(monitor.watched([PtuSample(t_s=float(t_s), station=name, pan_rad=float(p), tilt_rad=float(q))]))
    line = monitor.line(lambda name: name == "right")
    assert line is not None
    assert "all angles of left are whole numbers" in line
    assert monitor.line(lambda name: True) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_reading_that_is_no_number_is_left_out(bad: float) -> None:
    """Expected: the run goes on, and the other readings are judged."""
    pan, tilt = turning()
    counts = np.round(np.stack([pan, tilt]) / STEP_DEG)
    counts[0, 7] = bad
    assert line_of(*counts) is not None
