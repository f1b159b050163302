"""Livery of an airframe: up to three colours on named areas, and a separate underside."""

from dataclasses import dataclass
from enum import StrEnum, auto

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.simulation.airframes.mesh import Colour, doubled_areas
from groundstation.simulation.parameter_checks import require, require_fraction

_MOST_BANDS = 4
# the colour of the underside is on faces with normals that point down by more than this
_DOWNWARD = -0.25
# half height of the stripe along the fuselage, as the sine of the angle from its widest line
_STRIPE = 0.32


class PaintedArea(StrEnum):
    """Areas of an airframe that a livery distinguishes."""

    HULL = auto()
    WING = auto()
    TAIL = auto()
    FIN = auto()
    BOOM = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class LiverySpec:
    """Colours, BGR from 0 to 255, and where they are.

    Attributes
    ----------
    base_bgr : of all that is not painted otherwise.
    second_bgr : of wing tips, nose and tail, where these are painted.
    third_bgr : of stripe and bands.
    underside_bgr : of the faces that point down; None for the colour of the top.
    boom_bgr : of booms, struts and nacelles; None for the colour of the rest.
    tip_share : of the half span, from the wing tip inwards, in the second colour; 0 has none.
    nose_share : of the fuselage's length, from the nose backwards, in the second colour.
    painted_tail, painted_fin : whether tailplane and fins have the second colour.
    stripe : whether a stripe runs along the fuselage.
    wing_bands : how many bands of the third colour each wing has, 0 to 4.
    glass_bgr : of canopy and windows.
    """

    base_bgr: Colour = (205.0, 208.0, 210.0)
    second_bgr: Colour = (44.0, 36.0, 150.0)
    third_bgr: Colour = (80.0, 80.0, 82.0)
    underside_bgr: Colour | None = None
    boom_bgr: Colour | None = None
    tip_share: float = 0.0
    nose_share: float = 0.0
    painted_tail: bool = False
    painted_fin: bool = False
    stripe: bool = False
    wing_bands: int = 0
    glass_bgr: Colour = (62.0, 54.0, 48.0)

    def __post_init__(self) -> None:
        for name in ("base_bgr", "second_bgr", "third_bgr", "underside_bgr", "boom_bgr", "glass_bgr"):
            colour = getattr(self, name)
            if colour is not None:
                fits = len(colour) == 3 and all(0.0 <= c <= 255.0 for c in colour)
                require(fits, f"LiverySpec: {name}", got=colour, wanted="three numbers from 0 to 255")
        require_fraction("LiverySpec: tip_share", self.tip_share)
        require_fraction("LiverySpec: nose_share", self.nose_share)
        fits = isinstance(self.wing_bands, int) and 0 <= self.wing_bands <= _MOST_BANDS
        require(fits, "LiverySpec: wing_bands", got=self.wing_bands, wanted=f"a whole number from 0 to {_MOST_BANDS}")


def band_edges(livery: LiverySpec) -> tuple[float, ...]:
    """Return where colours change along a wing, as shares of its half span from the root, ascending."""
    outer = 1.0 - livery.tip_share
    pitch = (outer - _FIRST_BAND) / max(livery.wing_bands, 1)
    edges = [_FIRST_BAND + pitch * (k + part) for k in range(livery.wing_bands) for part in (0.25, 0.65)]
    return tuple([*edges, outer] if livery.tip_share > 0.0 else edges)


# bands begin outside of the fuselage
_FIRST_BAND = 0.3


def painted(livery: LiverySpec, area: PaintedArea, triangles: FloatArray, length: float = 1.0) -> FloatArray:
    """Return the colours (n, 3) of an area's triangles (n, 3, 3), in spans; ``length`` is the fuselage's."""
    colours = np.tile(np.array(livery.base_bgr), (len(triangles), 1))
    middle = triangles.mean(axis=1)
    normals = doubled_areas(triangles)
    up = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-15)
    if livery.underside_bgr is not None and area is not PaintedArea.FIN:
        colours[up < _DOWNWARD] = livery.underside_bgr
    if area is PaintedArea.BOOM and livery.boom_bgr is not None:
        colours[:] = livery.boom_bgr
    if area is PaintedArea.HULL:
        if livery.stripe:
            colours[np.abs(up) < _STRIPE] = livery.third_bgr
        colours[middle[:, 0] < livery.nose_share * length] = livery.second_bgr
    if area is PaintedArea.WING:
        _paint_wing(livery, 2.0 * np.abs(middle[:, 1]), colours)
    if (area is PaintedArea.TAIL and livery.painted_tail) or (area is PaintedArea.FIN and livery.painted_fin):
        colours[:] = livery.second_bgr
    return colours


def _paint_wing(livery: LiverySpec, outward: FloatArray, colours: FloatArray) -> None:
    """Paint bands and tips by how far out (n,) triangles are, as a share of the half span."""
    edges = band_edges(livery)
    for inner, outer in zip(edges[0 : 2 * livery.wing_bands : 2], edges[1 : 2 * livery.wing_bands : 2], strict=True):
        band: MaskArray = (outward > inner) & (outward < outer)
        colours[band] = livery.third_bgr
    if livery.tip_share > 0.0:
        colours[outward > edges[-1]] = livery.second_bgr
