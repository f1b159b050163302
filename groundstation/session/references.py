"""The two references of a session: DGPS fixes in their own clock, and a simulated session's exact truth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.text_file import TextFile, absence, is_other_kind
from groundstation.messages import DgpsFix
from groundstation.rig.rig import ClockModel
from groundstation.session.folder import Session
from groundstation.session.logs.gps_time import utc_text

DGPS_NAME = "dgps.csv"
# instead of it: a log as the receiver or the autopilot wrote it
LOG_NAMES = ("dgps.nmea", "dgps.pos", "dgps.ulg", "dgps.bin", "dgps.tlog", "dgps.ubx")
_DGPS_COLUMNS = ("t_s", "x_m", "y_m", "z_m")
_SIGMA_COLUMNS = ("sigma_x_m", "sigma_y_m", "sigma_z_m")
_MAX_REFERENCE_ROWS = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """Exact positions of the nose, and where each camera sees it.

    ``t_s`` (n,) session clock, ``position_runway_m`` (n, 3); by station ``pixels_px`` (n, 2) and ``visible``
    (n,); the pixel of a nose that is not visible is zero.
    """

    t_s: FloatArray
    position_runway_m: FloatArray
    pixels_px: dict[str, FloatArray]
    visible: dict[str, MaskArray]


def _raise(fault: SessionError) -> NoReturn:
    raise fault


def _pass_over(_: str) -> None:
    """Discard a note."""


def load_dgps(
    session: Session,
    on_fault: Callable[[SessionError], None] = _raise,
    on_note: Callable[[str], None] = _pass_over,
) -> tuple[DgpsFix, ...]:
    """Read dgps.csv or a log (dgps.nmea, dgps.pos, …), in the DGPS clock; empty if the session has no reference.

    ``on_fault`` is called with a fault and raises it by default; otherwise the rows before it are returned. ``on_note``
    is called with one line for each kind of unusable entry and each assumption. Raises `MissingExtraError` if a log
    needs a library that is not installed.
    """
    fixes: list[DgpsFix] = []
    try:
        _read_dgps(session, fixes, on_note)
    except SessionError as fault:
        on_fault(fault)
    else:
        if not fixes and (session.folder / DGPS_NAME).is_file():
            on_note(f"{DGPS_NAME}: no position in it: there is no DGPS to compare with")
    return tuple(fixes)


def _require_file_or_nothing(path: TextFile) -> None:
    if is_other_kind(path):
        raise SessionError(path.name, got=absence(path), wanted="a table of positions, or no such name")


def _read_dgps(session: Session, fixes: list[DgpsFix], on_note: Callable[[str], None]) -> None:
    path = session.folder / DGPS_NAME
    if not path.is_file():
        _require_file_or_nothing(path)
        logs = [name for name in LOG_NAMES if (session.folder / name).is_file()]
        if len(logs) > 1:
            raise SessionError(str(session.folder), got=" and ".join(logs), wanted="one log of positions")
        if logs:
            _read_log(session, session.folder / logs[0], fixes, on_note)
        return
    # the readers of logs use this package's tables
    from groundstation.session.logs.fixes import ReadingNotes
    from groundstation.session.logs.positions_table import has_positions

    header = CsvTable(path, [])
    if "x_m" not in header.columns and has_positions(header.columns):
        _read_log(session, path, fixes, on_note)
        return
    _read_table(session, path, fixes)
    notes = ReadingNotes(path.name)
    notes.note_unused(session.dgps.reading)
    for line in notes.lines():
        on_note(line)


def _read_log(session: Session, path: TextFile, fixes: list[DgpsFix], on_note: Callable[[str], None]) -> None:
    """Add the fixes of a log of latitudes and longitudes, in the session's frame."""
    from groundstation.session.logs.placement import midnight_before, place_log
    from groundstation.session.logs.read import read_log

    if not isinstance(path, Path):
        raise SessionError(str(path), got="a log inside a recording", wanted="dgps.csv there, or the log in a folder")
    origin = session.origin
    if origin is None:
        wanted = "[origin] in session.toml, where the session's frame lies on Earth"
        raise SessionError(path.name, got="latitudes and longitudes without an origin", wanted=wanted)
    log = read_log(path, session.dgps.reading)
    epoch = session.dgps.epoch_gps_s
    if epoch is None:
        epoch = midnight_before(log)
        on_note(f"{path.name}: t_s counts from {utc_text(epoch)}; epoch_utc in [dgps] would change that")
    for line in log.remarks:
        on_note(line)
    clock = session.clocks.get("dgps", ClockModel())
    place = (origin.lat_deg, origin.lon_deg, origin.height_m)
    fixes.extend(
        replace(fix, t_s=clock.session_from_device(fix.t_s))
        for fix in place_log(log, place, origin.y_axis_azimuth_deg, epoch)
    )


