"""Merging of several Rerun recordings into one, each under its own entity path."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr
from rerun.chunk import Chunk, RrdReader

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.viewer import entity_paths

# the aircraft has touched down when it has come as close to its lowest height
TOUCHDOWN_M = 0.5
# the nose of an aircraft that has landed is below this height
_LANDED_BELOW_M = 5.0
_PROPERTIES = "/__properties"
# columns of frame names, which a recording has for itself
_FRAME_COLUMNS = (
    *("Transform3D:child_frame", "Transform3D:parent_frame"),
    *("Pinhole:child_frame", "Pinhole:parent_frame"),
    "CoordinateFrame:frame",
)
_IMPLICIT = "tf#/"
# and of entities, which stand below its name
_ENTITY_COLUMNS = ("VideoFrameReference:video_reference",)


class RunAlignment(StrEnum):
    """The event that the runs are aligned by; NONE keeps each run's own time."""

    NONE = "none"
    START = "start"
    TOUCHDOWN = "touchdown"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedTrack:
    """The filter's track in a recording: ``t_s`` (n,) session time, ``position_runway_m`` (n, 3); n may be 0.

    ``span_s`` is the first and the last session time of anything, ``stations`` those that have a picture or an
    overlay; whether there are errors against a reference, and other plots.
    """

    t_s: FloatArray
    position_runway_m: FloatArray
    span_s: tuple[float, float]
    stations: tuple[str, ...]
    has_errors: bool
    has_plots: bool

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def start_s(self) -> float:
        """Return the first time at which there is an estimate; without any, that of anything."""
        return float(self.t_s[0]) if len(self) else self.span_s[0]

    @property
    def end_s(self) -> float:
        """Return the last time at which there is an estimate; without any, that of anything."""
        return float(self.t_s[-1]) if len(self) else self.span_s[1]

    @property
    def touchdown_s(self) -> float:
        """Return the first time at which the track is within `TOUCHDOWN_M` of its lowest height; else the start."""
        if not len(self):
            return self.start_s
        z = self.position_runway_m[:, 2]
        return float(self.t_s[np.flatnonzero(z <= z.min() + TOUCHDOWN_M)[0]])

    @property
    def touches_down(self) -> bool:
        """Return whether the track's lowest height is one that an aircraft on its wheels has."""
        return bool(len(self)) and float(self.position_runway_m[:, 2].min()) < _LANDED_BELOW_M

    def event_s(self, align: RunAlignment) -> float:
        """Return the run's own time of the event that all are put by."""
        return {RunAlignment.NONE: 0.0, RunAlignment.START: self.start_s, RunAlignment.TOUCHDOWN: self.touchdown_s}[
            align
        ]


def read_track(path: Path) -> RecordedTrack:
    """Read the track from a recording; raises `InputError` if it is damaged or of another format."""
    t_ns: list[np.ndarray] = []
    points: list[np.ndarray] = []
    spans_ns: list[tuple[int, int]] = []
    ours = False
    stations: dict[str, None] = {}
    has_errors = has_plots = False
    for chunk in chunks(path):
        entity = chunk.entity_path
        if entity.startswith("/cameras/"):
            stations[entity.split("/")[2]] = None
        ours |= entity.startswith((f"/{entity_paths.RUNWAY}", f"/{entity_paths.EKF}"))
        spans_ns += _span_ns(chunk)
        has_errors |= entity.startswith(f"/{entity_paths.ERROR}/")
        has_plots |= entity == f"/{entity_paths.PAIR_LATENCY}" and not chunk.is_static
        if entity == f"/{entity_paths.EKF}" and not chunk.is_static:
            rows = chunk.to_record_batch()
            if entity_paths.TIMELINE not in rows.schema.names or "Points3D:positions" not in rows.schema.names:
                continue
            column = rows.column("Points3D:positions")
            known = pc.greater(pc.list_value_length(column), 0).to_numpy(zero_copy_only=False)
            t_ns.append(rows.column(entity_paths.TIMELINE).cast(pa.int64()).to_numpy()[known])
            points.append(column.flatten().flatten().to_numpy().reshape(-1, 3))
    if not ours:
        raise InputError(str(path), got="no track in it and no runway", wanted="a recording of groundstation")
    t = np.concatenate([np.zeros(0, dtype=np.int64), *t_ns])
    xyz = np.concatenate([np.zeros((0, 3)), *points])
    order = np.argsort(t, kind="stable")
    return RecordedTrack(
        t_s=t[order] / 1e9,
        position_runway_m=xyz[order],
        span_s=(min((a for a, _ in spans_ns), default=0) / 1e9, max((b for _, b in spans_ns), default=0) / 1e9),
        stations=tuple(stations),
        has_errors=has_errors,
        has_plots=has_plots,
    )


