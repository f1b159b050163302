"""Placement of a drawn scenery's objects: clear of the runway's strip and below its approaches."""

import math

import numpy as np

from groundstation.simulation.scenery.drawn_sites import Count, SiteKind
from groundstation.simulation.scenery.scenery_objects import ObjectKind, SceneryObject
from groundstation.simulation.scenery.surfaces import Colour

# obstacles under the approach stay below this slope, from the aim mark on
_CLEAR_SLOPE = math.tan(math.radians(1.8))
_APPROACH_HALF_M, _APPROACH_SPREAD = 45.0, 0.08
_STRIP_M = 9.0
_POLE_EVERY_M = 45.0
_WHITE, _GREY, _STEEL = (196.0, 200.0, 204.0), (150.0, 152.0, 154.0), (176.0, 168.0, 160.0)
_WALLS = (_WHITE, (170.0, 190.0, 204.0), (120.0, 150.0, 180.0), (90.0, 110.0, 150.0), (150.0, 170.0, 180.0))
_ROOFS = ((52.0, 62.0, 128.0), (60.0, 66.0, 84.0), (74.0, 72.0, 70.0), (48.0, 74.0, 112.0))
_SHEETS = (_STEEL, _GREY, (160.0, 120.0, 70.0), (96.0, 124.0, 92.0), (120.0, 160.0, 190.0), (60.0, 70.0, 130.0))
_PAINTS = (_WHITE, _GREY, (40.0, 40.0, 42.0), (40.0, 36.0, 160.0), (130.0, 70.0, 30.0), (70.0, 90.0, 60.0))
_LEAVES: tuple[tuple[Colour, Colour], ...] = (
    ((66.0, 112.0, 92.0), (28.0, 46.0, 38.0)),
    ((62.0, 128.0, 112.0), (26.0, 50.0, 46.0)),
    ((72.0, 104.0, 78.0), (32.0, 44.0, 34.0)),
    ((52.0, 116.0, 148.0), (28.0, 48.0, 64.0)),
)
_NEEDLES: tuple[tuple[Colour, Colour], ...] = (
    ((60.0, 88.0, 64.0), (26.0, 38.0, 28.0)),
    ((74.0, 96.0, 66.0), (30.0, 42.0, 30.0)),
)
_FROSTED: tuple[Colour, Colour] = ((200.0, 198.0, 194.0), (66.0, 72.0, 66.0))


