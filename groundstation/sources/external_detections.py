"""detections.csv: pixels of an external detector, as events."""

import heapq
import math
from array import array
from collections.abc import Iterator, Mapping

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted
from groundstation.messages import Epoch, Event, PixelMeasurement
from groundstation.session import Session
from groundstation.session.folder import detections_table
from groundstation.sources.row_times import RowTimes

_SIGMAS = ("sigma_u_px", "sigma_v_px")
# of a pixel: session time, u, v and the sigmas
_COLUMNS = 5
# cameras that are started or lost by hand one after the other, or a detector that misses some frames, are not worth a
# note; the time is `camera_gaps`'
_HOLE_S, _LISTED_HOLES = 2.0, 3


def read_detections(session: Session) -> tuple[dict[str, FloatArray], SessionError | None]:
    """Read detections.csv: by station an array (n, 5), and the fault that ended it, if any.

    Columns are session time, u, v and one sigma of u and of v, which are not numbers where the table has none. Stations
    may come one after the other or mixed; each one's own times must grow. Where one goes back because the one before is
    far ahead, that one is left out, too.
    """
    table = detections_table(session)
    clocks = {s.name: session.camera_clock(s) for s in session.rig.stations}
    found = {n: array("d") for n in session.rig.names}
    newest = {n: RowTimes() for n in session.rig.names}
    fault = None
    try:
        for row in table:
            name = row.text["station"].strip()
            if name in session.left_out:
                continue
            if name not in found:
                raise table.fault(row.line, got=f"station {quoted(name)}", wanted="one of " + ", ".join(found))
            t = table.number(row, "t_s")
            if newest[name].is_ahead_of(t):
                del found[name][-_COLUMNS:]
            table.check_later(row, "t_s", t, newest[name].newest_s)
            u, v = table.number(row, "u_px"), table.number(row, "v_px")
            newest[name].add(t)
            found[name].extend((clocks[name].session_from_device(t), u, v, *_sigma(table, row)))
    except SessionError as error:
        fault = error
    return {n: np.array(rows, dtype=np.float64).reshape(-1, _COLUMNS) for n, rows in found.items()}, fault


def _sigma(table: CsvTable, row: Row) -> tuple[float, float]:
    """Return one sigma of u and of v, not a number where the row has none."""
    u, v = (table.optional_number(row, name) if name in table.columns else None for name in _SIGMAS)
    if u is None and v is None:
        return math.nan, math.nan
    if u is None or v is None or min(u, v) <= 0.0:
        got = ", ".join(f"{name} = {row.text.get(name, '').strip() or 'empty'}" for name in _SIGMAS)
        raise table.fault(row.line, got=got, wanted="both > 0, or both empty")
    return u, v


def rowless_notes(labels: Mapping[str, FloatArray], leader: str) -> list[str]:
    """Return notes on stretches in which others have pixels and station ``leader``, at whose stamps rows are, has none.

    The rows of the result are those of one station (docs/formats.md), so that what others see there is in none.
    """
    own_s = labels[leader][:, 0]
    others_s = np.sort(np.concatenate([rows[:, 0] for name, rows in labels.items() if name != leader] or [own_s]))
    edges_s = np.concatenate([[min(own_s[0], others_s[0])], own_s, [max(own_s[-1], others_s[-1])]])
    notes = []
    for k in np.flatnonzero(np.diff(edges_s) > _HOLE_S):
        from_s, to_s = edges_s[k], edges_s[k + 1]
        count = np.searchsorted(others_s, to_s) - np.searchsorted(others_s, from_s, "right")
        if count:
            notes.append(f"{from_s:.1f} to {to_s:.1f} s ({count} pixels of others)")
    if not notes:
        return []
    more = f" and {len(notes) - _LISTED_HOLES} more" if len(notes) > _LISTED_HOLES else ""
    listed = ", ".join(notes[:_LISTED_HOLES]) + more
    return [
        f"{leader}: without a pixel {listed}: the track has rows at its stamps alone; "
        "to have them there, list a station that has pixels first in rig.toml"
    ]


def detection_events(labels: Mapping[str, FloatArray], leader: str) -> Iterator[tuple[float, Event]]:
    """Yield the pixels in order of time, each with that time, and an epoch at each stamp of station ``leader``.

    ``labels`` has columns as `read_detections` returns them, those of sigma may be missing.
    An epoch follows all pixels with its own time, of every station.
    """
    epochs = labels[leader][:, 0]
    streams = [_station_labels(name, rows, epochs) for name, rows in labels.items()]
    due: Epoch | None = None
    for t, event in heapq.merge(*streams, key=lambda item: item[0]):
        if due is not None and t > due.t_s:
            yield due.t_s, due
            due = None
        yield t, event
        if event.station == leader:
            due = Epoch(t_s=t, epoch=event.epoch, stations=tuple(labels))
    if due is not None:
        yield due.t_s, due


def _station_labels(name: str, rows: FloatArray, epochs: FloatArray) -> Iterator[tuple[float, PixelMeasurement]]:
    """Yield one station's pixels, each in the epoch at or after it."""
    numbers = np.minimum(np.searchsorted(epochs, rows[:, 0]), len(epochs) - 1)
    for number, (t, u, v, *sigma) in zip(numbers, rows.tolist(), strict=True):
        known = (sigma[0], sigma[1]) if sigma and not math.isnan(sigma[0]) else None
        yield t, PixelMeasurement(t_s=t, station=name, epoch=int(number), u_px=u, v_px=v, sigma_px=known)
