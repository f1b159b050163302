"""Tracks on a map: KML for Google Earth and its kin, GeoJSON for geographic information systems.

KML is OGC 07-147r2 (KML 2.2): heights there are above sea level (EGM96). GeoJSON is RFC 7946: longitude, latitude and
height above the WGS 84 ellipsoid.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import printable
from groundstation.evaluation.position_series import BoolArray
from groundstation.evaluation.run_series import RunSeries
from groundstation.files.whole_file import write_text_whole
from groundstation.sinks.geographic_frame import GeographicFrame

_KML = "http://www.opengis.net/kml/2.2"
# 0.1 mm on the ground
_DEGREES, _METRES = 9, 4
_LINE_PX, _OTHER_LINE_PX = 3, 1.5
# of a track's colour where no two cameras see the target, as two hexadecimal digits
_SOLID, _FAINT = "ff", "99"
_GREY = "888888"
_TRACKING = "tracking"
ABOVE_ELLIPSOID = (
    "heights are above the WGS 84 ellipsoid, but a KML viewer takes them as above sea level, so all is drawn off by "
    "the geoid separation there, up to 100 m: geoid_separation_m in [dgps] of session.toml corrects it"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MappedRun:
    """A run whose frame on Earth is known; ``colour`` of its track, six hexadecimal digits, red first."""

    frame: GeographicFrame
    series: RunSeries
    colour: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapStretch:
    """m positions without a gap and of one status: ``t_s`` (m,), ``places`` (m, 3) as `GeographicFrame.places`.

    ``sigma_m`` (m, 3) is east, north, up; None for a reference. The last position is also the first of the next
    stretch where that follows at once.
    """

    status: str
    t_s: FloatArray
    places: FloatArray
    sigma_m: FloatArray | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MappedStation:
    """A station: ``place`` (3,) as `GeographicFrame.places`, and the geoid's separation there, 0 if not known."""

    name: str
    place: FloatArray
    separation_m: float


def write_maps(stem: Path, runs: Sequence[MappedRun], title: str) -> tuple[Path, Path]:
    """Write ``stem``.kml and ``stem``.geojson, and return them; raises `InputError` if one can't be written."""
    files = stem.with_name(f"{stem.name}.kml"), stem.with_name(f"{stem.name}.geojson")
    for path, text in zip(files, (kml(runs, title), geojson(runs)), strict=True):
        write_text_whole(path, text)
    return files


# ---------------------------------------------------------------------------------------------- GeoJSON
def geojson(runs: Sequence[MappedRun]) -> str:
    """Return a FeatureCollection: lines of each run's track by status, its references, and the stations."""
    features: list[dict[str, Any]] = []
    for run in runs:
        for kind, stretches in _lines(run):
            features += [_line_feature(run.series.name, kind, stretch) for stretch in stretches]
    for station in _stations(runs):
        features.append(_feature("Point", _coordinates(station.place), {"kind": "station", "station": station.name}))
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False, ensure_ascii=False) + "\n"


def _line_feature(run: str, kind: str, stretch: MapStretch) -> dict[str, Any]:
    """Return one stretch; a single position is a point, since a line has two."""
    properties: dict[str, Any] = {
        "run": printable(run),
        "kind": kind,
        "from_s": round(float(stretch.t_s[0]), 6),
        "to_s": round(float(stretch.t_s[-1]), 6),
    }
    if stretch.status:
        properties["status"] = stretch.status
    properties["t_s"] = [round(float(t), 6) for t in stretch.t_s]
    if stretch.sigma_m is not None:
        rows = [[round(float(v), _METRES) if np.isfinite(v) else None for v in row] for row in stretch.sigma_m]
        properties["sigma_east_north_up_m"] = rows
    coordinates = [_coordinates(place) for place in stretch.places]
    if len(coordinates) == 1:
        return _feature("Point", coordinates[0], properties)
    return _feature("LineString", coordinates, properties)


def _feature(kind: str, coordinates: list[Any], properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": dict(properties)}


def _coordinates(place: FloatArray) -> list[float]:
    lon, lat, height = (float(v) for v in place)
    return [round(lon, _DEGREES), round(lat, _DEGREES), round(height, _METRES)]


# ---------------------------------------------------------------------------------------------- KML
def kml(runs: Sequence[MappedRun], title: str) -> str:
    """Return a KML document: a folder for each run with its track by status and its references, and the stations.

    Heights are above sea level where the session states the geoid's separation; the document says which they are.
    """
    ElementTree.register_namespace("", _KML)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = _add(root, "Document")
    _add(document, "name", printable(title))
    _add(document, "description", " ".join(f"{line}." for line in height_lines(runs)))
    for number, run in enumerate(runs):
        _add_style(document, f"run{number}", run.colour, _SOLID, _LINE_PX)
        _add_style(document, f"run{number}-faint", run.colour, _FAINT, _OTHER_LINE_PX)
    _add_style(document, "reference", _GREY, _SOLID, _OTHER_LINE_PX)
    for number, run in enumerate(runs):
        folder = _add(document, "Folder")
        _add(folder, "name", printable(run.series.name))
        for kind, stretches in _lines(run):
            # tracking first; one entry for each status, which the viewer can show or hide
            for status in sorted({s.status for s in stretches}, key=lambda s: (s != _TRACKING, s)):
                style = f"run{number}" if status == _TRACKING else f"run{number}-faint" if status else "reference"
                chosen = [stretch for stretch in stretches if stretch.status == status]
                _add_lines(folder, status or kind, style, chosen, run.frame.geoid_separation_m or 0.0)
    folder = _add(document, "Folder")
    _add(folder, "name", "stations")
    for station in _stations(runs):
        placemark = _add(folder, "Placemark")
        _add(placemark, "name", station.name)
        _add_geometry(placemark, "Point", station.place[None], station.separation_m)
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True).decode("utf-8") + "\n"


