"""Parameters of the drawn surroundings of each kind: surfaces, skyline, density of objects."""

from dataclasses import dataclass

from groundstation.simulation.scenery.scenery import SceneryName
from groundstation.simulation.scenery.surfaces import Surface

Span = tuple[float, float]
Count = tuple[int, int]

_PAVED = (Surface.ASPHALT, Surface.FRESH_ASPHALT, Surface.CONCRETE)
_SMALL_FIELD = (Surface.ASPHALT, Surface.CONCRETE, Surface.SHORT_GRASS, Surface.GRAVEL)


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteKind:
    """Choices and spans of uniform draws for one kind of surroundings.

    Attributes
    ----------
    grounds, runways : surfaces to choose from.
    half_width_m, length_m : of the runway.
    hills_rad, relief_rad : mean elevation of the skyline and how much it varies.
    trees_gap : see `Skyline`.
    mosaic : see `Scenery`.
    needles : share of the trees that are conifers.
    houses, halls, blocks, hangars, towers, silos, forests, trees, lines, fences, cars : least and most of each; lines
        are of poles with wires.
    patches : surfaces of fields, lakes or roads that lie about.
    snow : whether roofs and trees are white on top.
    """

    grounds: tuple[Surface, ...]
    runways: tuple[Surface, ...] = _SMALL_FIELD
    half_width_m: Span = (3.0, 10.0)
    length_m: Span = (250.0, 800.0)
    hills_rad: Span = (0.004, 0.014)
    relief_rad: Span = (0.004, 0.016)
    trees_gap: Span = (0.4, 0.7)
    mosaic: Span = (0.0, 0.5)
    needles: float = 0.3
    houses: Count = (0, 2)
    halls: Count = (0, 1)
    blocks: Count = (0, 0)
    hangars: Count = (0, 1)
    towers: Count = (0, 0)
    silos: Count = (0, 0)
    forests: Count = (0, 2)
    trees: Count = (2, 10)
    lines: Count = (0, 1)
    fences: Count = (0, 2)
    cars: Count = (0, 5)
    patches: tuple[Surface, ...] = ()
    snow: bool = False


SITES = {
    SceneryName.MEADOW: SiteKind(grounds=(Surface.MEADOW, Surface.SHORT_GRASS), patches=(Surface.GRAVEL,)),
    SceneryName.DRY_FIELD: SiteKind(
        grounds=(Surface.DRY_GRASS, Surface.STUBBLE),
        trees_gap=(0.6, 0.85),
        trees=(0, 6),
        forests=(0, 1),
        patches=(Surface.PLOUGHED, Surface.STUBBLE),
    ),
    SceneryName.FARMLAND: SiteKind(
        grounds=(Surface.MEADOW, Surface.CROP),
        mosaic=(0.6, 1.0),
        houses=(1, 4),
        halls=(1, 2),
        silos=(0, 2),
        lines=(0, 2),
        patches=(Surface.PLOUGHED, Surface.CROP, Surface.STUBBLE, Surface.PLOUGHED),
    ),
    SceneryName.FOREST_EDGE: SiteKind(
        grounds=(Surface.MEADOW, Surface.SHORT_GRASS, Surface.DRY_GRASS),
        trees_gap=(0.05, 0.35),
        needles=0.5,
        forests=(2, 5),
        trees=(6, 20),
        mosaic=(0.0, 0.0),
        length_m=(250.0, 600.0),
    ),
    SceneryName.VILLAGE: SiteKind(
        grounds=(Surface.MEADOW, Surface.SHORT_GRASS),
        houses=(10, 26),
        halls=(0, 2),
        towers=(0, 1),
        trees=(10, 24),
        lines=(0, 2),
        fences=(1, 3),
        cars=(2, 9),
        patches=(Surface.ASPHALT,),
    ),
    SceneryName.INDUSTRIAL: SiteKind(
        grounds=(Surface.MEADOW, Surface.GRAVEL, Surface.DRY_GRASS),
        runways=_PAVED,
        houses=(0, 3),
        halls=(5, 11),
        blocks=(2, 6),
        silos=(1, 5),
        lines=(1, 3),
        fences=(1, 3),
        cars=(5, 16),
        forests=(0, 1),
        mosaic=(0.0, 0.0),
        patches=(Surface.CONCRETE, Surface.ASPHALT),
    ),
    SceneryName.AIRPORT: SiteKind(
        grounds=(Surface.SHORT_GRASS, Surface.MEADOW, Surface.DRY_GRASS),
        runways=_PAVED,
        half_width_m=(9.0, 22.0),
        length_m=(700.0, 1800.0),
        hangars=(3, 7),
        halls=(0, 3),
        blocks=(0, 2),
        towers=(1, 1),
        fences=(1, 2),
        cars=(3, 12),
        forests=(0, 1),
        trees=(0, 6),
        patches=(Surface.CONCRETE, Surface.ASPHALT),
    ),
    SceneryName.DESERT: SiteKind(
        grounds=(Surface.SAND,),
        runways=(Surface.ASPHALT, Surface.GRAVEL, Surface.SAND, Surface.CONCRETE),
        trees_gap=(1.0, 1.0),
        hills_rad=(0.006, 0.03),
        relief_rad=(0.01, 0.05),
        forests=(0, 0),
        trees=(0, 2),
        houses=(0, 2),
        mosaic=(0.0, 0.0),
        patches=(Surface.GRAVEL, Surface.SAND),
    ),
    SceneryName.SNOW: SiteKind(
        grounds=(Surface.SNOW,),
        runways=(Surface.ASPHALT, Surface.PACKED_SNOW, Surface.CONCRETE),
        hills_rad=(0.005, 0.05),
        relief_rad=(0.01, 0.06),
        needles=0.8,
        mosaic=(0.0, 0.0),
        snow=True,
    ),
    SceneryName.COAST: SiteKind(
        grounds=(Surface.SAND, Surface.DRY_GRASS, Surface.MEADOW),
        trees_gap=(0.7, 1.0),
        hills_rad=(-0.008, 0.002),
        relief_rad=(0.0, 0.012),
        forests=(0, 1),
        mosaic=(0.0, 0.0),
        patches=(Surface.WATER, Surface.SAND),
    ),
    SceneryName.LAKE: SiteKind(
        grounds=(Surface.MEADOW, Surface.SHORT_GRASS),
        hills_rad=(0.008, 0.04),
        relief_rad=(0.01, 0.05),
        trees_gap=(0.35, 0.6),
        mosaic=(0.0, 0.4),
        patches=(Surface.WATER, Surface.WATER),
    ),
    SceneryName.HILLS: SiteKind(
        grounds=(Surface.MEADOW, Surface.DRY_GRASS),
        hills_rad=(0.04, 0.14),
        relief_rad=(0.04, 0.13),
        trees_gap=(0.3, 0.6),
        forests=(1, 3),
        mosaic=(0.0, 0.6),
        needles=0.5,
    ),
}
