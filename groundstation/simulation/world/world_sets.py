"""The three sets of worlds, separated by their seeds: *train*, *validate* and *test*.

Training and tuning use worlds of *train*; development uses *validate*; *test* is run for a figure
only. Two airframe families, two sceneries and two skies occur in *test* alone, so that its figures show what has never
been seen.
"""

from enum import StrEnum

from groundstation.errors import ScenarioError
from groundstation.simulation.parameter_checks import require

SEEDS_PER_SET = 1_000_000


class WorldSet(StrEnum):
    """Set of a world; the order is that of their seeds."""

    TRAIN = "train"
    VALIDATE = "validate"
    TEST = "test"


def set_of(seed: int) -> WorldSet:
    """Return the set of a seed; raises `ScenarioError` for a seed of none."""
    sets = list(WorldSet)
    number = seed // SEEDS_PER_SET
    if not 0 <= number < len(sets):
        wanted = ", ".join(f"{name} from {k * SEEDS_PER_SET}" for k, name in enumerate(sets))
        raise ScenarioError("world seed", got=str(seed), wanted=f"{wanted}, each with {SEEDS_PER_SET} seeds")
    return sets[number]


def seed_of(world_set: WorldSet, index: int) -> int:
    """Return the seed of a set's world number ``index``, from 0."""
    require(0 <= index < SEEDS_PER_SET, "world index", got=index, wanted=f"0 to {SEEDS_PER_SET - 1}")
    return list(WorldSet).index(world_set) * SEEDS_PER_SET + index
