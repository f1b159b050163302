"""GPS time and UTC: two clocks that differ by the leap seconds since 1980.

Times here are seconds since 1980-01-06 00:00 of GPS time, which never jumps. A log's civil time is a day (counted from
that date) and a second of the day; a leap second is the second 86400 of its day. Libraries of logs have had the leap
seconds wrong more than once, so that the conversion is made here, for all formats.
"""

import math
import re
from datetime import UTC, date, datetime, timedelta
from enum import StrEnum

DAY_S = 86_400.0
WEEK_S = 7 * DAY_S
DAYS_OF_ERA = 7 * 1024
_EPOCH = date(1980, 1, 6)
# GPS − UTC grew by one second at 0 h UTC of each of these days (IERS Bulletin C); none has been announced since
LEAP_DAYS = tuple(
    (date(*day) - _EPOCH).days
    for day in (
        (1981, 7, 1),
        (1982, 7, 1),
        (1983, 7, 1),
        (1985, 7, 1),
        (1988, 1, 1),
        (1990, 1, 1),
        (1991, 1, 1),
        (1992, 7, 1),
        (1993, 7, 1),
        (1994, 7, 1),
        (1996, 1, 1),
        (1997, 7, 1),
        (1999, 1, 1),
        (2006, 1, 1),
        (2009, 1, 1),
        (2012, 7, 1),
        (2015, 7, 1),
        (2017, 1, 1),
    )
)
_UTC = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)[T ](\d\d):(\d\d):(\d\d(?:\.\d{1,12})?)\s*(Z|UTC|[+-]\d\d:?\d\d)?", re.ASCII | re.IGNORECASE
)
_UNIX_DAYS = (_EPOCH - date(1970, 1, 1)).days


class TimeScale(StrEnum):
    """Which clock a log's times are in."""

    GPS = "GPS"
    UTC = "UTC"


def day_number(year: int, month: int, day: int) -> int:
    """Return days since 1980-01-06; raises `ValueError` for a date that does not exist."""
    try:
        return (date(year, month, day) - _EPOCH).days
    except OverflowError as error:
        # a year of twenty digits does not fit the calendar's own integer
        raise ValueError(f"year {year} is out of range") from error


def date_of(day: int) -> date:
    """Return the date of a day number, within the calendar's range."""
    return _EPOCH + timedelta(days=min(max(day, -700_000), 2_900_000))


def leap_seconds(day: int) -> int:
    """Return GPS − UTC in s on a UTC day; before 1980 zero, after the table its last value."""
    return sum(day >= leap for leap in LEAP_DAYS)


def gps_from_civil(day: int, second: float, scale: TimeScale) -> float:
    """Return GPS seconds of a day and a second of it, as the clock of ``scale`` shows them."""
    return day * DAY_S + second + (leap_seconds(day) if scale is TimeScale.UTC else 0)


def civil_from_unix(unix_s: float) -> tuple[int, float]:
    """Return day and second, UTC, of a Unix time, which does not count leap seconds."""
    days = math.floor(unix_s / DAY_S)
    return days - _UNIX_DAYS, unix_s - days * DAY_S


def utc_day(gps_s: float) -> int:
    """Return the UTC day of a GPS time."""
    day = math.floor(gps_s / DAY_S)
    return day if gps_s >= gps_from_civil(day, 0.0, TimeScale.UTC) else day - 1


def utc_text(gps_s: float) -> str:
    """Return a GPS time as UTC, ISO 8601 to the millisecond, for a person to read."""
    gps_s = round(gps_s, 3)
    day = utc_day(gps_s)
    second = gps_s - gps_from_civil(day, 0.0, TimeScale.UTC)
    whole = min(int(second), 86_399)
    hour, minute = divmod(whole // 60, 60)
    rest = f"{second - 3600 * hour - 60 * minute:06.3f}".removesuffix(".000")
    return f"{date_of(day).isoformat()}T{hour:02d}:{minute:02d}:{rest}Z"


def gps_from_text(text: str) -> float | None:
    """Return the GPS time of an ISO 8601 date and time, UTC without an offset; None if it is not one."""
    match = _UTC.fullmatch(text.strip())
    if match is None:
        return None
    year, month, day, hour, minute = (int(match[k]) for k in range(1, 6))
    second = float(match[6])
    try:
        number = day_number(year, month, day)
    except ValueError:
        return None
    if (
        hour > 23
        or minute > 59
        or second >= 61.0
        or (second >= 60.0 and (hour, minute) != (23, 59) and not _east(match[7]))
    ):
        return None
    # the clock face of the offset's place; its leap second falls at another hour, so the day is UTC's
    face = 3600 * hour + 60 * minute - _east(match[7])
    shift = math.floor(face / DAY_S)
    return gps_from_civil(number + shift, face - shift * DAY_S + second, TimeScale.UTC)


def _east(zone: str | None) -> int:
    """Return an offset such as +02:00 in s."""
    if not zone or zone.upper() in ("Z", "UTC"):
        return 0
    digits = zone[1:].replace(":", "")
    return (-1 if zone[0] == "-" else 1) * (3600 * int(digits[:2]) + 60 * int(digits[2:]))


def gps_from_datetime(moment: datetime) -> float:
    """Return the GPS time of a date and time, UTC where it names no zone."""
    utc = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    second = 3600 * utc.hour + 60 * utc.minute + utc.second + 1e-6 * utc.microsecond
    return gps_from_civil((utc.date() - _EPOCH).days, second, TimeScale.UTC)
