"""The surroundings of a runway as one station sees them: two panoramas that never change, drawn where they are seen.

Approximations: the eye stays where it is with pan and tilt at zero, so the ground does not shift by the lever arm
when the head turns (1 cm at 20 m is half a milliradian); hills and clouds are infinitely far away; the ground is
level; nothing in the surroundings moves. Fine detail is where aircraft fly, `FineRange`; elsewhere it is coarser.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require, require_finite
from groundstation.simulation.render_kernels import Panorama
from groundstation.simulation.scenery.panorama import DrawnPanorama, mark_seen
from groundstation.simulation.scenery.scenery import Scenery

# of the lens's own pixels to a radian; interpolation then blurs about as a lens does
_FINE_SHARE = 0.8
_MAX_FINE_PIXELS = 10_000_000
_COARSER, _MAX_COARSE_DENSITY = 8.0, 350.0
_LAP_RAD = 0.7  # the coarse panorama goes on beyond a full turn, so that no tile is torn


@dataclass(frozen=True, slots=True, kw_only=True)
class FineRange:
    """Directions that are drawn finely; azimuth from +y towards +x.

    Attributes
    ----------
    azimuth_from_rad, azimuth_to_rad : at most a full turn apart.
    elevation_from_rad, elevation_to_rad : within half a turn.
    """

    azimuth_from_rad: float = -math.radians(25.0)
    azimuth_to_rad: float = math.radians(25.0)
    elevation_from_rad: float = math.radians(-12.0)
    elevation_to_rad: float = math.radians(5.0)

    def __post_init__(self) -> None:
        for name in ("azimuth_from_rad", "azimuth_to_rad", "elevation_from_rad", "elevation_to_rad"):
            require_finite(f"FineRange: {name}", getattr(self, name))
        wide = self.azimuth_to_rad - self.azimuth_from_rad
        require(0 < wide <= math.tau, "FineRange: azimuths", got=f"{wide:g} rad apart", wanted="above 0, at most 2π")
        low, high = self.elevation_from_rad, self.elevation_to_rad
        good = -0.5 * math.pi <= low < high <= 0.5 * math.pi
        require(good, "FineRange: elevations", got=f"{low:g} to {high:g}", wanted="rising, from -π/2 to π/2")

    @property
    def area(self) -> float:
        """Its size in rad²."""
        return (self.azimuth_to_rad - self.azimuth_from_rad) * (self.elevation_to_rad - self.elevation_from_rad)


def fine_range_around(points_runway_m: FloatArray, eye_runway_m: FloatArray, margin_rad: float) -> FineRange:
    """Return what a camera may see that follows points (n, 3) m from an eye (3,) m, with so much around each.

    The azimuths are the shortest arc that holds all of them.
    """
    towards = np.asarray(points_runway_m - eye_runway_m)
    azimuths = np.sort(np.arctan2(towards[:, 0], towards[:, 1]))
    elevations = np.arctan2(towards[:, 2], np.hypot(towards[:, 0], towards[:, 1]))
    gaps = np.diff(azimuths, append=azimuths[0] + math.tau)
    widest = int(np.argmax(gaps))
    start = float(azimuths[(widest + 1) % azimuths.size])
    length = math.tau - float(gaps[widest]) + 2.0 * margin_rad
    if length >= math.tau:
        start, length = -math.pi + margin_rad, math.tau
    low, high = float(elevations.min()) - margin_rad, float(elevations.max()) + margin_rad
    return FineRange(
        azimuth_from_rad=start - margin_rad,
        azimuth_to_rad=start - margin_rad + length,
        elevation_from_rad=max(low, -0.5 * math.pi),
        elevation_to_rad=min(high, 0.5 * math.pi),
    )


class Surroundings:
    """What one station sees; one thread at a time, since drawing changes it.

    Parameters
    ----------
    fine : where aircraft fly.
    coarse : all around.
    hides_bodies : whether any of it may hide a body behind it.
    """

    def __init__(self, fine: DrawnPanorama, coarse: DrawnPanorama, hides_bodies: bool) -> None:
        self._fine, self._coarse, self.hides_bodies = fine, coarse, hides_bodies
        rows, columns = (max(fine.blocks[axis], coarse.blocks[axis]) for axis in range(2))
        self._seen = np.zeros((2, rows, columns), dtype=bool)

    @property
    def panoramas(self) -> tuple[Panorama, Panorama]:
        """Both as the kernels read them: the fine one and the coarse one."""
        return self._fine.pixels, self._coarse.pixels

    def draw_seen(self, nodes: FloatArray, moved: FloatArray) -> None:
        """Draw what a picture with these directions (rows, columns, 2) and their motion, rad, shows."""
        self._seen[:] = False
        mark_seen(nodes, moved, *self.panoramas, self._seen)
        for number, panorama in enumerate((self._fine, self._coarse)):
            rows, columns = panorama.blocks
            panorama.draw(self._seen[number, :rows, :columns])

    def draw_all(self) -> None:
        """Draw all of it, so that no picture has to wait; takes some seconds."""
        self._fine.draw_all()
        self._coarse.draw_all()


def surroundings_of(
    scenery: Scenery, eye_runway_m: FloatArray, focal_px: float, grey: bool, fine: FineRange | None = None
) -> Surroundings:
    """Return what an eye (3,) sees through a lens of this focal length, px."""
    chosen = FineRange() if fine is None else fine
    near = _fine(scenery, eye_runway_m, focal_px, grey, chosen)
    turn, all_heights = (-math.pi - _LAP_RAD, math.pi + _LAP_RAD), (-0.5 * math.pi, 0.5 * math.pi)
    coarse_density = min(_density(focal_px, chosen) / _COARSER, _MAX_COARSE_DENSITY)
    coarse = DrawnPanorama(scenery, eye_runway_m, grey, coarse_density, turn, all_heights)
    hides = bool(scenery.objects) or scenery.skyline.trees_solid
    return Surroundings(near, coarse, hides)


def fine_panorama(scenery: Scenery, eye_runway_m: FloatArray, focal_px: float, grey: bool, fine: FineRange) -> Panorama:
    """Draw all of the fine part alone."""
    return _fine(scenery, eye_runway_m, focal_px, grey, fine).draw_all()


def _fine(scenery: Scenery, eye_runway_m: FloatArray, focal_px: float, grey: bool, fine: FineRange) -> DrawnPanorama:
    azimuths = (fine.azimuth_from_rad, fine.azimuth_to_rad)
    elevations = (fine.elevation_from_rad, fine.elevation_to_rad)
    return DrawnPanorama(scenery, eye_runway_m, grey, _density(focal_px, fine), azimuths, elevations)


def _density(focal_px: float, fine: FineRange) -> float:
    """Return px/rad of the fine part."""
    return min(_FINE_SHARE * focal_px, math.sqrt(_MAX_FINE_PIXELS / fine.area))
