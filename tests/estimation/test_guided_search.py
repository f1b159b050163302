"""Guided search: the places contain the aircraft that another camera shows, whatever its span, and few others."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.guided_search import GuidedPlace, GuidedSearch
from groundstation.geometry.station import StationGeometry
from tests.stereo_rig import FOCAL_PX, aim, make_rig, make_station

ALL = ("left", "right", "third", "far")
AIMED_AT = np.array([0.0, 200.0, 8.0])


def geometries(names: tuple[str, ...] = ("left", "right")) -> dict[str, StationGeometry]:
    found = {s.name: s.geometry() for s in make_rig(tuple(n for n in names if n != "far")).stations}
    return found | ({"far": make_station("far", 35.0).geometry()} if "far" in names else {})


def candidate(geometry: StationGeometry, name: str, point: np.ndarray, width_m: float, odds: float) -> CameraCandidate:
    pan, tilt = aim(geometry, AIMED_AT)
    seen = geometry.project(point, pan, tilt)
    assert seen is not None
    return CameraCandidate(
        t_s=1.0,
        station=name,
        pixel=seen.pixel,
        width_px=width_m * FOCAL_PX / seen.depth_m,
        score=1.0,
        pan_rad=pan,
        tilt_rad=tilt,
        angle_sigma_rad=0.0,
        odds=odds,
    )


def all_places(search: GuidedSearch, station: str, t_s: float = 1.0) -> list[GuidedPlace]:
    """Return the places of many frames, each once."""
    pan, tilt = aim(geometries(ALL)[station], AIMED_AT)
    found: dict[tuple[float, ...], GuidedPlace] = {}
    for _ in range(80):
        for place in search.places(station, t_s, pan, tilt):
            found[tuple(place.pixel.tolist())] = place
    return list(found.values())


@settings(max_examples=60, deadline=None)
@given(
    span_m=st.floats(1.2, 6.0),
    shown=st.floats(0.42, 1.0),
    x=st.floats(-5.0, 5.0),
    y=st.floats(120.0, 1500.0),
    station=st.sampled_from(["right", "third", "far"]),
)
@example(span_m=1.2, shown=1.0, x=0.0, y=240.0, station="third")
def test_a_place_is_where_the_aircraft_is_and_as_wide(
    span_m: float, shown: float, x: float, y: float, station: str
) -> None:
    """Of a span that is not known, of which the one camera shows all or the fuselage alone."""
    stations = geometries(ALL)
    point = np.array([x, y, 8.0 + 0.01 * y])
    search = GuidedSearch(stations, InitiationConfig(), None)
    search.add("left", [candidate(stations["left"], "left", point, shown * span_m, 3.0)])
    seen = candidate(stations[station], station, point, shown * span_m, 0.0)
    if not (40.0 < seen.pixel[0] < 1240.0 and 40.0 < seen.pixel[1] < 920.0):
        return
    assert seen.width_px is not None
    places = all_places(search, station)
    assert len(places) <= 120
    for place in places:
        assert -0.5 < place.pixel[0] < 1279.5
        assert -0.5 < place.pixel[1] < 959.5
    off = [math.hypot(*(place.pixel - seen.pixel)) / place.width_px for place in places]
    best = places[int(np.argmin(off))]
    # the window around a place shows 1.45 widths to each side and 1.09 above and below
    assert min(off) < 0.7
    assert 0.6 < best.width_px / seen.width_px < 1.7


def test_a_known_span_needs_fewer_places() -> None:
    stations = geometries()
    counts = []
    for span_m in (None, 2.0):
        search = GuidedSearch(stations, InitiationConfig(), span_m)
        search.add("left", [candidate(stations["left"], "left", AIMED_AT, 2.0, 3.0)])
        counts.append(len(all_places(search, "right")))
    assert 0 < counts[1] < counts[0] <= 20


@pytest.mark.parametrize(
    "change",
    [
        {"odds": None},
        {"odds": -0.1},
        {"width_px": None},
        {"t_s": 0.7},
    ],
    ids=["not weighed", "unlikely", "without width", "old"],
)
def test_only_likely_candidates_of_now_guide(change: dict[str, float | None]) -> None:
    stations = geometries()
    search = GuidedSearch(stations, InitiationConfig(), None)
    likely = candidate(stations["left"], "left", AIMED_AT, 2.0, 3.0)
    search.add("left", [likely])
    assert all_places(search, "right")
    # a camera does not guide itself
    assert not all_places(search, "left")
    search.add("left", [replace(likely, **change)])
    assert not all_places(search, "right")
    search.add("left", [likely])
    search.reset()
    assert not all_places(search, "right")


def test_the_likeliest_guide_and_a_frame_looks_at_few_places() -> None:
    stations = geometries()
    search = GuidedSearch(stations, InitiationConfig(), None)
    points = [AIMED_AT + [0.0, 0.0, dz] for dz in (-4.0, -2.0, 0.0, 2.0, 4.0)]
    search.add("left", [candidate(stations["left"], "left", p, 2.0, 1.0 + k) for k, p in enumerate(points)])
    rows = {round(place.pixel[1]) for place in all_places(search, "right")}
    pan, tilt = aim(stations["right"], AIMED_AT)
    assert len(search.places("right", 1.0, pan, tilt)) == 2
    heights = [candidate(stations["right"], "right", p, 2.0, 0.0).pixel[1] for p in points]
    # one height each of the two most likely, and no others
    near = [min(range(5), key=lambda k: abs(heights[k] - row)) for row in rows]
    assert set(near) == {3, 4}


def test_a_guide_is_not_followed_to_what_the_other_camera_shows_already() -> None:
    stations = geometries()
    left, right = (candidate(stations[name], name, AIMED_AT, 2.0, 3.0) for name in ("left", "right"))
    search = GuidedSearch(stations, InitiationConfig(), None)
    search.add("left", [left])
    for known, found in (
        (right, False),
        # elsewhere, far too narrow, far less likely
        (replace(right, pixel=right.pixel + [0.0, 200.0]), True),
        (replace(right, width_px=right.width_px / 4.0 if right.width_px else None), True),
        (replace(right, odds=1.0), True),
    ):
        search.add("right", [known])
        assert bool(all_places(search, "right")) is found


def test_of_two_widths_of_one_object_one_guides() -> None:
    """The second guide is another object, which the same camera shows."""
    stations = geometries()
    whole, part = (candidate(stations["left"], "left", AIMED_AT, w, odds) for w, odds in ((2.0, 3.0), (0.8, 2.5)))
    other = candidate(stations["left"], "left", AIMED_AT + [0.0, 0.0, 4.0], 2.0, 1.0)
    search = GuidedSearch(stations, InitiationConfig(), None)
    search.add("left", [whole, part, other])
    rows = np.array([place.pixel[1] for place in all_places(search, "right")])
    heights = [candidate(stations["right"], "right", AIMED_AT + [0.0, 0.0, dz], 2.0, 0.0).pixel[1] for dz in (0.0, 4.0)]
    near = np.abs(rows[:, None] - heights).argmin(axis=1)
    assert set(near.tolist()) == {0, 1}


def test_the_usual_span_comes_first() -> None:
    stations = geometries()
    for span_m in (1.5, 2.0, 3.0):
        search = GuidedSearch(stations, InitiationConfig(), None)
        search.add("left", [candidate(stations["left"], "left", AIMED_AT, span_m, 3.0)])
        pan, tilt = aim(stations["right"], AIMED_AT)
        truth = candidate(stations["right"], "right", AIMED_AT, span_m, 0.0)
        first = [place for _ in range(3) for place in search.places("right", 1.0, pan, tilt)]
        assert min(math.hypot(*(p.pixel - truth.pixel)) / p.width_px for p in first) < 0.7
        # without a guide the turn begins again
        search.add("left", [])
        assert search.places("right", 1.0, pan, tilt) == []
        search.add("left", [candidate(stations["left"], "left", AIMED_AT, span_m, 3.0)])
        again = search.places("right", 1.0, pan, tilt)
        assert again[0].pixel == pytest.approx(first[0].pixel)


def test_what_the_other_camera_shows_is_known_while_its_head_turns() -> None:
    stations = geometries()
    left, right = (candidate(stations[name], name, AIMED_AT, 2.0, 3.0) for name in ("left", "right"))
    search = GuidedSearch(stations, InitiationConfig(), None)
    search.add("left", [left])
    search.add("right", [right])
    pan, tilt = aim(stations["right"], AIMED_AT)
    for turned_deg in (-1.5, -0.5, 0.5, 1.5):
        # by up to 170 px
        assert search.places("right", 1.1, pan, tilt + math.radians(turned_deg)) == []


@pytest.mark.parametrize("width_m", [0.02, 0.5, 2.0, 6.5])
def test_no_place_is_looked_at_twice_in_a_frame(width_m: float) -> None:
    """Also where the limits of range leave one span alone."""
    stations = geometries()
    search = GuidedSearch(stations, InitiationConfig(), None)
    search.add("left", [candidate(stations["left"], "left", AIMED_AT, width_m, 3.0)])
    pan, tilt = aim(stations["right"], AIMED_AT)
    places = search.places("right", 1.0, pan, tilt)
    assert places
    assert len({tuple(p.pixel.tolist()) for p in places}) == len(places)
