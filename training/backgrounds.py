"""Backgrounds of training windows: surroundings of train worlds, and frames of real clips away from their aircraft."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.bank.composites.clip_segments import read_frames, read_segments
from groundstation.box import Box
from groundstation.errors import SessionError
from groundstation.simulation.scenery import FineRange, fine_panorama
from groundstation.simulation.traffic import with_roads
from groundstation.simulation.world.world import World
from groundstation.simulation.world.world_sets import WorldSet
from training.kinds import surroundings_kinds

# every so manyth frame of a clip; the camera pans in most
_FRAME_STEP = 15
# around a labelled box, whose rim is loose already
_BOX_MARGIN_PX = 8.0
# of one drawn picture; a world's is seen through windows of at most a quarter of its height
_MOST_PIXELS = 800_000
_ELEVATIONS_DEG = (-2.5, 11.0)
_HALF_AZIMUTH_DEG = 15.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Background:
    """A picture without drawn bodies.

    Attributes
    ----------
    image : (h, w, 3) uint8 BGR.
    occupied : where the clip's own aircraft is, px; None where there is none.
    drawn : whether it is drawn, so that its noise is still to be added.
    kinds : of scenery and sky, where they are known.
    """

    image: ImageArray
    occupied: Box[float] | None
    drawn: bool
    kinds: tuple[str, ...] = ()


def world_background(world: World, generator: np.random.Generator) -> Background:
    """Draw what a station of a world sees along the runway."""
    number = int(generator.integers(len(world.stations.stations)))
    eye = np.array(world.stations.stations[number].position_m)
    camera = world.cameras[number]
    middle = math.radians(float(generator.normal(0.0, 4.0)))
    low, high = (math.radians(v) for v in _ELEVATIONS_DEG)
    # a random part of the heights, as fine as the camera's own pixels are
    area = _MOST_PIXELS / camera.focal_px**2
    half = math.radians(_HALF_AZIMUTH_DEG)
    height = min(area / (2.0 * half), high - low)
    half = min(half, 0.5 * area / height)
    # the horizon, where things stand, is in two of three
    at_horizon = float(generator.uniform()) < 2.0 / 3.0
    start = -0.35 * height if at_horizon else float(generator.uniform(low, max(high - height, low)))
    seen = FineRange(
        azimuth_from_rad=middle - half,
        azimuth_to_rad=middle + half,
        elevation_from_rad=start,
        elevation_to_rad=start + height,
    )
    scenery = with_roads(world.scenery, world.traffic)
    drawn = fine_panorama(scenery, eye, camera.focal_px, not camera.colour, seen)
    return Background(image=drawn.image, occupied=None, drawn=True, kinds=surroundings_kinds(world))


def clip_backgrounds(folder: Path) -> list[Background]:
    """Return frames of the real clips that may be learned from.

    Raises `SessionError` where the folder has none.
    """
    found: list[Background] = []
    for segment in read_segments(folder, WorldSet.TRAIN):
        for place, image in enumerate(read_frames(segment)):
            if place % _FRAME_STEP == 0:
                found.append(Background(image=image, occupied=_widened(segment.boxes[place]), drawn=False))
    if not found:
        raise SessionError(str(folder), got="no frames", wanted="clips of train with labelled boxes")
    return found


def _widened(box: Box[float] | None) -> Box[float] | None:
    if box is None:
        return None
    m = _BOX_MARGIN_PX
    return Box(box.x0 - m, box.y0 - m, box.x1 + m, box.y1 + m)