def _read_table(session: Session, path: TextFile, fixes: list[DgpsFix]) -> None:
    table = CsvTable(path, _DGPS_COLUMNS)
    clock = session.clocks.get("dgps", ClockModel())
    given = [c for c in _SIGMA_COLUMNS if c in table.columns]
    if given and len(given) < len(_SIGMA_COLUMNS):
        raise table.fault(1, got=", ".join(given), wanted="all of " + ", ".join(_SIGMA_COLUMNS) + ", or none")
    before: float | None = None
    for row in table:
        before = table.advance(row, "t_s", before)
        fixes.append(
            DgpsFix(
                t_s=clock.session_from_device(before),
                position_runway_m=np.array([table.number(row, c) for c in _DGPS_COLUMNS[1:]]),
                sigma_m=_sigma(table, row) if given else None,
                status=row.text.get("status", "").strip(),
            )
        )
        if len(fixes) > _MAX_REFERENCE_ROWS:
            raise table.fault(row.line, got="more rows", wanted=f"at most {_MAX_REFERENCE_ROWS}")


def _sigma(table: CsvTable, row: Row) -> FloatArray | None:
    """Return one sigma per axis (3,) in m; None where the row has none."""
    sigmas = [table.optional_number(row, c) for c in _SIGMA_COLUMNS]
    known = [s for s in sigmas if s is not None]
    if not known:
        return None
    if min(known) <= 0:
        raise table.fault(row.line, got=f"a sigma of {min(known):g} m", wanted="sigmas > 0")
    if len(known) < len(sigmas):
        raise table.fault(row.line, got=f"{len(known)} sigmas", wanted="three, or three empty cells")
    return np.array(known)


def load_truth(
    session: Session,
    on_fault: Callable[[SessionError], None] = _raise,
    on_note: Callable[[str], None] = _pass_over,
) -> Truth | None:
    """Read truth.csv if there is one; faults and notes go to ``on_fault`` and ``on_note`` as in `load_dgps`."""
    path = session.folder / "truth.csv"
    if not path.is_file() and not is_other_kind(path):
        return None
    rows: list[tuple[float, ...]] = []
    names: list[str] = []
    try:
        _require_file_or_nothing(path)
        table = CsvTable(path, _DGPS_COLUMNS)
        names = [n for n in session.rig.names if _has_pixels(table, n)]
        _read_truth(table, session.clocks.get("truth", ClockModel()), names, rows)
    except SessionError as fault:
        on_fault(fault)
    else:
        if not rows:
            on_note(f"{path.name}: no position in it: there is no truth to compare with")
    if not rows:
        return None
    values = np.array(rows)
    pixels = {n: values[:, 4 + 2 * i : 6 + 2 * i] for i, n in enumerate(names)}
    visible = {n: np.isfinite(p).all(axis=1) for n, p in pixels.items()}
    return Truth(
        t_s=values[:, 0],
        position_runway_m=values[:, 1:4],
        pixels_px={n: np.where(visible[n][:, None], p, 0.0) for n, p in pixels.items()},
        visible=visible,
    )


def _has_pixels(table: CsvTable, name: str) -> bool:
    """Return whether the table has a station's pixels; half of a pixel is a fault."""
    u, v = f"{name}_u_px" in table.columns, f"{name}_v_px" in table.columns
    if u is not v:
        raise table.fault(1, got=f"only one of {name}_u_px and {name}_v_px", wanted="both, or neither")
    return u


def _read_truth(table: CsvTable, clock: ClockModel, names: Sequence[str], rows: list[tuple[float, ...]]) -> None:
    """Add a row of time, position and by station u, v for each line; NaN in here where a nose is not visible."""
    before: float | None = None
    for row in table:
        before = table.advance(row, "t_s", before)
        point = [table.number(row, c) for c in _DGPS_COLUMNS[1:]]
        cells = [table.optional_number(row, f"{n}_{axis}_px") for n in names for axis in "uv"]
        for n, u, v in zip(names, cells[::2], cells[1::2], strict=True):
            if (u is None) is not (v is None):
                raise table.fault(row.line, got=f"only one of {n}_u_px and {n}_v_px", wanted="both, or neither")
        t_s = clock.session_from_device(before)
        rows.append((t_s, *point, *(np.nan if c is None else c for c in cells)))
        if len(rows) > _MAX_REFERENCE_ROWS:
            raise table.fault(row.line, got="more rows", wanted=f"at most {_MAX_REFERENCE_ROWS}")
