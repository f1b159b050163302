"""What there is around a runway: parameters, random draws of them, and their picture as a station sees it."""

from groundstation.simulation.scenery.drawn_sceneries import SCENERIES, SKIES, draw_scenery
from groundstation.simulation.scenery.scenery import Scenery, SceneryName, SkyName
from groundstation.simulation.scenery.surroundings import (
    FineRange,
    Surroundings,
    fine_panorama,
    fine_range_around,
    surroundings_of,
)

__all__ = [
    "SCENERIES",
    "SKIES",
    "FineRange",
    "Scenery",
    "SceneryName",
    "SkyName",
    "Surroundings",
    "draw_scenery",
    "fine_panorama",
    "fine_range_around",
    "surroundings_of",
]
