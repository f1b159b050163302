"""Which of a run's input checks are told, and which something else in the run contradicts."""

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_z, wxyz_from_matrix
from groundstation.messages import Event, PixelMeasurement, PtuSample
from groundstation.replay.input_checks import InputChecks
from groundstation.rig.rig import Rig, Station
from tests.stereo_rig import aim, make_rig, make_station

# (station, pan, tilt) in deg to what is stored
Stored = Callable[[str, float, float], tuple[float, float]]


def passing(t_s: float) -> FloatArray:
    """An aircraft that crosses the field of view in 12 s, such that heads turn by 60 degrees."""
    return np.array([-180.0 + 30.0 * t_s, 300.0, 10.0 + 0.5 * t_s])


def as_read(_name: str, pan: float, tilt: float) -> tuple[float, float]:
    return pan, tilt


def turned_to(station: Station, target: FloatArray, step_deg: float) -> tuple[float, float]:
    """Pan and tilt, deg; a camera that looks to the head's left is turned by pan alone: tilt rolls it."""
    pan, tilt = np.degrees(aim(make_station(station.name, *station.ptu_position_m[:2]).geometry(), target))
    if matrix_from_wxyz(station.head_from_camera_wxyz)[0, 2] < -0.5:
        pan, tilt = pan - 90.0, 0.0
    return step_deg * round(pan / step_deg), step_deg * round(tilt / step_deg)


def checks_of(rig: Rig, stored: Stored = as_read, step_deg: float = 0.00625, *, pixels: bool = True) -> InputChecks:
    """Checks that have watched a flight of labelled pixels, by heads that are read in steps of ``step_deg``."""
    checks = InputChecks(rig)
    for epoch, t_s in enumerate(np.arange(0.0, 12.0, 0.1)):
        for station in rig.stations:
            geometry, target = station.geometry(), passing(t_s)
            pan, tilt = turned_to(station, target, step_deg)
            shown = geometry.project(target, math.radians(pan), math.radians(tilt))
            assert shown is not None
            p, q = map(math.radians, stored(station.name, pan, tilt))
            events: list[Event] = [PtuSample(t_s=t_s, station=station.name, pan_rad=p, tilt_rad=q)]
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


def with_left_aside() -> Rig:
    """A rig whose left camera looks to the left of its head's forward axis."""
    rig = make_rig()
    left, right = rig.stations
    mount = rotation_z(math.pi / 2.0) @ matrix_from_wxyz(left.head_from_camera_wxyz)
    return replace(rig, stations=(replace(left, head_from_camera_wxyz=wxyz_from_matrix(mount)), right))


MOUNT = "away from the head's forward axis, left's by 90°"


def test_a_mount_turned_on_purpose_hides_no_fault() -> None:
    """Expected: a tilt that is off by 3 degrees is named, next to the mount, which could explain it."""
    checks = checks_of(with_left_aside(), lambda name, p, q: (p, q + 3.0 * (name == "right")))
    fault, mount = checks.contradictions(tracked=True)
    assert "rays to the target meet in 0 of" in fault
    assert re.search(r"tilt .*3\.0", fault)
    assert MOUNT in mount


@pytest.mark.parametrize("tracked", [True, False])
def test_a_mount_turned_on_purpose_is_no_contradiction(tracked: bool) -> None:
    """Expected: of rays that meet nothing is said; of an empty sky a note, as nothing confirms the mount."""
    meeting = checks_of(with_left_aside())
    assert meeting.contradictions(tracked=tracked) == ()
    assert meeting.notes(tracked=tracked) == []
    empty = checks_of(with_left_aside(), pixels=False)
    assert empty.contradictions(tracked=tracked) == ()
    assert [MOUNT in line for line in empty.notes(tracked=tracked)] == ([] if tracked else [True])


def test_a_mount_in_another_order_is_a_contradiction() -> None:
    """Expected: told once, as the camera then looks elsewhere than the other one."""
    right_angles = make_rig()
    left, right = right_angles.stations
    identity = replace(left, head_from_camera_wxyz=np.array([1.0, 0.0, 0.0, 0.0]))
    empty = checks_of(right_angles, pixels=False)
    assert empty.contradictions(tracked=False) == ()
    wrong = InputChecks(replace(right_angles, stations=(identity, right)))
    for t_s in np.arange(0.0, 12.0, 0.1):
        for name in right_angles.names:
            list(wrong.watched([PtuSample(t_s=t_s, station=name, pan_rad=0.0, tilt_rad=0.1)]))
    (line,) = wrong.contradictions(tracked=False)
    assert MOUNT in line
    assert wrong.notes(tracked=False) == []