class ObjectPlan:
    """Draws the objects around one runway.

    Parameters
    ----------
    generator : of all draws.
    site : the objects and surfaces.
    half_width_m, end_y_m, aim_y_m : the runway.
    """

    def __init__(
        self, generator: np.random.Generator, site: SiteKind, half_width_m: float, end_y_m: float, aim_y_m: float
    ) -> None:
        self._generator, self._site = generator, site
        self._half, self._end, self._aim = half_width_m, end_y_m, aim_y_m

    def objects(self) -> tuple[SceneryObject, ...]:
        """Draw all objects."""
        site = self._site
        made = [*self._wind_sock(), *self._forests()]
        for _ in range(self._count(site.lines)):
            made += self._line()
        for _ in range(self._count(site.fences)):
            made += self._fence()
        for draw, count in (
            (self._house, site.houses),
            (self._hall, site.halls),
            (self._block, site.blocks),
            (self._hangar, site.hangars),
            (self._tower, site.towers),
            (self._silo, site.silos),
            (self._tree, site.trees),
            (self._car, site.cars),
        ):
            made += [draw() for _ in range(self._count(count))]
        return tuple(thing for thing in made if self.is_clear(thing))

    def is_clear(self, thing: SceneryObject) -> bool:
        """Return whether an object is next to the runway's strip and below the approach to it."""
        reach = 0.5 * (thing.length_m * abs(math.sin(thing.heading_rad)) + thing.width_m)
        far = thing.y_m + 0.5 * thing.length_m * abs(math.cos(thing.heading_rad))
        near = abs(thing.x_m) - reach
        if near < self._half + _STRIP_M and far > -30.0 and thing.y_m < self._end + 60.0:
            return False
        under = near < _APPROACH_HALF_M + _APPROACH_SPREAD * max(thing.y_m - self._aim, 0.0)
        low = thing.height_m < max((thing.y_m - self._aim) * _CLEAR_SLOPE, 2.6)
        return low or not under or (thing.height_m < 10.0 and near > self._half + 14.0)

    # ------------------------------------------------------------------------------------------- draws
    def _count(self, span: Count) -> int:
        return int(self._generator.integers(span[0], span[1] + 1))

    def _between(self, low: float, high: float) -> float:
        return float(self._generator.uniform(low, high))

    def _side(self) -> float:
        return -1.0 if self._generator.random() < 0.5 else 1.0

    def _one(self, colours: tuple[Colour, ...]) -> Colour:
        b, g, r = colours[int(self._generator.integers(len(colours)))]
        shade = self._between(0.85, 1.1)
        return min(b * shade, 255.0), min(g * shade, 255.0), min(r * shade, 255.0)

    def _roof(self, colours: tuple[Colour, ...]) -> Colour:
        return _FROSTED[0] if self._site.snow else self._one(colours)

    def _thing(
        self,
        kind: ObjectKind,
        place: tuple[float, float, float],
        size: tuple[float, float, float],
        colour: Colour,
        second: Colour,
    ) -> SceneryObject:
        x, y, heading = place
        length, width, height = size
        return SceneryObject(
            kind=kind,
            x_m=x,
            y_m=y,
            heading_rad=heading,
            length_m=length,
            width_m=width,
            height_m=height,
            colour_bgr=colour,
            second_bgr=second,
        )

    def _beside(self, nearest_m: float, farthest_m: float, heading_rad: float) -> tuple[float, float, float]:
        """Draw a place to the side of the runway; near ones are as frequent as far ones."""
        off = math.exp(self._between(math.log(nearest_m), math.log(farthest_m)))
        y = self._between(30.0, max(0.9 * self._end, 300.0))
        return self._side() * (self._half + off), y, heading_rad

    def _turned(self) -> float:
        """Draw a heading: most objects are aligned with a road or the runway."""
        quarter = 0.5 * math.pi * int(self._generator.integers(4))
        return quarter + float(self._generator.normal(0.0, 0.25))

    def _house(self) -> SceneryObject:
        size = (self._between(9.0, 16.0), self._between(7.0, 10.0), self._between(5.5, 9.5))
        return self._thing(
            ObjectKind.HOUSE, self._beside(45.0, 320.0, self._turned()), size, self._one(_WALLS), self._roof(_ROOFS)
        )

    def _hall(self) -> SceneryObject:
        size = (self._between(20.0, 70.0), self._between(14.0, 34.0), self._between(5.0, 12.0))
        return self._thing(
            ObjectKind.HALL, self._beside(60.0, 380.0, self._turned()), size, self._one(_SHEETS), self._roof(_SHEETS)
        )

    def _block(self) -> SceneryObject:
        size = (self._between(14.0, 45.0), self._between(11.0, 18.0), self._between(7.0, 26.0))
        return self._thing(
            ObjectKind.BLOCK,
            self._beside(90.0, 450.0, self._turned()),
            size,
            self._one(_WALLS),
            (66.0, 58.0, 52.0),
        )

    def _hangar(self) -> SceneryObject:
        size = (self._between(14.0, 34.0), self._between(12.0, 30.0), self._between(6.0, 11.0))
        x, y, _ = self._beside(32.0, 110.0, 0.0)
        heading = math.copysign(0.5 * math.pi, -x)
        return self._thing(ObjectKind.HANGAR, (x, y, heading), size, self._one(_SHEETS), self._roof(_SHEETS))

    def _tower(self) -> SceneryObject:
        side = self._between(4.0, 7.0)
        size = (side, side, self._between(12.0, 26.0))
        return self._thing(ObjectKind.TOWER, self._beside(50.0, 160.0, 0.0), size, self._one(_WALLS), _WHITE)

    def _silo(self) -> SceneryObject:
        if self._generator.random() < 0.35:
            wide = self._between(1.5, 4.0)
            size = (wide, wide, self._between(22.0, 60.0))
            return self._thing(
                ObjectKind.CHIMNEY, self._beside(150.0, 450.0, 0.0), size, self._one(_WALLS), (60.0, 60.0, 60.0)
            )
        wide = self._between(3.0, 8.0)
        size = (wide, wide, self._between(7.0, 18.0))
        return self._thing(ObjectKind.SILO, self._beside(50.0, 300.0, 0.0), size, self._one(_SHEETS), _GREY)

    def _foliage(self) -> tuple[bool, Colour, Colour]:
        """Draw whether it is a conifer, and its colours."""
        needles = bool(self._generator.random() < self._site.needles)
        kinds = _NEEDLES if needles else _LEAVES
        bright, dark = kinds[int(self._generator.integers(len(kinds)))]
        if self._site.snow:
            bright, dark = ((150.0, 152.0, 148.0), dark) if needles else ((132.0, 136.0, 138.0), (70.0, 76.0, 80.0))
        return needles, bright, dark

    def _tree(self) -> SceneryObject:
        needles, bright, dark = self._foliage()
        height = self._between(5.0, 17.0)
        wide = height * (self._between(0.3, 0.45) if needles else self._between(0.6, 0.95))
        kind = ObjectKind.CONIFER if needles else ObjectKind.TREE
        return self._thing(kind, self._beside(16.0, 260.0, 0.0), (wide, wide, height), bright, dark)

    def _car(self) -> SceneryObject:
        place = self._beside(9.5, 70.0, self._turned())
        if self._generator.random() < 0.25:
            size = (self._between(4.8, 6.5), 2.0, self._between(1.9, 2.7))
            return self._thing(ObjectKind.VAN, place, size, self._one(_PAINTS), _GREY)
        if self._generator.random() < 0.15:
            return self._thing(ObjectKind.CONTAINER, place, (6.1, 2.44, 2.6), self._one(_SHEETS), _GREY)
        size = (self._between(3.8, 4.9), 1.8, self._between(1.4, 1.7))
        return self._thing(ObjectKind.CAR, place, size, self._one(_PAINTS), _GREY)

    # ------------------------------------------------------------------------------------------ groups
    def _wind_sock(self) -> list[SceneryObject]:
        if self._generator.random() < 0.35:
            return []
        place = (self._side() * (self._half + self._between(9.5, 30.0)), self._between(25.0, 200.0), self._turned())
        size = (self._between(1.6, 3.2), self._between(0.4, 0.8), self._between(4.0, 8.0))
        return [self._thing(ObjectKind.WIND_SOCK, place, size, (30.0, 100.0, 236.0), (226.0, 228.0, 230.0))]

    def _forests(self) -> list[SceneryObject]:
        made: list[SceneryObject] = []
        for _ in range(self._count(self._site.forests)):
            needles, bright, dark = self._foliage()
            kind = ObjectKind.CONIFERS if needles else ObjectKind.FOREST
            height, deep, length = self._between(9.0, 22.0), self._between(8.0, 30.0), self._between(150.0, 700.0)
            if self._generator.random() < 0.4:
                y = max(self._end + 90.0, self._aim + height / _CLEAR_SLOPE) + self._between(0.0, 400.0)
                heading = 0.5 * math.pi + float(self._generator.normal(0.0, 0.15))
                place = (float(self._generator.normal(0.0, 120.0)), y, heading)
            else:
                x, y, _ = self._beside(45.0, 240.0, 0.0)
                place = (x, y, float(self._generator.normal(0.0, 0.08)))
            made.append(self._thing(kind, place, (length, deep, height), bright, dark))
        return made

    def _line(self) -> list[SceneryObject]:
        """Draw a line of poles with wires: along the runway, or across beyond its end."""
        height, count = self._between(6.5, 11.0), self._count((4, 9))
        wood = self._one(((84.0, 104.0, 118.0), _GREY))
        if self._generator.random() < 0.3:
            heading = 0.5 * math.pi + float(self._generator.normal(0.0, 0.2))
            start = (-0.5 * count * _POLE_EVERY_M, max(self._end + 120.0, self._aim + height / _CLEAR_SLOPE) + 60.0)
        else:
            heading = float(self._generator.normal(0.0, 0.2))
            start = (self._side() * (self._half + self._between(20.0, 150.0)), self._between(15.0, 90.0))
        sine, cosine = math.sin(heading), math.cos(heading)
        made: list[SceneryObject] = []
        for k in range(count):
            x, y = start[0] + k * _POLE_EVERY_M * sine, start[1] + k * _POLE_EVERY_M * cosine
            made.append(self._thing(ObjectKind.POLE, (x, y, 0.0), (0.28, 0.28, height), wood, wood))
            if k + 1 < count:
                middle = (x + 0.5 * _POLE_EVERY_M * sine, y + 0.5 * _POLE_EVERY_M * cosine, heading)
                for lower in (0.1, 0.7):
                    size = (_POLE_EVERY_M, 0.025, height - lower)
                    made.append(self._thing(ObjectKind.WIRE, middle, size, (46.0, 46.0, 46.0), _GREY))
        return made

    def _fence(self) -> list[SceneryObject]:
        wood = self._one(((96.0, 112.0, 124.0), _GREY, (60.0, 70.0, 80.0)))
        x = self._side() * (self._half + self._between(12.0, 60.0))
        length = self._between(60.0, 400.0)
        place = (x, 0.5 * length + self._between(8.0, 80.0), float(self._generator.normal(0.0, 0.03)))
        kind = ObjectKind.HEDGE if self._generator.random() < 0.25 else ObjectKind.FENCE
        if kind is ObjectKind.HEDGE:
            bright, dark = _LEAVES[int(self._generator.integers(len(_LEAVES)))]
            return [self._thing(kind, place, (length, 1.0, self._between(1.0, 2.4)), bright, dark)]
        return [self._thing(kind, place, (length, 0.1, self._between(1.0, 2.2)), wood, wood)]
