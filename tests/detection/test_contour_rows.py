"""Whether the contour may pass through a row, from how many pixels of it and of its neighbours are inside."""

import numpy as np
import pytest

from groundstation.detection.contour_evolution import crossed


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ((0, 0, 0), False),
        ((0, 0, 3), True),
        ((3, 0, 0), True),
        ((0, 3, 0), True),
        ((8, 8, 8), False),
        ((8, 8, 7), True),
        ((7, 8, 8), True),
        ((8, 0, 0), True),
    ],
)
def test_a_row_is_skipped_only_between_rows_of_its_own_kind(rows: tuple[int, int, int], expected: bool) -> None:
    assert crossed(np.array(rows, np.int32), 1, 8) is expected


def test_beyond_the_picture_there_is_the_row_itself() -> None:
    rows = np.array([0, 0, 5, 8, 8], np.int32)
    assert [crossed(rows, i, 8) for i in range(5)] == [False, True, True, True, False]
