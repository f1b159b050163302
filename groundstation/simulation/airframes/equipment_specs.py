"""The parameters of propellers, gear and lights; all lengths are in wing spans."""

from dataclasses import dataclass

from groundstation.simulation.airframes.kinds import GearKind, PropellerKind
from groundstation.simulation.airframes.mesh import Colour
from groundstation.simulation.parameter_checks import (
    require,
    require_finite,
    require_fraction,
    require_not_negative,
    require_positive,
    require_within,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PropellerSpec:
    """Propellers, as an exposure smears them.

    Attributes
    ----------
    kind : where they are.
    radius_per_span : of each.
    blades : of each, 2 to 6.
    smear_share : of the angle between two blades that the exposure smears; 1 is an even disc.
    opacity : of the even disc; smeared blades are denser.
    phase_rad : where the first blade's smear begins.
    colour_bgr : of the blades.
    """

    kind: PropellerKind = PropellerKind.TRACTOR
    radius_per_span: float = 0.1
    blades: int = 2
    smear_share: float = 1.0
    opacity: float = 0.15
    phase_rad: float = 0.0
    colour_bgr: Colour = (40.0, 40.0, 40.0)

    def __post_init__(self) -> None:
        require_within(self, {"radius_per_span": (0.02, 0.3), "smear_share": (0.02, 1.0), "opacity": (0.01, 1.0)})
        require_finite("PropellerSpec: phase_rad", self.phase_rad)
        fits = isinstance(self.blades, int) and 2 <= self.blades <= 6
        require(fits, "PropellerSpec: blades", got=self.blades, wanted="a whole number from 2 to 6")


@dataclass(frozen=True, slots=True, kw_only=True)
class GearSpec:
    """The landing gear.

    Attributes
    ----------
    kind : wheels, skids or nothing.
    clearance_per_span : of all else above the ground.
    track_per_span : between the main wheels, or the skids.
    wheel_per_span, leg_per_span : radius of a main wheel and of its leg.
    """

    kind: GearKind = GearKind.TRICYCLE
    clearance_per_span: float = 0.03
    track_per_span: float = 0.2
    wheel_per_span: float = 0.02
    leg_per_span: float = 0.005

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "clearance_per_span": (0.0, 0.2),
                "track_per_span": (0.02, 0.6),
                "wheel_per_span": (0.003, 0.06),
                "leg_per_span": (0.001, 0.03),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LightsSpec:
    """The lights that are on; intensities in candela, 0 for none.

    Attributes
    ----------
    navigation_cd : red, green and white at the left and right wing tip and the tail.
    strobe_cd : white flashes at the wing tips.
    strobe_period_s, strobe_lit_share : of the flashes.
    landing_cd : white, forward, at the nose.
    """

    navigation_cd: float = 0.0
    strobe_cd: float = 0.0
    strobe_period_s: float = 1.2
    strobe_lit_share: float = 0.08
    landing_cd: float = 0.0

    def __post_init__(self) -> None:
        for name in ("navigation_cd", "strobe_cd", "landing_cd"):
            require_not_negative(f"LightsSpec: {name}", getattr(self, name))
        require_positive("LightsSpec: strobe_period_s", self.strobe_period_s)
        require_fraction("LightsSpec: strobe_lit_share", self.strobe_lit_share)
