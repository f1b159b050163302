"""The two references of a session: DGPS fixes in their own clock, and a simulated session's exact truth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import SessionError
from groundstation.messages import DgpsFix
from groundstation.rig import ClockModel
from groundstation.session.folder import Session
from groundstation.session.tables import CsvTable, Row

UNREAD_REFERENCES = ("dgps.nmea", "dgps.pos", "dgps.ulg", "dgps.bin")
_DGPS_COLUMNS = ("t_s", "x_m", "y_m", "z_m")
_SIGMA_COLUMNS = ("sigma_x_m", "sigma_y_m", "sigma_z_m")
_WANTED_DGPS = "dgps.csv with t_s, x_m, y_m, z_m and optionally sigma_x_m, sigma_y_m, sigma_z_m, status"
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


def load_dgps(session: Session, on_fault: Callable[[SessionError], None] = _raise) -> tuple[DgpsFix, ...]:
    """Read dgps.csv, in the DGPS clock; empty if the session has no reference.

    A fault is given to ``on_fault``, which raises it by default; where it does not, the rows before count.
    """
    fixes: list[DgpsFix] = []
    try:
        _read_dgps(session, fixes)
    except SessionError as fault:
        on_fault(fault)
    return tuple(fixes)


def _read_dgps(session: Session, fixes: list[DgpsFix]) -> None:
    path = session.folder / "dgps.csv"
    if not path.is_file():
        for name in UNREAD_REFERENCES:
            if (session.folder / name).is_file():
                raise SessionError(name, got="a format that is not read yet", wanted=_WANTED_DGPS)
        return
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


def load_truth(session: Session, on_fault: Callable[[SessionError], None] = _raise) -> Truth | None:
    """Read truth.csv if there is one; faults go to ``on_fault`` as in `load_dgps`."""
    path = session.folder / "truth.csv"
    if not path.is_file():
        return None
    rows: list[tuple[float, ...]] = []
    names: list[str] = []
    try:
        table = CsvTable(path, _DGPS_COLUMNS)
        names = [n for n in session.rig.names if _has_pixels(table, n)]
        _read_truth(table, session.clocks.get("truth", ClockModel()), names, rows)
    except SessionError as fault:
        on_fault(fault)
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
