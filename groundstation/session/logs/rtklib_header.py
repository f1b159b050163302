"""The comment lines of an RTKLIB solution file: which columns, which time, which heights, where the base is."""

import re
from dataclasses import dataclass, replace

from groundstation.errors import LogError
from groundstation.files.toml_table import shown

_TIMES = ("GPST", "UTC", "JST")
_PLACES = (
    ("latitude", "longitude", "height"),
    ("x-ecef", "y-ecef", "z-ecef"),
    ("e-baseline", "n-baseline", "u-baseline"),
)
_LLH = (*_PLACES[0], "Q", "ns", "sdn", "sde", "sdu", "sdne", "sdeu", "sdun", "age", "ratio")
_XYZ = (*_PLACES[1], "Q", "ns", "sdx", "sdy", "sdz", "sdxy", "sdyz", "sdzx", "age", "ratio")
_VELOCITY = ("vn", "ve", "vu", "sdvn", "sdve", "sdvu", "sdvne", "sdveu", "sdvun")
_COLUMN = re.compile(r"([A-Za-z][A-Za-z0-9_-]*)(\([^)]*\))?")
_REFERENCE = re.compile(r"%\s*ref pos\s*:\s*(.*)")
_MAX_COLUMNS = 60
_EARTH_M = 1e5


@dataclass(frozen=True, slots=True)
class PosLayout:
    """Layout from the header so far: names after the time, the number of cells of each, time, heights, base."""

    columns: tuple[str, ...] = ()
    parts: tuple[int, ...] = ()
    time_system: str = "GPST"
    geodetic: bool = False
    base_deg_m: tuple[float, float, float] | None = None

    @property
    def row_tokens(self) -> int:
        """How many cells a row has; a time takes two."""
        return 2 + sum(self.parts)


def read_header_line(line: str, layout: PosLayout, where: str) -> PosLayout:
    """Return the layout with what one comment line adds. Raises `LogError` for a datum that is not WGS 84."""
    text = line.strip()
    words = text.lstrip("%").replace(",", " ").replace(";", " ").split()
    if words and words[0] in _TIMES:
        return _columns(text, layout, words[0], where)
    datum = re.search(r"\((?:lat/lon/height|x/y/z-ecef|e/n/u-baseline)=([^,)]*)", text)
    if datum:
        name, _, heights = datum[1].partition("/")
        if name.strip().upper() not in ("WGS84", "ITRF", ""):
            raise LogError(where, got=f"the datum {shown(name.strip())}", wanted="WGS84")
        return replace(layout, geodetic=heights.strip().lower() in ("geodetic", "geoid", "msl"))
    reference = _REFERENCE.fullmatch(text)
    return replace(layout, base_deg_m=_base(reference[1])) if reference else layout


def _columns(text: str, layout: PosLayout, time_system: str, where: str) -> PosLayout:
    """Return the layout with the columns of the line that names them."""
    found = _COLUMN.findall(text.split(time_system, 1)[1])[:_MAX_COLUMNS]
    names = tuple(name for name, _ in found)
    if names[:3] not in _PLACES or len(set(names)) < len(names):
        wanted = "latitude longitude height, x-ecef …, or e-baseline … first, each once"
        raise LogError(where, got=f"columns {shown(' '.join(names[:8]))}", wanted=wanted)
    parts = tuple(3 if unit == "(d'\")" else 1 for _, unit in found)
    for name, unit in found[:3]:
        if unit not in ("(deg)", "(d'\")", "(m)"):
            raise LogError(where, got=f"{name} in {shown(unit or 'no unit')}", wanted="(deg), (d'\") or (m)")
    return replace(layout, columns=names, parts=parts, time_system=time_system)


def _base(text: str) -> tuple[float, float, float] | None:
    """Return the base of a 'ref pos' line, in decimal degrees; None where it is written in another way."""
    try:
        numbers = [float(word) for word in re.split(r"[\s,;]+", text.strip())]
    except ValueError:
        return None
    if len(numbers) == 9:
        raise_sign = -1.0 if text.strip().startswith("-") else 1.0
        lat = raise_sign * (abs(numbers[0]) + numbers[1] / 60 + numbers[2] / 3600)
        east = -1.0 if str(re.split(r"[\s,;]+", text.strip())[3]).startswith("-") else 1.0
        numbers = [lat, east * (abs(numbers[3]) + numbers[4] / 60 + numbers[5] / 3600), numbers[6]]
    if len(numbers) != 3 or not (abs(numbers[0]) <= 90 and abs(numbers[1]) <= 360 and abs(numbers[2]) < _EARTH_M):
        return None
    return numbers[0], numbers[1], numbers[2]


def layout_of_row(tokens: list[str]) -> PosLayout | None:
    """Return the default layout that a row without a header fits, by how many cells it has and how large they are."""
    try:
        first = [abs(float(word)) for word in tokens[2:5]]
    except ValueError:
        return None
    names = _XYZ if len(first) == 3 and max(first) > _EARTH_M else _LLH
    for columns in (names, (*names, *_VELOCITY)):
        if len(tokens) == 2 + len(columns):
            return PosLayout(columns=columns, parts=(1,) * len(columns))
    if names is _LLH and len(tokens) == 2 + len(_LLH) + 4:
        return PosLayout(columns=_LLH, parts=(3, 3, *(1,) * (len(_LLH) - 2)))
    return None
