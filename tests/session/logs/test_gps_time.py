"""GPS time and UTC: the leap seconds, and texts."""

import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.session.logs.gps_time import (
    TimeScale,
    civil_from_unix,
    day_number,
    gps_from_civil,
    gps_from_datetime,
    gps_from_text,
    leap_seconds,
    utc_day,
    utc_text,
)


@pytest.mark.parametrize(
    ("date", "seconds"),
    [
        ((1980, 1, 6), 0),
        ((1981, 7, 1), 1),
        ((1999, 1, 1), 13),
        ((2008, 12, 31), 14),
        ((2016, 12, 31), 17),
        ((2017, 1, 1), 18),
        ((2026, 5, 17), 18),
    ],
)
def test_leap_seconds_of_the_bulletins(date: tuple[int, int, int], seconds: int) -> None:
    assert leap_seconds(day_number(*date)) == seconds


@pytest.mark.parametrize("date", [(2026, 2, 29), (2026, 13, 1), (0, 1, 1), (10**30, 1, 1)])
def test_a_date_that_does_not_exist_is_a_value_error_however_large(date: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match=r"out of range|must be in|day is"):
        day_number(*date)


def test_a_leap_second_is_a_separate_second() -> None:
    texts = ["2016-12-31T23:59:59.5Z", "2016-12-31T23:59:60.5Z", "2017-01-01T00:00:00.5Z"]
    before, during, after = (gps_from_text(t) for t in texts)
    assert before is not None
    assert during is not None
    assert after is not None
    assert (during - before, after - during) == (1.0, 1.0)
    assert utc_text(during) == "2016-12-31T23:59:60.500Z"


def test_a_known_week() -> None:
    # RTKLIB's own words of one file: 2025/05/08 12:00:10 GPST is week 2365, second 388810
    assert gps_from_text("2025-05-08T11:59:52Z") == 2365 * 604800 + 388810


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("2025-05-08 13:59:52+02:00", True),
        ("2025-05-08T11:59:52", True),
        ("2025-05-07T23:59:52-1200", True),
        ("2025-05-08T11:59:53Z", False),
    ],
)
def test_texts_with_a_zone(text: str, same: bool) -> None:
    assert (gps_from_text(text) == gps_from_text("2025-05-08T11:59:52Z")) is same


@pytest.mark.parametrize(
    "text",
    ["", "yesterday", "2025-02-30T00:00:00Z", "2025-05-08T24:00:00Z", "2025-05-08T11:59:60Z", "2025-05-08", "１"],
)
def test_what_is_no_time(text: str) -> None:
    assert gps_from_text(text) is None


@given(st.datetimes(datetime.datetime(1981, 1, 1), datetime.datetime(2100, 1, 1)))
def test_there_and_back(moment: datetime.datetime) -> None:
    moment = moment.replace(microsecond=moment.microsecond // 1000 * 1000)
    gps_s = gps_from_datetime(moment)
    assert gps_from_text(utc_text(gps_s)) == pytest.approx(gps_s, abs=1e-6)
    assert utc_day(gps_s) == (moment.date() - datetime.date(1980, 1, 6)).days
    unix = moment.replace(tzinfo=datetime.UTC).timestamp()
    assert gps_from_civil(*civil_from_unix(unix), TimeScale.UTC) == pytest.approx(gps_s, abs=1e-6)
