"""`draw_traffic`: birds, another aircraft and cars at random, around one flight and the stations that follow it."""

from collections.abc import Sequence

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.kinds import FAMILIES, AirframeFamily
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.traffic.draw_birds import draw_bird, draw_flock
from groundstation.simulation.traffic.draw_other_aircraft import draw_other_aircraft
from groundstation.simulation.traffic.draw_roads import draw_roads
from groundstation.simulation.traffic.sight_lines import SightLines
from groundstation.simulation.traffic.traffic_spec import TrafficSpec
from groundstation.simulation.trajectory import Trajectory

# of the worlds, those with nothing, birds, another aircraft, cars, and two or all three of these
_SHARES = (0.35, 0.25, 0.1, 0.15, 0.15)
_MIXED = ((True, True, False), (True, False, True), (False, True, True), (True, True, True))
_FLOCKS = 0.4
_MOST_BIRDS = 6


def draw_traffic(
    generator: np.random.Generator,
    *,
    flown: Trajectory,
    eyes_m: Sequence[FloatArray],
    scenery: Scenery,
    duration_s: float,
    families: Sequence[AirframeFamily] = FAMILIES,
) -> TrafficSpec:
    """Draw what else moves in a session of so many s; ``eyes_m`` are of the stations, each (3,) m, runway frame."""
    choice = int(generator.choice(len(_SHARES), p=_SHARES))
    mixture = _MIXED[int(generator.integers(len(_MIXED)))]
    alone = tuple(choice == kind for kind in (1, 2, 3))
    birds, aircraft, cars = mixture if choice == len(_SHARES) - 1 else alone
    lines = SightLines(generator, flown, eyes_m, duration_s)
    flocks = birds and float(generator.uniform()) < _FLOCKS
    count = int(generator.integers(1, _MOST_BIRDS + 1)) if birds else 0
    return TrafficSpec(
        birds=tuple(draw_bird(generator, lines) for _ in range(count)),
        flocks=(draw_flock(generator, lines),) if flocks else (),
        aircraft=draw_other_aircraft(generator, lines, families) if aircraft else (),
        roads=draw_roads(generator, lines, scenery) if cars else (),
    )
