"""Segments of real clips without a cut, from a folder with segments.csv, boxes.csv and the clips.

Frames are numbered from 0 in the clip; boxes are x, y, w, h in px, loose, empty where the aircraft is absent.
"""

from dataclasses import dataclass
from pathlib import Path

from groundstation.arrays import ImageArray
from groundstation.bank.composites.clip_sets import set_of_clip
from groundstation.box import Box, box_of_size
from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable
from groundstation.files.output_names import below
from groundstation.simulation.world.world_sets import WorldSet
from groundstation.sources.video_file import VideoFile

_BOX_COLUMNS = ("x", "y", "w", "h")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClipSegment:
    """A segment of a clip that shows one scene.

    Attributes
    ----------
    clip : its name.
    path : its file.
    first, last : its frames, both included.
    boxes : the labelled box of the real aircraft in each frame, None where it is absent.
    """

    clip: str
    path: Path
    first: int
    last: int
    boxes: tuple[Box[float] | None, ...]


def read_segments(folder: Path, world_set: WorldSet) -> tuple[ClipSegment, ...]:
    """Return the segments of a set's clips that are in a folder, in the table's order.

    Raises `SessionError` where a table is damaged or the folder has no clip of the set.
    """
    boxes = _read_boxes(folder)
    table = CsvTable(folder / "segments.csv", ("clip", "first_frame", "last_frame"))
    found = []
    for row in table:
        clip = row.text["clip"].strip()
        if set_of_clip(clip) is not world_set:
            continue
        first, last = int(table.number(row, "first_frame")), int(table.number(row, "last_frame"))
        if not 0 <= first <= last:
            raise table.fault(
                row.line, got=f"frames {first} to {last}", wanted="0 or later, and a start before the end"
            )
        own = boxes.get(clip, {})
        segment = ClipSegment(
            clip=clip,
            path=below(folder, f"{clip}.mp4"),
            first=first,
            last=last,
            boxes=tuple(own.get(k) for k in range(first, last + 1)),
        )
        found.append(segment)
    if not found:
        raise SessionError(str(folder / "segments.csv"), got="no clip of this set", wanted=f"clips of {world_set}")
    return tuple(found)


def read_frames(segment: ClipSegment) -> tuple[ImageArray, ...]:
    """Decode the frames (h, w, 3) BGR of a segment.

    Raises `InputError` where the clip has not all of them.
    """
    frames = tuple(frame.image for frame in VideoFile(segment.path).frames(segment.first, segment.last))
    wanted = segment.last - segment.first + 1
    if len(frames) != wanted:
        where = f"{segment.path}: frames {segment.first} to {segment.last}"
        raise SessionError(where, got=f"{len(frames)} frames", wanted=f"{wanted}")
    return frames


def _read_boxes(folder: Path) -> dict[str, dict[int, Box[float]]]:
    """Return the labelled boxes by clip and frame."""
    table = CsvTable(folder / "boxes.csv", ("clip", "frame", *_BOX_COLUMNS))
    boxes: dict[str, dict[int, Box[float]]] = {}
    for row in table:
        if row.text["x"].strip():
            x, y, w, h = (table.number(row, name) for name in _BOX_COLUMNS)
            boxes.setdefault(row.text["clip"].strip(), {})[int(table.number(row, "frame"))] = box_of_size(x, y, w, h)
    return boxes
