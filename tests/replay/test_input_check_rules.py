"""Which of a run's input checks are told, and which something else in the run contradicts."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.messages import PixelMeasurement, PtuSample
from groundstation.replay.input_checks import InputChecks
from groundstation.rig.rig import Rig
from tests.stereo_rig import aim, make_rig

# (station, pan, tilt) in deg to what is stored
Stored = Callable[[str, float, float], tuple[float, float]]


def passing(t_s: float) -> FloatArray:
    """An aircraft that crosses the field of view in 12 s, such that heads turn by 60 degrees."""
    return np.array([-180.0 + 30.0 * t_s, 300.0, 45.0 + 3.0 * t_s])


def as_read(_name: str, pan: float, tilt: float) -> tuple[float, float]:
    return pan, tilt


def checks_of(rig: Rig, stored: Stored = as_read, step_deg: float = 0.00625, *, pixels: bool = True) -> InputChecks:
    """Checks that have watched a flight of labelled pixels, by heads that are read in steps of ``step_deg``."""
    checks = InputChecks(rig)
    for epoch, t_s in enumerate(np.arange(0.0, 12.0, 0.1)):
        for station in rig.stations:
            geometry, target = station.geometry(), passing(t_s)
            pan, tilt = (step_deg * round(math.degrees(angle) / step_deg) for angle in aim(geometry, target))
            shown = geometry.project(target, math.radians(pan), math.radians(tilt))
            assert shown is not None
            p, q = map(math.radians, stored(station.name, pan, tilt))
            events = [PtuSample(t_s=t_s, station=station.name, pan_rad=p, tilt_rad=q)]
            if pixels:
                u, v = shown.pixel
                events.append(PixelMeasurement(t_s=t_s, station=station.name, epoch=epoch, u_px=u, v_px=v))
            list(checks.watched(events))
    return checks


def with_step(step_deg: float) -> Rig:
    rig = make_rig()
    return replace(rig, stations=tuple(replace(s, ptu_resolution_rad=math.radians(step_deg)) for s in rig.stations))


@pytest.mark.parametrize("stated_deg", [0.0, 0.1, 0.5, 1.0])
def test_a_head_that_is_read_in_whole_degrees_is_not_accused(stated_deg: float) -> None:
    """Expected: neither without a stated step, nor with a finer one where its rays meet as they are read."""
    checks = checks_of(with_step(stated_deg), step_deg=1.0)
    assert checks.contradictions(tracked=True) == ()
    # without a track nothing confirms the readings
    told = checks.contradictions(tracked=False)
    assert (len(told) == 1 and "whole numbers" in told[0]) is (stated_deg == 0.1)


def test_counts_whose_rays_miss_are_told_of_a_tracked_target() -> None:
    counts = checks_of(with_step(0.1), lambda _, pan, tilt: (round(10.0 * pan), round(10.0 * tilt)), step_deg=0.1)
    (line,) = counts.contradictions(tracked=True)
    assert "all angles of left and right are whole numbers" in line
