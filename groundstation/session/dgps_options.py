"""The [dgps] table of session.toml: information missing from a log of positions, and the zero of its clock."""

import datetime
from dataclasses import dataclass, field

from groundstation.errors import InputError
from groundstation.files.toml_table import TomlTable, quoted
from groundstation.session.logs.fixes import LogOptions
from groundstation.session.logs.gps_time import gps_from_datetime, gps_from_text

_KEYS = {"epoch_utc", "date", "height", "geoid_separation_m", "base", "instance"}


@dataclass(frozen=True, slots=True, kw_only=True)
class DgpsOptions:
    """How a log is read, and ``epoch_gps_s``, the GPS time of zero of the DGPS clock; None for midnight before it."""

    reading: LogOptions = field(default_factory=LogOptions)
    epoch_gps_s: float | None = None


def parse_dgps(table: TomlTable) -> DgpsOptions:
    """Read the table; raises the table's error for a key or value that is not known."""
    table.refuse_unknown(_KEYS)
    base = table.vector("base", 3) if "base" in table else None
    if base is not None and (abs(base[0]) > 90 or abs(base[1]) > 360):
        raise table.fail("base", quoted(base.tolist()), "latitude and longitude in degrees, ellipsoid height in m")
    instance = table.number("instance", minimum=0, maximum=15) if "instance" in table else None
    if instance is not None and not instance.is_integer():
        raise table.fail("instance", quoted(instance), "a whole number")
    reading = LogOptions(
        date=_date(table) if "date" in table else None,
        height=table.choice("height", ("ellipsoid", "sea level")) if "height" in table else None,
        geoid_separation_m=(
            table.number("geoid_separation_m", minimum=-200.0, maximum=200.0) if "geoid_separation_m" in table else None
        ),
        base_deg_m=None if base is None else (float(base[0]), float(base[1]), float(base[2])),
        instance=None if instance is None else int(instance),
    )
    return DgpsOptions(reading=reading, epoch_gps_s=_epoch(table) if "epoch_utc" in table else None)


def _date(table: TomlTable) -> datetime.date:
    value = table.values["date"]
    if isinstance(value, datetime.date) and not isinstance(value, datetime.datetime) and value.year >= 1980:
        return value
    raise _wrong(table, "date", "a date such as 2026-05-17, of 1980 or later")


def _epoch(table: TomlTable) -> float:
    value = table.values["epoch_utc"]
    if isinstance(value, datetime.datetime) and 1980 < value.year < 9999:
        return gps_from_datetime(value)
    found = gps_from_text(value) if isinstance(value, str) else None
    if found is None:
        raise _wrong(table, "epoch_utc", "a time such as 2026-05-17T09:30:00Z, of 1981 or later")
    return found


def _wrong(table: TomlTable, key: str, wanted: str) -> InputError:
    return table.fail(key, quoted(str(table.values[key])), wanted)
