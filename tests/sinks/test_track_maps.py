"""KML and GeoJSON of tracks, read back by other programs' readers and converted back by pymap3d."""

import json
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.evaluation.run_series import ReferencePositions, RunSeries, TrackSeries
from groundstation.sinks.geographic_frame import GeographicFrame, geographic_frame
from groundstation.sinks.track_maps import MappedRun, geojson, kml

NAMES = {"k": "http://www.opengis.net/kml/2.2"}
ORIGIN = {"lat_deg": 47.3977, "lon_deg": 8.5456, "height_m": 455.2, "y_axis_azimuth_deg": 271.5}
PLACE: dict[str, Any] = {
    "frame": "runway",
    "origin": {**ORIGIN, "geoid_separation_m": None},
    "stations_m": {"left": [-5.0, 0.0, 1.6], "right": [5.0, 0.0, 1.6]},
}
STATUSES = ["searching", "acquiring", "tracking", "tracking", "coasting", "tracking", "lost", "tracking"]


def frame_of(**origin: float | None) -> GeographicFrame:
    frame = geographic_frame({**PLACE, "origin": {**PLACE["origin"], **origin}})
    assert frame is not None
    return frame


def series_of(name: str = "usual") -> RunSeries:
    """Eight rows: none at first, a change of status, a gap where it is lost, and one row alone at the end."""
    t_s = 10.0 + 0.1 * np.arange(8)
    position = np.column_stack([0.5 * np.arange(8.0), 300.0 - 1.5 * np.arange(8.0), 20.0 - 0.1 * np.arange(8.0)])
    truth = position + 0.25
    truth[5:] = np.nan
    position[[0, 6]] = np.nan
    covariance = np.tile(np.diag([0.01, 4.0, 0.04]), (8, 1, 1))
    covariance[[0, 6]] = np.nan
    track = TrackSeries(t_s=t_s, status=np.array(STATUSES), position_m=position, covariance_m2=covariance)
    references = {"truth": ReferencePositions(position_m=truth, sigma_m=np.zeros(3))}
    return RunSeries(name=name, track=track, references=references)


