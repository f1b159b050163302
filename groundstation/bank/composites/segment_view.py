"""Measures of a segment of a clip: motion of the camera, sky, light, blur and noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.composites.background_shift import background_shifts
from groundstation.bank.composites.clip_segments import ClipSegment, read_frames, read_segments
from groundstation.bank.composites.picture_blur import edge_blur_px
from groundstation.bank.composites.picture_light import PictureLight, picture_light, sky_mask, skyline_row
from groundstation.bank.composites.picture_noise import PictureNoise, picture_noise
from groundstation.errors import SessionError
from groundstation.registration.picture_shift import is_cut, small_copy
from groundstation.simulation.world.world_sets import WorldSet

# frames, spread over a segment, on which blur is measured; on every so manyth of these light and noise are
_MEASURED, _LIT = 20, 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SegmentView:
    """Measures of a segment of n frames.

    Attributes
    ----------
    size_px : (w, h) of its pictures.
    shifts_px : (n, 2) where the scene of the first frame is in each.
    horizon_row : row, px, in which the sky of the first frame ends; None without ground.
    light, blur_px, noise : of the whole segment.
    """

    size_px: tuple[int, int]
    shifts_px: FloatArray
    horizon_row: float | None
    light: PictureLight
    blur_px: float
    noise: PictureNoise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SegmentFootage:
    """A segment with its frames (h, w, 3) BGR and their measures."""

    segment: ClipSegment
    frames: tuple[ImageArray, ...]
    view: SegmentView


class CompositeClips:
    """The clips of a folder by set; the newest segment's frames are kept, and the measures of all.

    Parameters
    ----------
    folder : with segments.csv, boxes.csv and the clips.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._segments: dict[WorldSet, tuple[ClipSegment, ...]] = {}
        self._views: dict[tuple[str, int], tuple[ClipSegment, SegmentView]] = {}
        self._newest: SegmentFootage | None = None

    def segments(self, world_set: WorldSet) -> tuple[ClipSegment, ...]:
        """Return the segments of a set's clips; raises `SessionError` where there are none."""
        if world_set not in self._segments:
            self._segments[world_set] = read_segments(self._folder, world_set)
        return self._segments[world_set]

    def measured(self, segment: ClipSegment) -> tuple[ClipSegment, SegmentView]:
        """Return a segment without cuts, and its measures."""
        key = segment.clip, segment.first
        if key not in self._views:
            footage = footage_of(segment, read_frames(segment))
            self._views[key] = footage.segment, footage.view
            self._newest = footage
        return self._views[key]

    def footage(self, world_set: WorldSet, clip: str, frame: int) -> SegmentFootage:
        """Return the segment of a clip that a frame is in; raises `SessionError` where it is in none."""
        newest = self._newest
        if newest is not None and newest.segment.clip == clip and _holds(newest.segment, frame):
            return newest
        for segment in self.segments(world_set):
            if segment.clip == clip and _holds(segment, frame):
                part, view = self.measured(segment)
                if self._newest is None or self._newest.view is not view:
                    self._newest = SegmentFootage(segment=part, frames=read_frames(part), view=view)
                return self._newest
        raise SessionError(str(self._folder), got=f"no frame {frame} of clip {clip}", wanted="one in a segment")


def footage_of(segment: ClipSegment, frames: Sequence[ImageArray]) -> SegmentFootage:
    """Measure the longest part of a segment that has no cut inside."""
    small = [small_copy(frame) for frame in frames]
    first, last = longest_without_cut(small)
    part = replace(
        segment, first=segment.first + first, last=segment.first + last, boxes=segment.boxes[first : last + 1]
    )
    kept = tuple(frames[first : last + 1])
    chosen = range(0, len(kept), max(len(kept) // _MEASURED, 1))
    some = [kept[k] for k in chosen]
    skies = [sky_mask(frame) for frame in some[::_LIT]]
    height, width = kept[0].shape[:2]
    view = SegmentView(
        size_px=(width, height),
        shifts_px=background_shifts(small[first : last + 1], part.boxes),
        horizon_row=skyline_row(skies[0]),
        light=picture_light(some[::_LIT], skies),
        blur_px=edge_blur_px(some, [part.boxes[k] for k in chosen]),
        noise=picture_noise(some[::_LIT]),
    )
    return SegmentFootage(segment=part, frames=kept, view=view)


def longest_without_cut(small: Sequence[ImageArray]) -> tuple[int, int]:
    """Return the first and the last of the longest run of small copies in which no scene replaces another."""
    starts = [0, *(k for k in range(1, len(small)) if is_cut(small[k - 1], small[k])), len(small)]
    runs = [(starts[k], starts[k + 1] - 1) for k in range(len(starts) - 1)]
    return max(runs, key=lambda run: run[1] - run[0])


def _holds(segment: ClipSegment, frame: int) -> bool:
    return segment.first <= frame <= segment.last
