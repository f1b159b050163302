"""Assignment of clips to sets of seeds: each clip is in one set, so that no training uses a picture of *validate*."""

import re

from groundstation.errors import ScenarioError
from groundstation.simulation.world.world_sets import WorldSet

# by the number in the clip's name; there are no clips of *test*
CLIP_NUMBERS = {WorldSet.TRAIN: range(1, 21), WorldSet.VALIDATE: range(21, 33)}


def set_of_clip(clip: str) -> WorldSet:
    """Return the set of a clip; raises `ScenarioError` for a clip of none."""
    number = re.fullmatch(r".*?(\d+)", clip)
    for world_set, numbers in CLIP_NUMBERS.items():
        if number is not None and int(number[1]) in numbers:
            return world_set
    raise ScenarioError(f"clip {clip}", got="a clip of no set", wanted=_ranges())


def require_clip_of(world_set: WorldSet, clip: str) -> None:
    """Raise `ScenarioError` unless a clip belongs to a set."""
    found = set_of_clip(clip)
    if found is not world_set:
        wanted = f"a clip of {world_set}: {_ranges()}"
        raise ScenarioError(f"clip {clip} in a composite of {world_set}", got=f"a clip of {found}", wanted=wanted)


def _ranges() -> str:
    return ", ".join(f"{name} has {n[0]:03d} to {n[-1]:03d}" for name, n in CLIP_NUMBERS.items())
