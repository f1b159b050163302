"""Replies of an Alpaca server: JSON that matches the request, or a named failure."""

import http.client
import json
import math
from typing import Any

from ptu_drivers.errors import RefusedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason

_SHOWN = 60


def decode(name: str, status: int, body: bytes, transaction: int) -> dict[str, Any]:
    """Return the value in the reply to a request.

    Parameters
    ----------
    name : the requested property. status, body : of the reply. transaction : the request's number.

    Raises
    ------
    ExchangeFailed : not a reply, or one to another request. RefusedError : the server or its device refuses.
    """
    text = body.decode("utf-8", "replace")
    if status != http.client.OK:
        # in Alpaca that is not for the device's own errors: a wrong name, number or device
        raise RefusedError(name, reported=f"HTTP {status}: {text}")
    try:
        answer = json.loads(text)
    except (ValueError, RecursionError) as wrong:
        raise _garbage(name, text) from wrong
    if not isinstance(answer, dict):
        raise _garbage(name, text)
    # 0 where a server does not repeat it
    if answer.get("ClientTransactionID", 0) not in (0, transaction):
        raise ExchangeFailed(
            FailureReason.ECHO_MISMATCH, f"{name}: transaction {str(answer['ClientTransactionID'])[:_SHOWN]}"
        )
    error = answer.get("ErrorNumber", 0)
    if error:
        raise RefusedError(name, reported=f"{answer.get('ErrorMessage', '')} ({error})")
    return answer


def finite(name: str, value: object) -> float:
    """Return a number from JSON. Raises ExchangeFailed where it is not one."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _garbage(name, value)
    try:
        number = float(value)
    except OverflowError as much:
        raise _garbage(name, "an integer beyond all numbers") from much
    if not math.isfinite(number):
        raise _garbage(name, value)
    return number


def angles_of(state: object) -> dict[str, float]:
    """Return azimuth and altitude of a `DeviceState`, deg. Raises ExchangeFailed."""
    named: dict[str, object] = {}
    for item in _dictionaries("devicestate", state):
        if isinstance(item.get("Name"), str):
            named[item["Name"]] = item.get("Value")
    return {name: finite(f"devicestate {name}", named.get(name)) for name in ("Azimuth", "Altitude")}


def rates_of(ranges: object) -> tuple[float, float] | None:
    """Return the least and greatest rate of `AxisRates`, deg/s, or None without any. Raises ExchangeFailed."""
    ends = [
        (finite("axisrates", r.get("Minimum")), finite("axisrates", r.get("Maximum")))
        for r in _dictionaries("axisrates", ranges)
    ]
    return (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None


def _dictionaries(name: str, items: object) -> list[dict[str, Any]]:
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise _garbage(name, items)
    return items


def _garbage(name: str, value: object) -> ExchangeFailed:
    return ExchangeFailed(FailureReason.GARBAGE, f"{name}: {repr(value)[:_SHOWN]}")