def runway_positions(lon: np.ndarray, lat: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Positions in the runway frame, by pymap3d and by the definition of the azimuth: +y points so from north."""
    e, n, u = pymap3d.geodetic2enu(lat, lon, height, ORIGIN["lat_deg"], ORIGIN["lon_deg"], ORIGIN["height_m"])
    azimuth = np.radians(ORIGIN["y_axis_azimuth_deg"])
    along = np.array([np.sin(azimuth), np.cos(azimuth)])
    to_the_right = np.array([np.cos(azimuth), -np.sin(azimuth)])
    return np.column_stack([np.column_stack([e, n]) @ to_the_right, np.column_stack([e, n]) @ along, u])


def features(text: str, kind: str) -> list[dict[str, Any]]:
    return [f for f in json.loads(text)["features"] if f["properties"]["kind"] == kind]


def test_geojson_has_the_track_to_the_millimetre_with_times_status_and_sigma() -> None:
    series = series_of()
    text = geojson([MappedRun(frame=frame_of(), series=series, colour="0072B2")])
    whole = json.loads(text, parse_constant=pytest.fail)
    assert whole["type"] == "FeatureCollection"
    found = features(text, "track")
    # each ends where the next one begins; before the gap, and at the end, there is no next one
    assert [(f["geometry"]["type"], f["properties"]["status"], len(f["properties"]["t_s"])) for f in found] == [
        ("LineString", "acquiring", 2),
        ("LineString", "tracking", 3),
        ("LineString", "coasting", 2),
        ("Point", "tracking", 1),
        ("Point", "tracking", 1),
    ]
    for feature in found:
        rows = np.atleast_2d(feature["geometry"]["coordinates"])
        at = np.searchsorted(series.track.t_s, np.array(feature["properties"]["t_s"]) - 1e-6)
        assert np.abs(runway_positions(*rows.T) - series.track.position_m[at]).max() < 1e-3
        assert feature["properties"]["from_s"] == feature["properties"]["t_s"][0]
        assert feature["properties"]["run"] == "usual"
        # +y is nearly west, so the large sigma is east's
        assert feature["properties"]["sigma_east_north_up_m"][0] == pytest.approx([2.0, 0.11, 0.2], abs=0.01)
    (truth,) = features(text, "truth")
    assert (
        np.abs(runway_positions(*np.array(truth["geometry"]["coordinates"]).T)[0] - [0.25, 300.25, 20.25]).max() < 1e-3
    )
    assert "status" not in truth["properties"]
    stations = features(text, "station")
    assert [f["properties"]["station"] for f in stations] == ["left", "right"]
    place = np.array([f["geometry"]["coordinates"] for f in stations])
    assert np.abs(runway_positions(*place.T) - [[-5.0, 0.0, 1.6], [5.0, 0.0, 1.6]]).max() < 1e-3


def coordinates(placemark: ElementTree.Element) -> np.ndarray:
    texts = [c.text or "" for c in placemark.iterfind(".//k:coordinates", NAMES)]
    return np.array([[float(v) for v in place.split(",")] for text in texts for place in text.split()])


def test_kml_has_a_line_for_each_status_and_absolute_heights() -> None:
    series = series_of()
    root = ElementTree.fromstring(
        kml([MappedRun(frame=frame_of(), series=series, colour="0072B2")], "a flight").encode()
    )
    (document,) = root
    names = [p.findtext("k:name", "", NAMES) for p in document.iterfind("k:Folder/k:Placemark", NAMES)]
    assert names == ["tracking", "acquiring", "coasting", "truth", "left", "right"]
    assert {m.text for m in document.iterfind(".//k:altitudeMode", NAMES)} == {"absolute"}
    assert "above the WGS 84 ellipsoid" in document.findtext("k:description", "", NAMES)
    styles = {f"#{s.get('id')}" for s in document.iterfind("k:Style", NAMES)}
    used = {u.text for u in document.iterfind(".//k:styleUrl", NAMES)}
    assert used <= styles
    # alpha, blue, green, red
    assert document.findtext("k:Style[@id='run0']/k:LineStyle/k:color", "", NAMES) == "ffb27200"
    tracking = next(document.iterfind("k:Folder/k:Placemark", NAMES))
    assert np.abs(runway_positions(*coordinates(tracking).T) - series.track.position_m[[2, 3, 4, 5, 7]]).max() < 1e-3
    for line in document.iterfind(".//k:LineString/k:coordinates", NAMES):
        assert len((line.text or "").split()) >= 2


def test_kml_heights_are_above_sea_level_where_the_separation_is_stated() -> None:
    """Expected: exactly the ellipsoid's less the separation, for track and stations; GeoJSON keeps the ellipsoid's."""
    run = MappedRun(frame=frame_of(geoid_separation_m=47.5), series=series_of(), colour="0072B2")
    plain = MappedRun(frame=frame_of(), series=series_of(), colour="0072B2")
    roots = [ElementTree.fromstring(kml([r], "a flight").encode()) for r in (run, plain)]
    lower, usual = (
        np.concatenate([coordinates(p) for p in root.iterfind(".//k:Placemark", NAMES)])[:, 2] for root in roots
    )
    assert usual - lower == pytest.approx(np.full(len(usual), 47.5), abs=1e-3)
    description = roots[0].findtext("k:Document/k:description", "", NAMES)
    assert "above sea level" in description
    assert "less 47.5 m" in description
    assert geojson([run]) == geojson([plain])


def test_names_are_text_and_stations_of_one_session_are_there_once() -> None:
    odd = {**PLACE, "stations_m": {"<b>&\x00": [0.0, 0.0, 0.0]}}
    frame = geographic_frame(odd)
    assert frame is not None
    runs = [MappedRun(frame=frame, series=series_of(name), colour="D55E00") for name in ("a&b", "two")]
    root = ElementTree.fromstring(kml(runs, "<title>").encode())
    assert root.findtext("k:Document/k:name", "", NAMES) == "<title>"
    folders = root.findall("k:Document/k:Folder", NAMES)
    assert [f.findtext("k:name", "", NAMES) for f in folders] == ["a&b", "two", "stations"]
    assert [p.findtext("k:name", "", NAMES) for p in folders[-1].iterfind("k:Placemark", NAMES)] == ["<b>&\\x00"]
    assert len(features(geojson(runs), "station")) == 1


@pytest.mark.parametrize("lon_deg", [179.9999, 539.9999, -180.0001])
def test_longitudes_lie_within_half_a_turn(lon_deg: float) -> None:
    places = frame_of(lon_deg=lon_deg).places(np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]))
    assert np.all(np.abs(places[:, 0]) <= 180.0)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.just(10**400) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["origin", "stations_m", *ORIGIN, "geoid_separation_m", "left"]), inner)
    ),
    max_leaves=12,
)


@given(place=JSON, values=st.dictionaries(st.sampled_from([*ORIGIN, "geoid_separation_m"]), JSON), stations=JSON)
def test_a_damaged_place_is_none_or_gives_finite_places(
    place: object, values: dict[str, Any], stations: object
) -> None:
    geographic_frame(place)
    frame = geographic_frame({"origin": {**ORIGIN, **values}, "stations_m": stations})
    if frame is not None:
        assert np.isfinite(frame.places(np.zeros((1, 3)))).all()
        for position in frame.stations_m.values():
            assert np.isfinite(frame.places(position[None])).all()
