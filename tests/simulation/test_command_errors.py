"""Commands of a head that differ from the bearing of its target."""

import math

import numpy as np
import pytest

from groundstation.errors import ScenarioError
from groundstation.simulation.command_errors import NO_COMMAND_ERRORS, CommandErrors
from groundstation.simulation.trajectory import SampledTrajectory

T = np.arange(0.0, 10.0, 0.1)
BEARING = np.column_stack([0.1 * T, -0.02 * T])


def test_no_errors_command_the_bearing() -> None:
    assert np.array_equal(NO_COMMAND_ERRORS.commanded(T, BEARING), BEARING)


def test_a_stall_keeps_the_last_command() -> None:
    given = CommandErrors(stalls=((2.0, 3.0), (5.0, 5.5))).commanded(T, BEARING)
    held = (T > 2.01) & (T < 2.99)
    assert given[held] == pytest.approx(np.tile([0.19, -0.038], (held.sum(), 1)), abs=0.011)
    assert np.ptp(given[held], axis=0) == pytest.approx(0.0)
    free = (T < 1.9) | ((T > 3.05) & (T < 4.9)) | (T > 5.55)
    assert np.array_equal(given[free], BEARING[free])


def test_a_late_head_waits_off_the_bearing_at_which_it_begins() -> None:
    given = CommandErrors(late_until_s=4.0, late_by_rad=(0.2, -0.1)).commanded(T, BEARING)
    assert given[T < 3.95] == pytest.approx(np.tile([0.6, -0.18], (40, 1)))
    assert np.array_equal(given[T > 4.05], BEARING[T > 4.05])


def test_a_head_that_is_late_for_the_whole_flight() -> None:
    given = CommandErrors(late_until_s=100.0).commanded(T, BEARING)
    assert given == pytest.approx(np.tile(BEARING[-1], (T.size, 1)))


def test_a_deviation_is_added() -> None:
    off = SampledTrajectory(
        t_s=T, position_m=np.tile([0.01, 0.02, 9.0], (T.size, 1)), velocity_m_s=np.zeros((T.size, 3))
    )
    given = CommandErrors(deviation=off).commanded(T, BEARING)
    assert given - BEARING == pytest.approx(np.tile([0.01, 0.02], (T.size, 1)))


def test_bad_errors_are_refused() -> None:
    with pytest.raises(ScenarioError, match="CommandErrors: stalls: got 3 to 2 s; wanted an end after the start"):
        CommandErrors(stalls=((3.0, 2.0),))
    with pytest.raises(ScenarioError, match="CommandErrors: late_by_rad: got nan"):
        CommandErrors(late_by_rad=(math.nan, 0.0))