def _span_ns(chunk: Chunk) -> list[tuple[int, int]]:
    """Return a list with a chunk's first and last session time; empty for a chunk without times."""
    if chunk.is_static:
        return []
    rows = chunk.to_record_batch()
    if entity_paths.TIMELINE not in rows.schema.names or not rows.num_rows:
        return []
    found = pc.min_max(rows.column(entity_paths.TIMELINE).cast(pa.int64()))
    return [(found["min"].as_py(), found["max"].as_py())]


def send_run(stream: rr.RecordingStream, path: Path, name: str, shift_s: float, *, runway: bool) -> None:
    """Send all of a recording under ``/name``, its times shifted by ``shift_s``; the runway only if ``runway``.

    The track's positions are sent once more as those of the run's name, whose colour is not the run's.
    """
    shift_ns = round(shift_s * 1e9)
    for chunk in chunks(path):
        if runway or not chunk.entity_path.startswith(f"/{entity_paths.RUNWAY}"):
            moved = _moved(chunk, name, shift_ns)
            stream.send_chunks(moved)
            if chunk.entity_path == f"/{entity_paths.EKF}" and not chunk.is_static:
                stream.send_chunks([one.with_entity_path(f"/{name}/{entity_paths.EKF_NAME}") for one in moved])


def _moved(chunk: Chunk, name: str, shift_ns: int) -> list[Chunk]:
    """Return rows under another path, with shifted times and renamed frames."""
    entity = f"/{name}{chunk.entity_path}".rstrip("/")
    rows = chunk.to_record_batch()
    named = [c for c in (*_FRAME_COLUMNS, *_ENTITY_COLUMNS) if c in rows.schema.names]
    if not named and (chunk.is_static or not shift_ns):
        return [chunk.with_entity_path(entity)]
    for column in named:
        rename = _entity if column in _ENTITY_COLUMNS else _frame
        rows = _replaced(rows, column, _renamed(rows.column(column), name, rename))
    if entity_paths.TIMELINE in rows.schema.names:
        times = rows.column(entity_paths.TIMELINE)
        rows = _replaced(rows, entity_paths.TIMELINE, pc.add(times.cast(pa.int64()), shift_ns).cast(times.type))
    # rows carry the path they had, which would win over one given here
    return [made.with_entity_path(entity) for made in Chunk.from_record_batch(rows)]


def _renamed(names: pa.Array, run: str, rename: Callable[[str, str], str]) -> pa.Array:
    rows = names.to_pylist()
    return pa.array([None if row is None else [rename(name, run) for name in row] for row in rows], type=names.type)


def _entity(entity: str, run: str) -> str:
    return f"/{run}{entity}"


def _frame(frame: str, run: str) -> str:
    """Return a frame's name with the run's before it; an entity's own frame keeps its form."""
    if frame.startswith(_IMPLICIT):
        return f"{_IMPLICIT}{run}/{frame.removeprefix(_IMPLICIT)}".rstrip("/")
    return f"{run}.{frame}"


def _replaced(rows: pa.RecordBatch, name: str, column: pa.Array) -> pa.RecordBatch:
    index = rows.schema.get_field_index(name)
    return rows.set_column(index, rows.schema.field(index), column)


def chunks(path: Path) -> Iterator[Chunk]:
    """Return what a file's first recording holds, without its properties; raises `InputError` if it is damaged."""
    try:
        with warnings.catch_warnings():
            # a cut file warns of its missing end before it fails, and the failure is reported below
            warnings.simplefilter("ignore")
            reader = RrdReader(path)
        stores = reader.recordings()
        if not stores:
            raise InputError(str(path), got="no recording in it", wanted="a Rerun recording (.rrd)")
        for chunk in reader.stream(store=stores[0]):
            if not chunk.entity_path.startswith(_PROPERTIES):
                yield chunk
    except (RuntimeError, ValueError, OSError) as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a Rerun recording (.rrd)") from fault
