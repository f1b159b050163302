"""Which of a log's positions are left out, and the notes on them."""

from pathlib import Path

import numpy as np

from groundstation.session.logs.fixes import FixQuality, LogFix, ReadingNotes
from groundstation.session.logs.gps_time import TimeScale
from groundstation.session.logs.read import _log


def fix(second: float) -> LogFix:
    where = {"lat_deg": 47.0, "lon_deg": 8.0 + 1e-6 * second, "height_m": 500.0}
    return LogFix(day=16000, second=second, scale=TimeScale.UTC, quality=FixQuality.FIX, **where)


def test_the_last_position_may_be_the_one_whose_time_does_not_increase() -> None:
    for count in (2, 3, 5):
        remarks = ReadingNotes("flight.pos")
        seconds = [float(k) for k in range(count - 1)]
        log = _log(Path("flight.pos"), [fix(s) for s in (*seconds, seconds[-1])], remarks)
        assert len(log.gps_s) == count - 1
        assert remarks.counts == {"position whose time does not grow": (1, f"position {count}")}


def test_one_in_the_middle_is_named_by_its_own_number() -> None:
    remarks = ReadingNotes("flight.pos")
    log = _log(Path("flight.pos"), [fix(s) for s in (0.0, 1.0, 1.0, 2.0)], remarks)
    np.testing.assert_allclose(np.diff(log.gps_s), 1.0)
    assert remarks.counts == {"position whose time does not grow": (1, "position 3")}
