"""Sets of worlds by their seeds."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import ScenarioError
from groundstation.simulation.world.world_sets import SEEDS_PER_SET, WorldSet, seed_of, set_of


@given(st.sampled_from(WorldSet), st.integers(0, SEEDS_PER_SET - 1))
def test_a_seed_belongs_to_the_set_that_gave_it(world_set: WorldSet, index: int) -> None:
    assert set_of(seed_of(world_set, index)) is world_set


def test_sets_have_fixed_seeds() -> None:
    assert [seed_of(name, 7) for name in WorldSet] == [7, 1_000_007, 2_000_007]
    assert [set_of(s) for s in (0, 999_999, 1_000_000, 2_999_999)] == [
        WorldSet.TRAIN,
        WorldSet.TRAIN,
        WorldSet.VALIDATE,
        WorldSet.TEST,
    ]


@pytest.mark.parametrize("seed", [-1, 3_000_000])
def test_other_seeds_are_refused(seed: int) -> None:
    with pytest.raises(ScenarioError, match="validate from 1000000"):
        set_of(seed)


@pytest.mark.parametrize("index", [-1, SEEDS_PER_SET])
def test_an_index_beyond_the_set_is_refused(index: int) -> None:
    with pytest.raises(ScenarioError, match="world index"):
        seed_of(WorldSet.TEST, index)
