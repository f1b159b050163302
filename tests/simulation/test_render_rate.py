"""The rate of a simulated range follows from what the machine can do."""

from hypothesis import given
from hypothesis import strategies as st

from groundstation.simulation.render_rate import FULL_RATE_HZ, sustainable_rate_hz

SECONDS = st.floats(1e-4, 10.0)


@given(SECONDS, SECONDS, st.floats(1.0, 5.0))
def test_a_slower_machine_never_gets_a_higher_rate(pair_s: float, search_s: float, slower: float) -> None:
    rate = sustainable_rate_hz(pair_s, search_s)
    assert 1.0 <= rate <= FULL_RATE_HZ
    assert sustainable_rate_hz(slower * pair_s, search_s) <= rate
    assert sustainable_rate_hz(pair_s, slower * search_s) <= rate


@given(SECONDS)
def test_rendering_leaves_most_of_the_time_to_the_pipeline(pair_s: float) -> None:
    rate = sustainable_rate_hz(pair_s, 0.01)
    assert rate * pair_s <= 0.3 + 1e-9 or rate == 1.0


def test_a_fast_machine_gets_all_pictures_and_a_slow_search_fewer() -> None:
    assert sustainable_rate_hz(0.009, 0.07) == FULL_RATE_HZ
    assert sustainable_rate_hz(0.02, 0.07) == 15.0
    assert sustainable_rate_hz(0.009, 0.15) < 3.0
