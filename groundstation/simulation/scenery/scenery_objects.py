"""Objects around a runway that hide objects behind them, as plain parameters."""

from dataclasses import dataclass
from enum import StrEnum

from groundstation.simulation.parameter_checks import require_finite, require_positive
from groundstation.simulation.scenery.light import require_colour
from groundstation.simulation.scenery.surfaces import Colour


class ObjectKind(StrEnum):
    """Kind of the object; its length is along its heading."""

    HOUSE = "house"
    BLOCK = "block"
    HALL = "hall"
    HANGAR = "hangar"
    TOWER = "tower"
    SILO = "silo"
    CHIMNEY = "chimney"
    POLE = "pole"
    WIRE = "wire"
    FENCE = "fence"
    CAR = "car"
    VAN = "van"
    CONTAINER = "container"
    WIND_SOCK = "wind-sock"
    TREE = "tree"
    CONIFER = "conifer"
    FOREST = "forest"
    CONIFERS = "conifers"
    HEDGE = "hedge"
    CONE = "cone"


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneryObject:
    """One object that does not move.

    Attributes
    ----------
    kind : of the object.
    x_m, y_m : its middle on the ground, runway frame.
    heading_rad : of its length, from +y towards +x.
    length_m, width_m, height_m : its size; a wire's height is that of its ends, its width what it is thick.
    colour_bgr, second_bgr : its own colours; the second is of roofs, windows, trunks and stripes.
    """

    kind: ObjectKind
    x_m: float
    y_m: float
    heading_rad: float = 0.0
    length_m: float
    width_m: float
    height_m: float
    colour_bgr: Colour
    second_bgr: Colour = (60.0, 60.0, 60.0)

    def __post_init__(self) -> None:
        for name in ("x_m", "y_m", "heading_rad"):
            require_finite(f"SceneryObject: {name}", getattr(self, name))
        for name in ("length_m", "width_m", "height_m"):
            require_positive(f"SceneryObject: {name}", getattr(self, name))
        require_colour("SceneryObject: colour_bgr", self.colour_bgr)
        require_colour("SceneryObject: second_bgr", self.second_bgr)
