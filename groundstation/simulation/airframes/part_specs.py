"""The parameters of fuselage, wing, tail and foreplane; all lengths are in wing spans."""

import math
from dataclasses import dataclass

from groundstation.simulation.airframes.kinds import TailKind
from groundstation.simulation.parameter_checks import require, require_within


@dataclass(frozen=True, slots=True, kw_only=True)
class HullSpec:
    """The fuselage, or the pod.

    Attributes
    ----------
    length_per_span, width_per_span, height_per_span : in wing spans.
    bluntness : of the nose, 0 pointed to 1 round.
    squareness : of the section, 0 an ellipse to 1 nearly a box.
    full_from, full_to : between which shares of the length it is as wide as it gets.
    end_share : how wide its end is, of its width.
    taper_power : 1 tapers evenly towards the end, 3 becomes a thin boom soon.
    rise, end_rise : how far its middle and its end are above the nose, in heights.
    canopy_share : the length of the canopy, of the fuselage's; 0 has none.
    sensor_ball : whether a ball for a camera is under the nose.
    """

    length_per_span: float = 0.7
    width_per_span: float = 0.085
    height_per_span: float = 0.11
    bluntness: float = 0.5
    squareness: float = 0.3
    full_from: float = 0.22
    full_to: float = 0.45
    end_share: float = 0.25
    taper_power: float = 1.2
    rise: float = 0.1
    end_rise: float = 0.2
    canopy_share: float = 0.0
    sensor_ball: bool = False

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "length_per_span": (0.1, 2.0),
                "width_per_span": (0.01, 0.4),
                "height_per_span": (0.01, 0.4),
                "bluntness": (0.0, 1.0),
                "squareness": (0.0, 1.0),
                "full_from": (0.02, 0.8),
                "full_to": (self.full_from, 0.95),
                "end_share": (0.02, 1.0),
                "taper_power": (0.5, 6.0),
                "rise": (-0.5, 0.5),
                "end_rise": (-0.5, 1.0),
                "canopy_share": (0.0, 0.6),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WingSpec:
    """The wing.

    Attributes
    ----------
    aspect_ratio : span squared by area.
    taper : chord of the tip by that of the root.
    straight_share : of the half span, from the root outwards, before it tapers.
    sweep_rad : of the leading edge, backwards.
    dihedral_rad, tip_dihedral_rad : of the straight and of the tapered part.
    thickness : of the section, in chords.
    lead_per_span : the root's leading edge behind the nose.
    height : of the root in the fuselage, −1 at its bottom to 1 at its top.
    winglet_per_span : how high winglets are; 0 has none.
    winglet_cant_rad : how far winglets lean outward.
    struts : whether it has struts.
    """

    aspect_ratio: float = 6.5
    taper: float = 0.8
    straight_share: float = 0.4
    sweep_rad: float = 0.0
    dihedral_rad: float = 0.03
    tip_dihedral_rad: float = 0.03
    thickness: float = 0.12
    lead_per_span: float = 0.2
    height: float = 0.9
    winglet_per_span: float = 0.0
    winglet_cant_rad: float = 0.1
    struts: bool = False

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "aspect_ratio": (1.0, 40.0),
                "taper": (0.03, 1.0),
                "straight_share": (0.0, 1.0),
                "sweep_rad": (-0.6, 1.3),
                "dihedral_rad": (-0.3, 0.5),
                "tip_dihedral_rad": (-0.3, 0.7),
                "thickness": (0.03, 0.25),
                "lead_per_span": (0.0, 1.5),
                "height": (-1.0, 1.0),
                "winglet_per_span": (0.0, 0.25),
                "winglet_cant_rad": (-0.3, 1.2),
            },
        )
        tip = self.lead_per_span + 0.5 * math.tan(self.sweep_rad)
        require(tip >= 0.0, "WingSpec: sweep_rad", got=f"{self.sweep_rad:g}", wanted="a wing tip behind the nose")

    @property
    def root_chord(self) -> float:
        """Chord at the root, in spans."""
        mean = self.straight_share + (1.0 - self.straight_share) * 0.5 * (1.0 + self.taper)
        return 1.0 / (self.aspect_ratio * mean)

    def chord(self, outward: float) -> float:
        """Return the chord at a share of the half span, in spans."""
        tapered = max(outward - self.straight_share, 0.0) / max(1.0 - self.straight_share, 1e-9)
        return self.root_chord * (1.0 - (1.0 - self.taper) * tapered)

    def lead(self, outward: float) -> float:
        """Return how far the leading edge is behind the nose at a share of the half span, in spans."""
        return self.lead_per_span + 0.5 * outward * math.tan(self.sweep_rad)

    def rise(self, outward: float) -> float:
        """Return how far the wing is above its root at a share of the half span, in spans."""
        inner = min(outward, self.straight_share)
        return 0.5 * (inner * math.tan(self.dihedral_rad) + (outward - inner) * math.tan(self.tip_dihedral_rad))


@dataclass(frozen=True, slots=True, kw_only=True)
class TailSpec:
    """Tailplane and fins, or the V that is both.

    Attributes
    ----------
    kind : how they are arranged.
    end_per_span : their trailing edges' roots behind the nose.
    area_share : of the tailplane, or of the whole V, in wing areas.
    aspect_ratio, taper, sweep_rad : of the tailplane or the V; the sweep is the leading edge's.
    fin_area_share : of all fins, in wing areas.
    fin_aspect_ratio, fin_taper, fin_sweep_rad : of each fin, its height squared by its area.
    v_angle_rad : dihedral of the halves of a V tail.
    fin_spacing_per_span : between twin fins, or between booms.
    """

    kind: TailKind = TailKind.CONVENTIONAL
    end_per_span: float = 0.7
    area_share: float = 0.18
    aspect_ratio: float = 4.0
    taper: float = 0.8
    sweep_rad: float = 0.1
    fin_area_share: float = 0.09
    fin_aspect_ratio: float = 1.3
    fin_taper: float = 0.6
    fin_sweep_rad: float = 0.4
    v_angle_rad: float = 0.6
    fin_spacing_per_span: float = 0.25

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "end_per_span": (0.1, 2.0),
                "area_share": (0.0, 0.6),
                "aspect_ratio": (1.0, 10.0),
                "taper": (0.1, 1.0),
                "sweep_rad": (-0.5, 1.2),
                "fin_area_share": (0.0, 0.4),
                "fin_aspect_ratio": (0.4, 4.0),
                "fin_taper": (0.1, 1.0),
                "fin_sweep_rad": (-0.3, 1.2),
                "v_angle_rad": (0.2, 1.2),
                "fin_spacing_per_span": (0.02, 0.9),
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeplaneSpec:
    """The foreplane of a canard.

    Attributes
    ----------
    lead_per_span : its root's leading edge behind the nose.
    area_share : in wing areas.
    aspect_ratio, taper, sweep_rad : of the plane; the sweep is the leading edge's.
    height : of the root in the fuselage, −1 at its bottom to 1 at its top.
    """

    lead_per_span: float = 0.05
    area_share: float = 0.16
    aspect_ratio: float = 5.0
    taper: float = 0.7
    sweep_rad: float = 0.1
    height: float = 0.2

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "lead_per_span": (0.0, 1.0),
                "area_share": (0.02, 0.6),
                "aspect_ratio": (1.0, 10.0),
                "taper": (0.1, 1.0),
                "sweep_rad": (0.0, 1.2),
                "height": (-1.0, 1.0),
            },
        )
