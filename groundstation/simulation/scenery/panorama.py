"""A panorama whose blocks are drawn when a picture first needs them: most directions are never seen.

A pixel depends on its direction alone, so that the panorama is the same to the last bit in whichever order its blocks
are drawn.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, MaskArray
from groundstation.simulation.render_kernels import TILE, Panorama, flat_blocks, tile_corners
from groundstation.simulation.scenery.part_kernels import FaceTable, PartTable, draw_parts
from groundstation.simulation.scenery.part_tables import part_tables_of
from groundstation.simulation.scenery.scenery import Scenery
from groundstation.simulation.scenery.scenery_kernels import bake
from groundstation.simulation.scenery.tones import Tables, Tones, tables_of, tones_of

BLOCK = 4 * TILE
# of a pixel off the plane through its tile's corners, rounding included; noise is some two levels
_FLAT_LEVELS = 1.5
# interpolation reads the next pixel, and fixed-point steps end within another of a tile's corners
_REACH_PX = 2.0


class View(NamedTuple):
    """What draws a panorama: eye (3,) m, colours, their tables, objects, and whether the camera has no colour."""

    eye: FloatArray
    tones: Tones
    tables: Tables
    parts: PartTable
    faces: FaceTable
    grey: bool


@njit(cache=True, nogil=True)
def draw_blocks(panorama: Panorama, blocks: np.ndarray, view: View) -> None:
    """Draw blocks (n, 2), given by row and column in steps of `BLOCK`."""
    height, width = panorama.depth.shape
    # a tile is flat or not by its pixels and the first ones of the next
    image, depth = np.empty((BLOCK + 1, BLOCK + 1, 3), np.uint8), np.empty((BLOCK + 1, BLOCK + 1), np.uint16)
    corner = np.empty(2, np.int64)
    for n in range(len(blocks)):
        y0, x0 = blocks[n, 0] * BLOCK, blocks[n, 1] * BLOCK
        corner[0], corner[1] = y0, x0
        rows, columns = min(BLOCK + 1, height - y0), min(BLOCK + 1, width - x0)
        picture, far = image[:rows, :columns], depth[:rows, :columns]
        bake(panorama.place, corner, view.eye, view.tones, view.tables, view.grey, picture, far)
        draw_parts(panorama.place, corner, view.parts, view.faces, view.tones.sky, view.grey, picture, far)
        y1, x1 = min(y0 + BLOCK, height), min(x0 + BLOCK, width)
        panorama.image[y0:y1, x0:x1] = picture[: y1 - y0, : x1 - x0]
        panorama.depth[y0:y1, x0:x1] = far[: y1 - y0, : x1 - x0]
        i, j = y0 // TILE, x0 // TILE
        flat_blocks(picture, _FLAT_LEVELS, panorama.flat[i : i + BLOCK // TILE, j : j + BLOCK // TILE])


@njit(cache=True, nogil=True)
def mark_seen(nodes: FloatArray, moved: FloatArray, fine: Panorama, coarse: Panorama, seen: np.ndarray) -> None:
    """Mark the blocks of both panoramas that `render_kernels.surroundings` reads for the same nodes and motion.

    ``seen`` (2, rows, columns) holds the fine panorama's blocks and the coarse one's.
    """
    corner, shift = np.empty((4, 2)), np.empty(2)
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            layer = 0
            for layer in range(2):
                panorama = fine if layer == 0 else coarse
                height, width = panorama.depth.shape
                if tile_corners(nodes, moved, i, j, panorama.place, width, height, corner, shift):
                    break
            panorama = fine if layer == 0 else coarse
            height, width = panorama.depth.shape
            reach_x, reach_y = 0.5 * abs(shift[0]) + _REACH_PX, 0.5 * abs(shift[1]) + _REACH_PX
            left, right = corner[:, 0].min() - reach_x, corner[:, 0].max() + reach_x
            above, below = corner[:, 1].min() - reach_y, corner[:, 1].max() + reach_y
            for row in range(max(int(above), 0) // BLOCK, min(int(below), height - 1) // BLOCK + 1):
                for column in range(max(int(left), 0) // BLOCK, min(int(right), width - 1) // BLOCK + 1):
                    seen[layer, row, column] = True


class DrawnPanorama:
    """A panorama of a scenery from an eye; one thread at a time, since drawing changes it.

    Parameters
    ----------
    scenery : what there is.
    eye_runway_m : (3,) the camera.
    grey : whether it has no colour.
    density : px/rad.
    azimuths_rad, elevations_rad : from and to.

    Attributes
    ----------
    pixels : as the kernels read it; only the blocks that `draw` was asked for hold anything.
    """

    def __init__(
        self,
        scenery: Scenery,
        eye_runway_m: FloatArray,
        grey: bool,
        density: float,
        azimuths_rad: tuple[float, float],
        elevations_rad: tuple[float, float],
    ) -> None:
        width = math.ceil((azimuths_rad[1] - azimuths_rad[0]) * density)
        height = math.ceil((elevations_rad[1] - elevations_rad[0]) * density)
        eye = np.asarray(eye_runway_m, np.float64)
        parts, faces = part_tables_of(scenery, eye, 1.0 / density)
        self._view = View(eye, tones_of(scenery), tables_of(scenery), parts, faces, grey)
        self.pixels = Panorama(
            image=np.empty((height, width, 3), np.uint8),
            place=np.array([azimuths_rad[0], elevations_rad[1], density]),
            flat=np.zeros((-(-height // TILE), -(-width // TILE)), dtype=bool),
            depth=np.empty((height, width), np.uint16),
        )
        self._drawn = np.zeros((-(-height // BLOCK), -(-width // BLOCK)), dtype=bool)

    @property
    def blocks(self) -> tuple[int, int]:
        """Number of rows and columns of blocks."""
        return self._drawn.shape[0], self._drawn.shape[1]

    def draw(self, wanted: MaskArray) -> None:
        """Draw those of the wanted blocks (rows, columns) that are not yet drawn."""
        missing = wanted & ~self._drawn
        if missing.any():
            draw_blocks(self.pixels, np.argwhere(missing), self._view)
            self._drawn |= missing

    def draw_all(self) -> Panorama:
        """Draw what is missing and return the whole."""
        self.draw(np.ones_like(self._drawn))
        return self.pixels
