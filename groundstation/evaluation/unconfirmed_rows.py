"""Rows of camera reports that may still change: of frames of a search, and of tracks that are not confirmed yet.

A tracker that reports confirmed tracks only, as is usual, has to wait with the pixels as it does with the estimates.
Those of a track that was displaced by a better one before it was confirmed are no detections of the target, unless the
better one's pixels are within the same silhouettes: it may have had a wrong range only, or have stood. Frames in which
the better one has no pixel are judged by the same camera's others: where most agree, it showed the same target. Frames
of what was another thing become frames of a search, for which the better one may have initial pixels. Pixels of a track
that was dropped stay: it may have been the target, and found again.
"""

import math
from collections import Counter, deque
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from groundstation.box import Box
from groundstation.messages import (
    INITIAL_PIXELS_S,
    CameraReport,
    Detection,
    InitialPixel,
    Miss,
    MissReason,
    OutcomeKind,
    StepReport,
)

Row = TypeVar("Row")

_NOT_LOOKED_AT = frozenset(
    (
        *(MissReason.LATE, MissReason.NO_PTU_ANGLE, MissReason.NOT_RECORDED, MissReason.DETECTION_FAILED),
        MissReason.OTHER_PICTURE_SIZE,
    )
)
# chosen: a track has pixels as near in time, of frames that are searched by turns, where it is said to have been
_NEAR_S = 0.3
# frames of a camera by which its others are judged, at least; chosen
_LEAST_VOTES = 3


@dataclass(slots=True)
class _Pending(Generic[Row]):
    """A row, its time and station, whether its frame was searched, the number of its track, the silhouette's box.

    ``is_initial``: it has an initial pixel, of which no silhouette is known.
    """

    t_s: float
    station: str
    row: Row
    searched: bool
    track_id: int | None
    box: Box[float] | None
    is_initial: bool = False


class _PixelPath:
    """Where a track was in one camera, by its pixels there."""

    def __init__(self, station: str, pixels: Sequence[InitialPixel]) -> None:
        own = sorted((pixel for pixel in pixels if pixel.station == station), key=lambda pixel: pixel.t_s)
        self._times, self._u, self._v = np.array([(pixel.t_s, pixel.u_px, pixel.v_px) for pixel in own]).T

    def is_within(self, box: Box[float], t_s: float) -> bool | None:
        """Return whether the track was within a silhouette's box at a time; None where it has no pixel near it."""
        if float(np.abs(self._times - t_s).min()) > _NEAR_S:
            return None
        u, v = np.interp(t_s, self._times, self._u), np.interp(t_s, self._times, self._v)
        return bool(box.x0 <= u <= box.x1 and box.y0 <= v <= box.y1)


