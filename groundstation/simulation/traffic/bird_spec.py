"""Birds as plain numbers: size, wing beat, plumage, path; and flocks of them."""

import math
from dataclasses import dataclass

from groundstation.simulation.parameter_checks import require, require_finite, require_within
from groundstation.simulation.scenery.light import require_colour
from groundstation.simulation.scenery.surfaces import Colour
from groundstation.simulation.traffic.arc_path import ArcPath

MOST_MEMBERS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class BirdSpec:
    """A bird that flaps and glides.

    Attributes
    ----------
    span_m : from wing tip to wing tip, wings level.
    length_per_span : from beak to tail.
    chord_per_span : of the wing at its root.
    flap_hz : wing beats per s.
    flap_rad : amplitude of the inner wing's beat; the outer wing follows it with a lag.
    glide_rad : dihedral of the wings while it glides.
    cycle_s, flapping_share : it flaps for that share of each cycle, and glides for the rest.
    phase : cycles that have passed at time 0.
    back_bgr, belly_bgr, tip_bgr : plumage above, below, and of the outer wings' ends.
    path : of the middle of its body.
    """

    span_m: float = 0.9
    length_per_span: float = 0.5
    chord_per_span: float = 0.2
    flap_hz: float = 4.0
    flap_rad: float = math.radians(35.0)
    glide_rad: float = math.radians(5.0)
    cycle_s: float = 3.0
    flapping_share: float = 0.6
    phase: float = 0.0
    back_bgr: Colour = (38.0, 38.0, 40.0)
    belly_bgr: Colour = (52.0, 52.0, 54.0)
    tip_bgr: Colour = (26.0, 26.0, 28.0)
    path: ArcPath

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "span_m": (0.1, 4.0),
                "length_per_span": (0.2, 1.5),
                "chord_per_span": (0.05, 0.5),
                "flap_hz": (0.0, 30.0),
                "flap_rad": (0.0, math.radians(80.0)),
                "glide_rad": (math.radians(-30.0), math.radians(45.0)),
                "cycle_s": (0.2, 60.0),
                "flapping_share": (0.0, 1.0),
            },
        )
        require_finite("BirdSpec: phase", self.phase)
        for name in ("back_bgr", "belly_bgr", "tip_bgr"):
            require_colour(f"BirdSpec: {name}", getattr(self, name))


@dataclass(frozen=True, slots=True, kw_only=True)
class FlockSpec:
    """Birds of one kind that fly together.

    Attributes
    ----------
    bird : each of them, at the flock's middle.
    offsets_m : where each is to the flock's middle: ahead, to the right, up.
    phases : of each bird's cycle of flapping and gliding, added to the bird's own.
    sway_m, sway_s : amplitude and period of each bird's drift about its place.
    """

    bird: BirdSpec
    offsets_m: tuple[tuple[float, float, float], ...]
    phases: tuple[float, ...]
    sway_m: float = 0.3
    sway_s: float = 4.0

    def __post_init__(self) -> None:
        count = len(self.offsets_m)
        require(1 <= count <= MOST_MEMBERS, "FlockSpec: offsets_m", got=count, wanted=f"1 to {MOST_MEMBERS} birds")
        got, wanted = len(self.phases), f"{count}, one for each bird"
        require(got == count, "FlockSpec: phases", got=got, wanted=wanted)
        for value in (*self.phases, *(v for offset in self.offsets_m for v in offset)):
            require_finite("FlockSpec: offsets_m, phases", value)
        require_within(self, {"sway_m": (0.0, 20.0), "sway_s": (0.5, 120.0)})
