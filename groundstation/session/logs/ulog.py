"""PX4's ULog: the receiver's own positions (not the estimator's), read by pyulog."""

import contextlib
import io
import math
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import LogError, MissingExtraError
from groundstation.files.toml_table import shown
from groundstation.session.logs.fixes import (
    FixQuality,
    Heights,
    LogFix,
    LogOptions,
    ReadingNotes,
    plausible,
    usable_sigma,
)
from groundstation.session.logs.gps_time import TimeScale, civil_from_unix

# the autopilot's primary source first: drivers wrote it themselves before sensor_gps was introduced
TOPICS = ("vehicle_gps_position", "sensor_gps")
_QUALITY = {3: FixQuality.SINGLE, 4: FixQuality.DGPS, 5: FixQuality.FLOAT, 6: FixQuality.FIX}
_OLD_DEGREE = 1e-7
_PER_MM = 1e-3
_MAX_BYTES = 2_000_000_000
# of all topics of a log, arrays taken apart: PX4's have some ten thousand
_MAX_FIELDS = 200_000
# limit of the bytes read, in file sizes: pyulog reads a damaged section again byte by byte
_READ_BYTES, _READ_RATIO = 1 << 24, 16


def read_ulog(path: Path, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Read the positions of a ULog. Raises `LogError` where there is no topic of positions."""
    try:
        from pyulog import ULog
    except ImportError as error:
        raise MissingExtraError("reading ULog", "logs") from error
    if path.stat().st_size > _MAX_BYTES:
        raise LogError(path.name, got="a larger file", wanted=f"at most {_MAX_BYTES} bytes of ULog")
    reported = io.StringIO()
    try:
        # opened here: pyulog leaves its own file open after an error
        with path.open("rb") as stream, contextlib.redirect_stdout(reported), contextlib.redirect_stderr(reported):
            size = path.stat().st_size
            log = _bounded(ULog)(_ForwardReader(stream, size), list(TOPICS), disable_str_exceptions=True)
    except Exception as error:
        got = f"no ULog that pyulog reads ({shown(f'{type(error).__name__}: {error}', 120)})"
        raise LogError(path.name, got=got, wanted="a ULog of PX4") from error
    if log.file_corruption:
        remarks.note("the file is damaged; what pyulog could still read is used")
    for drop in log.dropouts:
        remarks.count("stretch that the logger dropped", f"{1e-6 * drop.timestamp:.1f} s after boot")
    data = _chosen(path, log, options)
    remarks.used.add("instance")
    return _fixes(path, data.data, options, remarks)


class _OversizedLogError(Exception):
    """A log that requests far more than its size."""


def _bounded(log_class: Any) -> Any:
    """Return pyulog's class, restricted against nested arrays that expand a few bytes to a large format."""
    fields = 0

    class Added(log_class._MessageAddLogged):  # type: ignore[misc]
        def _parse_nested_type(self, prefix: str, name: str, formats: Any) -> None:
            nonlocal fields
            fields += 1 + sum(max(count, 1) for _, count, _ in formats[name].fields)
            if fields > _MAX_FIELDS:
                raise _OversizedLogError(f"more than {_MAX_FIELDS} fields")
            super()._parse_nested_type(prefix, name, formats)

    class Bounded(log_class):  # type: ignore[misc]
        _MessageAddLogged = Added

    return Bounded


class _ForwardReader:
    """A file whose position advances by all requested bytes, beyond its end too, so that nothing is read repeatedly.

    pyulog seeks back by a message's whole length after reading the available part of it: where a damaged length reaches
    beyond the end it would return to the same place, or an earlier one, without end.
    """

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream = stream
        self._left = _READ_BYTES + _READ_RATIO * size
        self.seek, self.tell, self.close = stream.seek, stream.tell, stream.close

    def read(self, size: int = -1) -> bytes:
        """Return up to ``size`` bytes; missing ones are skipped."""
        data = self._stream.read(size)
        self._left -= len(data)
        if self._left < 0:
            raise _OversizedLogError("damaged all over")
        if len(data) < size:
            self._stream.seek(size - len(data), io.SEEK_CUR)
        return data


def _chosen(path: Path, log: Any, options: LogOptions) -> Any:
    """Return the topic to read: the autopilot's choice, or the receiver asked for."""
    topics = TOPICS if options.instance is None else TOPICS[::-1]
    for name in topics:
        found = sorted((d for d in log.data_list if d.name == name), key=lambda d: d.multi_id)
        for data in found:
            if options.instance in (None, data.multi_id) and len(data.data.get("timestamp", ())):
                return data
    had = sorted({f"{d.name}[{d.multi_id}]" for d in log.data_list})
    which = "" if options.instance is None else f" of instance {options.instance}"
    raise LogError(
        path.name, got=", ".join(had[:6]) or "no positions", wanted=f"the topic {' or '.join(TOPICS)}{which}"
    )


def _fixes(path: Path, data: dict[str, Any], options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Return the usable rows of a topic."""
    n = len(data["timestamp"])
    unix = _column(data, "time_utc_usec", n) * 1e-6
    kind = _column(data, "fix_type", n)
    places = _places(path, data, n, Heights(path, options))
    eph, epv = _column(data, "eph", n), _column(data, "epv", n)
    fixes = []
    for k in range(n):
        where = f"row {k}"
        quality = _QUALITY.get(int(kind[k])) if math.isfinite(kind[k]) else None
        if quality is None:
            remarks.count("row without a 3-D fix", where)
            continue
        # a receiver that does not know the time yet writes 0, or a time in 1980
        if not unix[k] > 1e9:
            remarks.count("row without UTC", where)
            continue
        day, second = civil_from_unix(float(unix[k]))
        horizontal = float(eph[k]) / math.sqrt(2.0)
        fix = LogFix(
            day=day,
            second=second,
            scale=TimeScale.UTC,
            lat_deg=float(places[k, 0]),
            lon_deg=float(places[k, 1]),
            height_m=float(places[k, 2]),
            quality=quality,
            sigma_enu_m=usable_sigma(horizontal, horizontal, float(epv[k])),
        )
        if plausible(fix):
            fixes.append(fix)
        else:
            remarks.count("row that is no place on Earth", where)
    return fixes


def _places(path: Path, data: dict[str, Any], n: int, heights: Heights) -> FloatArray:
    """Return latitude, longitude in degrees and ellipsoid height in m, (n, 3); by name, since the units changed."""
    if "latitude_deg" in data:
        lat, lon = _column(data, "latitude_deg", n), _column(data, "longitude_deg", n)
        ellipsoid, sea = _column(data, "altitude_ellipsoid_m", n), _column(data, "altitude_msl_m", n)
    else:
        lat, lon = _column(data, "lat", n) * _OLD_DEGREE, _column(data, "lon", n) * _OLD_DEGREE
        ellipsoid, sea = _column(data, "alt_ellipsoid", n) * _PER_MM, _column(data, "alt", n) * _PER_MM
    known = np.isfinite(ellipsoid)
    # a driver that does not know the ellipsoid height leaves 0 in every row
    if n and not np.any(ellipsoid[known] != 0.0) and np.any(sea[np.isfinite(sea)] != 0.0):
        ellipsoid = sea + heights.ellipsoid(0.0, None)
    return np.column_stack([lat, lon, ellipsoid])


def _column(data: dict[str, Any], name: str, n: int) -> FloatArray:
    """Return a column as numbers (n,), NaN in here where the log does not have it."""
    values = data.get(name)
    if values is None or np.shape(values) != (n,):
        return np.full(n, np.nan)
    try:
        # a damaged log's numbers may not be finite
        with np.errstate(invalid="ignore"):
            return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.full(n, np.nan)