def height_lines(runs: Sequence[MappedRun]) -> list[str]:
    """Return in a sentence for each kind what the heights of the KML are above."""
    lines = []
    for separation in dict.fromkeys(run.frame.geoid_separation_m for run in runs):
        of = [printable(run.series.name) for run in runs if run.frame.geoid_separation_m == separation]
        if separation is None:
            lines.append(f"{', '.join(of)}: {ABOVE_ELLIPSOID}")
        else:
            lines.append(
                f"{', '.join(of)}: heights are above sea level: those above the WGS 84 ellipsoid less {separation:g} "
                "m, the geoid separation that the session states"
            )
    return lines


def _add(parent: ElementTree.Element, tag: str, text: str | None = None) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, f"{{{_KML}}}{tag}")
    element.text = text
    return element


def _add_style(document: ElementTree.Element, name: str, colour: str, alpha: str, width_px: float) -> None:
    """Add a line style; KML's colours have alpha first and red last."""
    style = _add(document, "Style")
    style.set("id", name)
    line = _add(style, "LineStyle")
    red, green, blue = colour[:2], colour[2:4], colour[4:]
    _add(line, "color", f"{alpha}{blue}{green}{red}".lower())
    _add(line, "width", f"{width_px:g}")


def _add_lines(
    folder: ElementTree.Element, name: str, style: str, stretches: Sequence[MapStretch], separation_m: float
) -> None:
    """Add one placemark of all stretches."""
    placemark = _add(folder, "Placemark")
    _add(placemark, "name", name)
    first, last = stretches[0].t_s[0], stretches[-1].t_s[-1]
    _add(placemark, "description", f"{first:.2f} to {last:.2f} s of the session's time")
    _add(placemark, "styleUrl", f"#{style}")
    parts = _add(placemark, "MultiGeometry")
    for stretch in stretches:
        _add_geometry(parts, "Point" if len(stretch.t_s) == 1 else "LineString", stretch.places, separation_m)


def _add_geometry(parent: ElementTree.Element, kind: str, places: FloatArray, separation_m: float) -> None:
    geometry = _add(parent, kind)
    _add(geometry, "altitudeMode", "absolute")
    rows = [f"{lon:.{_DEGREES}f},{lat:.{_DEGREES}f},{height - separation_m:.{_METRES}f}" for lon, lat, height in places]
    _add(geometry, "coordinates", " ".join(rows))


# ---------------------------------------------------------------------------------------------- both
def _lines(run: MappedRun) -> Iterator[tuple[str, list[MapStretch]]]:
    """Yield a run's track and its references as stretches, each with its kind."""
    track = run.series.track
    if track.known.any():
        sigma = run.frame.sigma_enu_m(track.covariance_m2)
        yield "track", _stretches(run.frame, track.t_s, track.position_m, track.known, track.status, sigma)
    for name, reference in run.series.references.items():
        known = np.asarray(np.isfinite(reference.position_m).all(axis=1))
        if known.any():
            same = np.full(len(known), "", dtype=np.str_)
            yield name, _stretches(run.frame, track.t_s, reference.position_m, known, same, None)


def _stretches(
    frame: GeographicFrame,
    t_s: FloatArray,
    position_m: FloatArray,
    known: BoolArray,
    status: Any,
    sigma_m: FloatArray | None,
) -> list[MapStretch]:
    """Return the known positions, cut where one is missing and where the status changes."""
    places = np.full(position_m.shape, np.nan)
    places[known] = frame.places(position_m[known])
    changes = np.flatnonzero((status[1:] != status[:-1]) | (known[1:] != known[:-1])) + 1
    found = []
    for first, end in pairwise([0, *changes.tolist(), len(t_s)]):
        if not known[first]:
            continue
        # up to the first position of the next stretch, so that the line goes on
        part = slice(first, end + 1 if end < len(t_s) and known[end] else end)
        found.append(
            MapStretch(
                status=str(status[first]),
                t_s=t_s[part],
                places=places[part],
                sigma_m=None if sigma_m is None else sigma_m[part],
            )
        )
    return found


def _stations(runs: Sequence[MappedRun]) -> list[MappedStation]:
    """Return each station once: runs of one session have the same."""
    found: dict[tuple[Any, ...], MappedStation] = {}
    for run in runs:
        separation_m = run.frame.geoid_separation_m or 0.0
        for name, position in run.frame.stations_m.items():
            place = run.frame.places(position[None])[0]
            station = MappedStation(name=printable(name), place=place, separation_m=separation_m)
            found.setdefault((name, separation_m, *_coordinates(place)), station)
    return list(found.values())
