"""The parameters of an airframe: plain values, all lengths in wing spans, so that one size factor scales it."""

from dataclasses import dataclass, field

from groundstation.simulation.airframes.equipment_specs import GearSpec, LightsSpec, PropellerSpec
from groundstation.simulation.airframes.kinds import AirframeFamily, PropellerKind, TailKind
from groundstation.simulation.airframes.livery import LiverySpec
from groundstation.simulation.airframes.part_specs import ForeplaneSpec, HullSpec, TailSpec, WingSpec
from groundstation.simulation.parameter_checks import require, require_within

MIN_SPAN_M, MAX_SPAN_M = 0.3, 30.0

# which tails a family may have; the others are not bound to one
_TAILS: dict[AirframeFamily, tuple[TailKind, ...]] = {
    AirframeFamily.TWIN_BOOM: (TailKind.TWIN_FIN, TailKind.INVERTED_V),
    AirframeFamily.V_TAIL: (TailKind.V, TailKind.INVERTED_V),
    AirframeFamily.T_TAIL: (TailKind.T,),
    AirframeFamily.FLYING_WING: (TailKind.NONE, TailKind.FIN, TailKind.TWIN_FIN),
    AirframeFamily.DELTA: (TailKind.NONE, TailKind.FIN, TailKind.TWIN_FIN),
    AirframeFamily.CANARD: (TailKind.NONE, TailKind.FIN, TailKind.TWIN_FIN),
}
# the boom and the gap to a propeller's tips
_BOOM_ROOM = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class AirframeSpec:
    """An airframe.

    Attributes
    ----------
    family : what kind of an aircraft it is.
    span_m : from wing tip to wing tip.
    hull, wing, tail, propeller, gear, livery, lights : its parts.
    foreplane : of a canard; None of all others.
    """

    family: AirframeFamily = AirframeFamily.HIGH_WING
    span_m: float = 2.3
    hull: HullSpec = field(default_factory=HullSpec)
    wing: WingSpec = field(default_factory=WingSpec)
    tail: TailSpec = field(default_factory=TailSpec)
    foreplane: ForeplaneSpec | None = None
    propeller: PropellerSpec = field(default_factory=PropellerSpec)
    gear: GearSpec = field(default_factory=GearSpec)
    livery: LiverySpec = field(default_factory=LiverySpec)
    lights: LightsSpec = field(default_factory=LightsSpec)

    def __post_init__(self) -> None:
        require_within(self, {"span_m": (MIN_SPAN_M, MAX_SPAN_M)})
        tails = _TAILS.get(self.family)
        if tails is not None:
            wanted = f"for {self.family}: " + " or ".join(tails)
            require(self.tail.kind in tails, "AirframeSpec: tail.kind", got=self.tail.kind, wanted=wanted)
        canard = self.family is AirframeFamily.CANARD
        wanted = "one for a canard, none for other families"
        require((self.foreplane is not None) == canard, "AirframeSpec: foreplane", got=self.foreplane, wanted=wanted)
        lead, length = self.wing.lead_per_span, self.hull.length_per_span
        joined = lead + 0.25 * self.wing.root_chord <= length
        wanted = f"a wing that touches the fuselage, {length:g} long"
        require(joined, "AirframeSpec: wing.lead_per_span", got=f"{lead:g}", wanted=wanted)
        self._check_tail_and_propeller()

    def _check_tail_and_propeller(self) -> None:
        tail, radius = self.tail, self.propeller.radius_per_span
        if self.has_booms:
            wing_end = self.wing.lead_per_span + 0.5 * self.wing.root_chord
            wanted = f"behind the wing, at {wing_end:.3g} or more"
            require(
                tail.end_per_span >= wing_end, "AirframeSpec: tail.end_per_span", got=tail.end_per_span, wanted=wanted
            )
            if self.propeller.kind is PropellerKind.PUSHER:
                most = 0.5 * tail.fin_spacing_per_span - _BOOM_ROOM
                wanted = f"at most {most:.3g}, between the booms"
                require(radius <= most, "AirframeSpec: propeller.radius_per_span", got=f"{radius:g}", wanted=wanted)
        elif tail.kind is not TailKind.NONE:
            most = self.hull.length_per_span + 0.05
            wanted = f"at the fuselage, at most {most:.3g}"
            require(tail.end_per_span <= most, "AirframeSpec: tail.end_per_span", got=tail.end_per_span, wanted=wanted)

    @property
    def has_booms(self) -> bool:
        """Whether booms carry the tail."""
        return self.family is AirframeFamily.TWIN_BOOM
