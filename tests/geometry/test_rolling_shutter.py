"""The times at which a rolling shutter exposes its rows."""

import numpy as np

from groundstation.geometry.rolling_shutter import exposed_row_delay_s, row_delay_s, row_share


def test_middle_row_is_exposed_at_the_stamp() -> None:
    assert row_delay_s(239.5, 480, 0.02) == 0.0


def test_first_and_last_row_are_one_readout_less_a_row_apart() -> None:
    assert np.isclose(row_delay_s(479.0, 480, 0.02) - row_delay_s(0.0, 480, 0.02), 0.02 * 479 / 480)


def test_negative_readout_exposes_the_last_row_first() -> None:
    assert row_delay_s(479.0, 480, -0.02) < row_delay_s(0.0, 480, -0.02)


def test_rows_outside_the_picture_keep_the_delay_of_its_border_on_request() -> None:
    rows = np.array([-600.0, -0.5, 239.5, 479.5, 900.0])
    assert np.allclose(exposed_row_delay_s(rows, 480, 0.02), [-0.01, -0.01, 0.0, 0.01, 0.01])
    assert np.allclose(row_share(rows[[0, 4]], 480), [-1.7490, 1.3760], atol=1e-4)
