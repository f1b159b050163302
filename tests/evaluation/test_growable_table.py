"""A table that grows in its place keeps every row, and what was handed out of it."""

import numpy as np

from groundstation.evaluation.growable_table import GrowableTable

ROWS = 5000
DTYPE = np.dtype([("number", "i4"), ("place_m", "f8", 3)])


def test_returned_rows_stay_unchanged_while_the_table_grows() -> None:
    table = GrowableTable(DTYPE)
    assert len(table.rows()) == len(table) == 0
    seen = []
    for k in range(ROWS):
        table.append(k, (k, 2.0 * k, -k))
        if k in (0, 2047, 2048, 4097):
            seen.append(table.rows())
    assert len(table) == ROWS
    np.testing.assert_array_equal(table.rows()["number"], np.arange(ROWS))
    np.testing.assert_array_equal(table.rows()["place_m"], np.outer(np.arange(ROWS), [1.0, 2.0, -1.0]))
    for rows, count in zip(seen, (1, 2048, 2049, 4098), strict=True):
        np.testing.assert_array_equal(rows["number"], np.arange(count))


def test_there_is_hardly_more_memory_than_rows() -> None:
    table = GrowableTable(DTYPE)
    for k in range(ROWS):
        table.append(k, (0.0, 0.0, 0.0))
    assert ROWS * DTYPE.itemsize <= table.nbytes < (ROWS + 2048) * DTYPE.itemsize
    assert table.rows().base is not None