class UnconfirmedRows(Generic[Row]):
    """The last rows of a table of camera reports, in their order, until nothing can change them.

    ``Row`` is what the caller finds a row by. A row is final once a track is confirmed or its own one dropped, or after
    `INITIAL_PIXELS_S` of session time.
    """

    def __init__(self) -> None:
        self._rows: deque[_Pending[Row]] = deque()
        self._newest_s = -math.inf
        self._confirmed_id: int | None = None

    def __len__(self) -> int:
        return len(self._rows)

    def take(self, report: StepReport, rows: Sequence[Row]) -> list[tuple[Row, InitialPixel | None]]:
        """Add the ``rows`` of a report's cameras; return the changes, in order.

        A row gets a pixel of a track that was found later, or, with None, loses what its track has had in it.
        """
        for camera, row in zip(report.cameras, rows, strict=True):
            self._add(camera, row)
        times = (*(c.t_s for c in report.cameras), *(e.t_s for e in report.estimates), *(s.t_s for s in report.states))
        self._newest_s = max((self._newest_s, *times))
        displaced = {each.track_id for each in report.outcomes if each.kind is OutcomeKind.DISPLACED}
        pixels = [pixel for pixel in report.initial_pixels if pixel.track_id not in displaced]
        changes = self._withdraw(displaced, pixels) if displaced else []
        changes += self._fill(pixels) if pixels else []
        if any(isinstance(c.result, Detection) and c.track_id is None for c in report.cameras):
            # of a source that has no tracks: there is nothing to wait for
            self._release()
        for each in report.outcomes:
            if each.kind is OutcomeKind.CONFIRMED:
                self._confirmed_id = each.track_id
                self._release()
            elif each.kind is OutcomeKind.DROPPED:
                self._keep(each.track_id)
        return changes

    def final(self) -> Iterator[Row]:
        """Yield the rows that nothing can change any more, oldest first; each is forgotten once it has been used."""
        while self._rows and self._is_final(self._rows[0]):
            yield self._rows[0].row
            self._rows.popleft()

    def rest(self) -> Iterator[Row]:
        """Yield all rows as they are, at the end, likewise."""
        while self._rows:
            yield self._rows[0].row
            self._rows.popleft()

    def _add(self, camera: CameraReport, row: Row) -> None:
        result = camera.result
        box = result.box if isinstance(result, Detection) else None
        reason = result.reason if isinstance(result, Miss) else None
        # where no picture was looked at, no track changes what is reported
        track_id = None if reason in _NOT_LOOKED_AT else camera.track_id
        searched = reason is MissReason.NOT_ACQUIRED
        self._rows.append(_Pending(camera.t_s, camera.station, row, searched, track_id, box))

    def _release(self) -> None:
        """Make all rows so far final."""
        for pending in self._rows:
            pending.searched, pending.track_id = False, None

    def _keep(self, track_id: int) -> None:
        """Make the rows of a track final."""
        for pending in self._rows:
            if pending.track_id == track_id:
                pending.track_id = None

    def _withdraw(
        self, tracks: Collection[int], pixels: Sequence[InitialPixel]
    ) -> list[tuple[Row, InitialPixel | None]]:
        """Make the rows of tracks that were displaced rows of a search, or of the track with these ``pixels``."""
        changes: list[tuple[Row, InitialPixel | None]] = []
        # of several tracks the newest is the one that took the place
        newest = max((p.track_id for p in pixels if p.track_id is not None), default=None)
        pixels = [p for p in pixels if p.track_id == newest]
        paths = {station: _PixelPath(station, pixels) for station in {pixel.station for pixel in pixels}}
        rows = [p for p in self._rows if p.track_id is not None and p.track_id in tracks and not self._is_old(p)]
        agree = [self._agrees(pending, paths.get(pending.station)) for pending in rows]
        votes = Counter((p.track_id, p.station, a) for p, a in zip(rows, agree, strict=True))
        for pending, agrees in zip(rows, agree, strict=True):
            # where most of its camera's other frames agree, that camera showed the same target
            yes, no = (votes[pending.track_id, pending.station, answer] for answer in (True, False))
            has_pixel = pending.is_initial or pending.box is not None
            if agrees or (agrees is None and has_pixel and yes >= _LEAST_VOTES and yes > no):
                pending.track_id = newest
            else:
                pending.searched, pending.track_id, pending.box, pending.is_initial = True, None, None, False
                changes.append((pending.row, None))
        return changes

    @staticmethod
    def _agrees(pending: _Pending[Row], path: _PixelPath | None) -> bool | None:
        """Return whether a row's silhouette has a track's pixel in it; None where that is not known."""
        return None if path is None or pending.box is None else path.is_within(pending.box, pending.t_s)

    def _fill(self, pixels: Sequence[InitialPixel]) -> list[tuple[Row, InitialPixel | None]]:
        """Give frames of the search the pixels of the track that was found."""
        by_frame = {(round(pixel.t_s, 6), pixel.station): pixel for pixel in pixels}
        changes: list[tuple[Row, InitialPixel | None]] = []
        for pending in self._rows:
            pixel = by_frame.get((round(pending.t_s, 6), pending.station))
            if pixel is not None and pending.searched and not self._is_old(pending):
                pending.searched, pending.track_id, pending.is_initial = False, pixel.track_id, True
                changes.append((pending.row, pixel))
        return changes

    def _is_old(self, pending: _Pending[Row]) -> bool:
        return self._newest_s - pending.t_s > INITIAL_PIXELS_S

    def _is_final(self, pending: _Pending[Row]) -> bool:
        waits = pending.searched or (pending.track_id is not None and pending.track_id != self._confirmed_id)
        return not waits or self._is_old(pending)
