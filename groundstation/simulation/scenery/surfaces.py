"""Surfaces of the ground: their colours and how these vary from place to place."""

from dataclasses import dataclass
from enum import StrEnum

from groundstation.simulation.parameter_checks import require_finite, require_not_negative, require_positive

Colour = tuple[float, float, float]


class Surface(StrEnum):
    """Cover of the ground."""

    MEADOW = "meadow"
    SHORT_GRASS = "short-grass"
    DRY_GRASS = "dry-grass"
    CROP = "crop"
    STUBBLE = "stubble"
    PLOUGHED = "ploughed"
    SAND = "sand"
    SNOW = "snow"
    PACKED_SNOW = "packed-snow"
    WATER = "water"
    GRAVEL = "gravel"
    ASPHALT = "asphalt"
    FRESH_ASPHALT = "fresh-asphalt"
    CONCRETE = "concrete"


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceTones:
    """Colours of a surface, BGR in full light.

    ``base`` is the mean; ``wide`` and ``fine`` are what noise of ``wide_m`` and ``fine_m`` adds at most, half of it up
    and half down; ``along`` is how much slower the fine noise varies along +y. ``stripe`` is the share by which stripes
    ``stripe_m`` apart differ from the mean. ``gloss`` from 0 to 1 is how much sky a still surface mirrors.
    """

    base: Colour
    wide: Colour = (0.0, 0.0, 0.0)
    fine: Colour = (0.0, 0.0, 0.0)
    wide_m: float = 90.0
    fine_m: float = 4.0
    along: float = 1.0
    stripe: float = 0.0
    stripe_m: float = 1.0
    gloss: float = 0.0


# the first of grass and of asphalt are the standard site's; the others are by eye, after photographs of airfields
SURFACES = {
    Surface.MEADOW: SurfaceTones(base=(62.0, 98.0, 84.0), wide=(16.0, 26.0, 40.0), fine=(34.0, 46.0, 40.0)),
    Surface.SHORT_GRASS: SurfaceTones(
        base=(66.0, 112.0, 96.0), wide=(16.0, 22.0, 30.0), fine=(22.0, 28.0, 30.0), stripe=0.05, stripe_m=4.0
    ),
    Surface.DRY_GRASS: SurfaceTones(base=(92.0, 134.0, 148.0), wide=(30.0, 36.0, 40.0), fine=(44.0, 50.0, 52.0)),
    Surface.CROP: SurfaceTones(
        base=(64.0, 126.0, 104.0), wide=(18.0, 26.0, 26.0), fine=(20.0, 30.0, 28.0), stripe=0.07, stripe_m=1.2
    ),
    Surface.STUBBLE: SurfaceTones(
        base=(110.0, 156.0, 176.0), wide=(20.0, 24.0, 28.0), fine=(30.0, 34.0, 36.0), stripe=0.10, stripe_m=2.4
    ),
    Surface.PLOUGHED: SurfaceTones(
        base=(56.0, 72.0, 92.0), wide=(14.0, 18.0, 22.0), fine=(26.0, 32.0, 38.0), stripe=0.16, stripe_m=1.4
    ),
    Surface.SAND: SurfaceTones(
        base=(134.0, 168.0, 190.0), wide=(24.0, 28.0, 30.0), fine=(22.0, 26.0, 28.0), wide_m=60.0
    ),
    Surface.SNOW: SurfaceTones(
        base=(226.0, 220.0, 214.0), wide=(16.0, 16.0, 16.0), fine=(20.0, 22.0, 24.0), wide_m=30.0, fine_m=6.0
    ),
    Surface.PACKED_SNOW: SurfaceTones(
        base=(196.0, 192.0, 188.0), wide=(16.0, 16.0, 16.0), fine=(34.0, 34.0, 34.0), fine_m=3.0, along=0.1
    ),
    Surface.WATER: SurfaceTones(
        base=(96.0, 88.0, 62.0), wide=(16.0, 16.0, 12.0), fine=(26.0, 24.0, 20.0), wide_m=200.0, fine_m=2.5, gloss=0.7
    ),
    Surface.GRAVEL: SurfaceTones(
        base=(120.0, 132.0, 142.0), wide=(18.0, 20.0, 22.0), fine=(44.0, 46.0, 48.0), wide_m=20.0, fine_m=1.6
    ),
    Surface.ASPHALT: SurfaceTones(base=(104.0, 101.0, 99.0), fine=(26.0, 26.0, 26.0), fine_m=2.0, along=0.25),
    Surface.FRESH_ASPHALT: SurfaceTones(base=(62.0, 60.0, 60.0), fine=(14.0, 14.0, 14.0), fine_m=2.0, along=0.25),
    Surface.CONCRETE: SurfaceTones(
        base=(158.0, 164.0, 166.0), wide=(22.0, 22.0, 22.0), fine=(18.0, 18.0, 18.0), wide_m=24.0, fine_m=3.0, along=0.5
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPatch:
    """A rectangle of another surface: a field, a lake, a road, an apron, a taxiway.

    Attributes
    ----------
    surface : what covers it.
    x_m, y_m : its middle, runway frame.
    heading_rad : of its length, from +y towards +x.
    length_m, width_m : its size.
    tint_bgr : factors on the surface's colours.
    ragged_m : how far its outline strays from a rectangle, as shores do.
    """

    surface: Surface
    x_m: float
    y_m: float
    heading_rad: float = 0.0
    length_m: float
    width_m: float
    tint_bgr: Colour = (1.0, 1.0, 1.0)
    ragged_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("x_m", "y_m", "heading_rad"):
            require_finite(f"GroundPatch: {name}", getattr(self, name))
        for name in ("length_m", "width_m"):
            require_positive(f"GroundPatch: {name}", getattr(self, name))
        require_not_negative("GroundPatch: ragged_m", self.ragged_m)
        require_tint("GroundPatch: tint_bgr", self.tint_bgr)


def require_tint(where: str, tint_bgr: Colour) -> None:
    """Raise `ScenarioError` unless all three factors are finite and ≥ 0."""
    for factor in tint_bgr:
        require_not_negative(where, factor)
