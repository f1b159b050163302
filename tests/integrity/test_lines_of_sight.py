"""Of a run that found nothing it is said where the cameras look, if no aircraft that lands can be there."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from groundstation.integrity.lines_of_sight import KnownPositions, LinesOfSight
from groundstation.messages import PtuSample
from groundstation.rig.rig import Station
from tests.stereo_rig import make_station

STATIONS = {"left": make_station("left", -5.0), "right": make_station("right", 5.0)}


def seen(
    stations: Mapping[str, Station], pan_deg: float = 1.0, tilt_deg: float = 4.0, *references: KnownPositions
) -> str | None:
    sights = LinesOfSight({name: station.geometry() for name, station in stations.items()})
    pan, tilt = math.radians(pan_deg), math.radians(tilt_deg)
    events = [PtuSample(t_s=0.05 * k, station=n, pan_rad=pan, tilt_rad=tilt) for k in range(200) for n in stations]
    assert list(sights.watched(events)) == events
    return sights.line(references)


def positions(x_m: float, y_m: float, z_m: float, from_s: float = 0.0) -> KnownPositions:
    t_s = from_s + np.arange(0.0, 10.0, 0.1)
    return KnownPositions(name="dgps.csv", t_s=t_s, position_m=np.tile([x_m, y_m, z_m], (len(t_s), 1)))


def test_cameras_that_look_along_the_runway_need_no_words() -> None:
    assert seen(STATIONS) is None
    # an aircraft outside of the pictures, as where the heads do not follow it; a log of another time
    assert seen(STATIONS, 1.0, 4.0, positions(-5.0, 300.0, 70.0)) is None
    assert seen(STATIONS, 1.0, 4.0, positions(0.0, -300.0, 20.0, from_s=3600.0)) is None


@pytest.mark.parametrize(
    ("pan_deg", "tilt_deg", "words"),
    [
        (
            90.0,
            2.0,
            "left 90° to the left of +y and 2° up, right 90° to the left of +y and 2° up (on average); left and",
        ),
        (-90.0, 2.0, "left and right stand one behind the other in that direction, from which no range follows"),
        (0.0, 85.0, "of +y and 85° up"),
    ],
)
def test_angles_from_another_zero_are_told(pan_deg: float, tilt_deg: float, words: str) -> None:
    line = seen(STATIONS, pan_deg, tilt_deg)
    assert line is not None
    assert line.startswith("by rig and angles the cameras look: ")
    assert words in line


def test_a_quaternion_in_another_order_is_told() -> None:
    x, y, z, w = 0.002, 0.001, 0.003, 0.999992
    turned = {n: replace(s, runway_from_base_wxyz=np.array([x, y, z, w])) for n, s in STATIONS.items()}
    line = seen(turned, 1.0, 4.0, positions(0.0, 300.0, 20.0))
    assert line is not None
    assert "dgps.csv has the aircraft 17" in line
    assert line.endswith("right's (median), in no picture: rig, angles, or that are wrong")


def test_places_in_another_order_are_told() -> None:
    places = {"left": [0.0, -5.0, -1.5], "right": [0.0, 5.0, -1.5]}
    line = seen({n: replace(s, ptu_position_m=np.array(places[n])) for n, s in STATIONS.items()})
    assert line is not None
    assert "left and right stand one behind the other" in line


def test_heads_that_look_apart_are_told() -> None:
    half_turned = replace(STATIONS["right"], runway_from_base_wxyz=np.array([0.0, 0.0, 0.0, 1.0]))
    line = seen({**STATIONS, "right": half_turned})
    assert line is not None
    assert "left and right look 17" in line


def test_fixed_stations_look_the_same_way_all_the_time() -> None:
    fixed = {n: replace(s, fixed=True) for n, s in STATIONS.items()}
    sights = LinesOfSight({name: station.geometry() for name, station in fixed.items()})
    assert sights.line([positions(0.0, 300.0, 1.5)]) is None
    line = sights.line([positions(0.0, -300.0, 20.0)])
    assert line is not None
    assert "dgps.csv has the aircraft 17" in line


def test_of_a_long_run_every_other_look_is_dropped() -> None:
    sights = LinesOfSight({"left": STATIONS["left"].geometry()})
    list(sights.watched(PtuSample(t_s=0.5 * k, station="left", pan_rad=0.0, tilt_rad=1.5) for k in range(5000)))
    line = sights.line()
    assert line is not None
    assert "86° up" in line
    assert 500 <= len(sights._looks["left"]) <= 1000


def test_nothing_is_said_of_a_head_without_readings() -> None:
    """Expected: no direction of it, and no word on where the aircraft is seen from it; the other one is told."""
    sights = LinesOfSight({name: station.geometry() for name, station in STATIONS.items()}, STATIONS)
    assert sights.line([positions(0.0, -300.0, 20.0)]) is None
    list(sights.watched(PtuSample(t_s=0.05 * k, station="left", pan_rad=0.0, tilt_rad=1.5) for k in range(200)))
    line = sights.line([positions(0.0, -300.0, 20.0)])
    assert line is not None
    assert "left 0° to the right of +y and 86° up (on average)" in line
    assert "right 0°" not in line
    assert "dgps.csv" not in line


def test_an_aircraft_in_two_pictures_that_was_not_tracked_is_told() -> None:
    """A focal length a tenth of what it is leaves the directions as they are; one picture alone gives no track."""
    sights = LinesOfSight({name: station.geometry() for name, station in STATIONS.items()})
    events = [
        PtuSample(t_s=0.05 * k, station=n, pan_rad=0.0, tilt_rad=math.radians(4.0))
        for k in range(200)
        for n in STATIONS
    ]
    assert list(sights.watched(events)) == events
    inside = positions(0.0, 300.0, 21.0)
    line = sights.in_pictures([inside], 2.3)
    assert line is not None
    assert line.startswith("no target was tracked, though dgps.csv has the aircraft in the pictures of left (at 30")
    width_px = 2.3 / 300.0 * STATIONS["left"].lens.focal_px[0]
    assert f"up to {width_px:.0f} px wide" in line
    for elsewhere in (positions(0.0, 300.0, 80.0), positions(0.0, 300.0, 21.0, from_s=3600.0)):
        assert sights.in_pictures([elsewhere], None) is None
