"""Measures of a stretch of a clip: motion of the camera, sky, light, blur and noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.composites.background_shift import background_shifts
from groundstation.bank.composites.clip_stretches import ClipStretch, read_frames, read_stretches
from groundstation.bank.composites.picture_blur import edge_blur_px
from groundstation.bank.composites.picture_light import PictureLight, picture_light, sky_mask, skyline_row
from groundstation.bank.composites.picture_noise import PictureNoise, picture_noise
from groundstation.detection.picture_shift import is_cut, small_copy
from groundstation.errors import SessionError
from groundstation.simulation.world.world_sets import WorldSet

# frames, spread over a stretch, on which blur is measured; on every so manyth of these light and noise are
_MEASURED, _LIT = 20, 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StretchView:
    """Measures of a stretch of n frames.

    Attributes
    ----------
    size_px : (w, h) of its pictures.
    shifts_px : (n, 2) where the scene of the first frame is in each.
    horizon_row : row, px, in which the sky of the first frame ends; None without ground.
    light, blur_px, noise : of the whole stretch.
    """

    size_px: tuple[int, int]
    shifts_px: FloatArray
    horizon_row: float | None
    light: PictureLight
    blur_px: float
    noise: PictureNoise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StretchFootage:
    """A stretch with its frames (h, w, 3) BGR and their measures."""

    stretch: ClipStretch
    frames: tuple[ImageArray, ...]
    view: StretchView


class CompositeClips:
    """The clips of a folder by set; the newest stretch's frames are kept, and the measures of all.

    Parameters
    ----------
    folder : with segments.csv, boxes.csv and the clips.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stretches: dict[WorldSet, tuple[ClipStretch, ...]] = {}
        self._views: dict[tuple[str, int], tuple[ClipStretch, StretchView]] = {}
        self._newest: StretchFootage | None = None

    def stretches(self, world_set: WorldSet) -> tuple[ClipStretch, ...]:
        """Return the stretches of a set's clips; raises `SessionError` where there are none."""
        if world_set not in self._stretches:
            self._stretches[world_set] = read_stretches(self._folder, world_set)
        return self._stretches[world_set]

    def measured(self, stretch: ClipStretch) -> tuple[ClipStretch, StretchView]:
        """Return a stretch without cuts, and its measures."""
        key = stretch.clip, stretch.first
        if key not in self._views:
            footage = footage_of(stretch, read_frames(stretch))
            self._views[key] = footage.stretch, footage.view
            self._newest = footage
        return self._views[key]

    def footage(self, world_set: WorldSet, clip: str, frame: int) -> StretchFootage:
        """Return the stretch of a clip that a frame is in; raises `SessionError` where it is in none."""
        newest = self._newest
        if newest is not None and newest.stretch.clip == clip and _holds(newest.stretch, frame):
            return newest
        for stretch in self.stretches(world_set):
            if stretch.clip == clip and _holds(stretch, frame):
                part, view = self.measured(stretch)
                if self._newest is None or self._newest.view is not view:
                    self._newest = StretchFootage(stretch=part, frames=read_frames(part), view=view)
                return self._newest
        raise SessionError(str(self._folder), got=f"no frame {frame} of clip {clip}", wanted="one in a segment")


def footage_of(stretch: ClipStretch, frames: Sequence[ImageArray]) -> StretchFootage:
    """Measure the longest part of a stretch that has no cut inside."""
    small = [small_copy(frame) for frame in frames]
    first, last = longest_without_cut(small)
    part = replace(
        stretch, first=stretch.first + first, last=stretch.first + last, boxes=stretch.boxes[first : last + 1]
    )
    kept = tuple(frames[first : last + 1])
    chosen = range(0, len(kept), max(len(kept) // _MEASURED, 1))
    some = [kept[k] for k in chosen]
    skies = [sky_mask(frame) for frame in some[::_LIT]]
    height, width = kept[0].shape[:2]
    view = StretchView(
        size_px=(width, height),
        shifts_px=background_shifts(small[first : last + 1], part.boxes),
        horizon_row=skyline_row(skies[0]),
        light=picture_light(some[::_LIT], skies),
        blur_px=edge_blur_px(some, [part.boxes[k] for k in chosen]),
        noise=picture_noise(some[::_LIT]),
    )
    return StretchFootage(stretch=part, frames=kept, view=view)


def longest_without_cut(small: Sequence[ImageArray]) -> tuple[int, int]:
    """Return the first and the last of the longest run of small copies in which no scene replaces another."""
    starts = [0, *(k for k in range(1, len(small)) if is_cut(small[k - 1], small[k])), len(small)]
    runs = [(starts[k], starts[k + 1] - 1) for k in range(len(starts) - 1)]
    return max(runs, key=lambda run: run[1] - run[0])


def _holds(stretch: ClipStretch, frame: int) -> bool:
    return stretch.first <= frame <= stretch.last
