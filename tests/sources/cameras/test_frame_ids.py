"""Frame numbers unwrapped: whatever a camera's counter does, each lost frame is counted once."""

from hypothesis import given
from hypothesis import strategies as st

from groundstation.sources.cameras.frame_ids import FrameNumbers, FrameOrder

steps = st.lists(st.integers(1, 3000), min_size=1, max_size=120)


def sixteen_bits(count: int) -> int:
    """GigE Vision's number of a frame counted from 0: 1 … 65535, never 0."""
    return count % 65535 + 1


@given(start=st.integers(0, 200_000), steps=steps)
def test_sixteen_bits_without_zero(start: int, steps: list[int]) -> None:
    numbers = FrameNumbers()
    assert numbers.take(sixteen_bits(start)).index == 0
    count = start
    for step in steps:
        count += step
        number = numbers.take(sixteen_bits(count))
        assert number.index == count - start
        assert number.lost == step - 1
        assert number.order is FrameOrder.NEXT


@given(start=st.integers(65_536, 2**63), steps=steps)
def test_sixty_four_bits(start: int, steps: list[int]) -> None:
    numbers = FrameNumbers()
    numbers.take(start)
    count = start
    for step in steps:
        count += step
        number = numbers.take(count)
        assert (number.index, number.lost) == (count - start, step - 1)


def test_a_counter_that_grows_out_of_sixteen_bits() -> None:
    numbers = FrameNumbers()
    assert [numbers.take(i).index for i in (65534, 65535, 65536, 65537, 65540)] == [0, 1, 2, 3, 6]


def test_a_counter_that_uses_zero() -> None:
    numbers = FrameNumbers()
    assert [numbers.take(i).lost for i in (0, 1, 2)] == [0, 0, 0]
    numbers.restart()
    assert [numbers.take(i).lost for i in (65535, 0, 1)] == [0, 0, 0]


def test_what_was_overtaken_neither_counts_as_lost_twice_nor_moves_the_count() -> None:
    numbers = FrameNumbers()
    taken = [numbers.take(i) for i in (10, 12, 11, 12, 13)]
    assert [t.index for t in taken] == [0, 2, 1, 2, 3]
    assert [t.lost for t in taken] == [0, 1, 0, 0, 0]
    assert [t.order for t in taken[2:4]] == [FrameOrder.OVERTAKEN, FrameOrder.REPEATED]


def test_a_camera_that_begins_anew_loses_nothing_by_it() -> None:
    numbers = FrameNumbers()
    taken = [numbers.take(i) for i in (5000, 5001, 1, 2)]
    assert [t.index for t in taken] == [0, 1, 2, 3]
    assert taken[2].order is FrameOrder.RESTARTED
    numbers.restart()
    assert (numbers.take(900).index, numbers.take(901).index) == (4, 5)


def test_a_camera_without_numbers_is_counted() -> None:
    numbers = FrameNumbers()
    assert [numbers.take(None).index for _ in range(3)] == [0, 1, 2]
