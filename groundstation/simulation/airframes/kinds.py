"""The kinds of airframes, tails, propellers and gears."""

from enum import StrEnum


class AirframeFamily(StrEnum):
    """Kind of the aircraft."""

    HIGH_WING = "high-wing"
    LOW_WING = "low-wing"
    TWIN_BOOM = "twin-boom"
    V_TAIL = "v-tail"
    T_TAIL = "t-tail"
    GLIDER = "glider"
    FLYING_WING = "flying-wing"
    DELTA = "delta"
    CANARD = "canard"


FAMILIES = tuple(AirframeFamily)


class TailKind(StrEnum):
    """Arrangement of tailplane and fins."""

    NONE = "none"
    CONVENTIONAL = "conventional"
    T = "t"
    V = "v"
    INVERTED_V = "inverted-v"
    TWIN_FIN = "twin-fin"
    FIN = "fin"


class PropellerKind(StrEnum):
    """Position of the propellers; a pair is on the wings, in front."""

    NONE = "none"
    TRACTOR = "tractor"
    PUSHER = "pusher"
    PAIR = "pair"


class GearKind(StrEnum):
    """Kind of the landing gear."""

    NONE = "none"
    TRICYCLE = "tricycle"
    TAIL_WHEEL = "tail-wheel"
    SINGLE_WHEEL = "single-wheel"
    SKIDS = "skids"
