"""The table of `groundstation track`: one row for each frame, written as it comes.

Each row is flushed as a whole line, so that what an interrupted run leaves behind is readable to its last frame.
"""

import math
from pathlib import Path
from types import TracebackType

from groundstation.detection.pixel_track import PixelTrack
from groundstation.errors import InputError, os_words
from groundstation.files.line_file import LineFile
from groundstation.messages import Detection

PIXEL_TRACK_COLUMNS = ("frame", "t_s", "u_px", "v_px", "x_px", "y_px", "w_px", "h_px", "status")


class PixelTrackFile:
    """Write a track in pixels to ``path``; an older file is replaced.

    Raises `InputError` if it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = LineFile(path)
        except OSError as fault:
            raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault
        self._file.write(",".join(PIXEL_TRACK_COLUMNS) + "\n")
        self._file.flush()

    def __enter__(self) -> "PixelTrackFile":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._file.close()

    def write(self, index: int, track: PixelTrack) -> None:
        """Append the row of frame number ``index``."""
        self._file.write(",".join([str(index), *_cells(track)]) + "\n")
        self._file.flush()


def _cells(track: PixelTrack) -> list[str]:
    """Return the cells of a row after its number; without a detection there is no point and no box."""
    cells = [f"{track.t_s:.6f}"]
    if isinstance(track.result, Detection):
        found = track.result
        cells += [
            f"{v:.3f}" if math.isfinite(v) else ""
            for v in (found.u_px, found.v_px, found.box.x0, found.box.y0, *found.box.size)
        ]
    else:
        cells += [""] * 6
    return [*cells, track.status.value]
