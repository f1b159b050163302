"""What a receiver does with a message: taken or refused, the reason, and the time to which it attributes the sample."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.message import MavlinkMessage


class ReceiptVerdict(StrEnum):
    """Taken, or why not."""

    ACCEPTED = "accepted"
    # taken, but for a later time than the stamp's: the end of the filter's memory
    HELD = "older than the filter's memory, taken for its end"
    # the first sample of a series only starts it
    STARTING = "the first of a series"
    NOT_SELECTED = "not the message that the parameters select"
    OTHER_INSTANCE = "for another receiver"
    NO_FIX = "no fix"
    NO_WEEK = "no time of week"
    NOT_FINITE = "a number that is none"
    WRONG_FRAMES = "frames that are not taken"
    LOW_QUALITY = "quality below the parameter's"
    TOO_SOON = "too soon after the last"
    TOO_OLD = "older than the filter's memory"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReceivedSample:
    """A position as the filter takes it.

    Attributes
    ----------
    t_s : time to which it is attributed, on the vehicle's clock.
    position_runway_m : (3,) in the runway frame.
    velocity_ned_m_s : (3,) north, east, down; None where the message has none.
    sigma_horizontal_m, sigma_vertical_m, sigma_speed_m_s : after the parameters' floors.
    sigma_north_east_m : (2,) of a filter that takes one for each axis; None where the horizontal one is for both.
    reset : whether the filter is to be reset to it.
    """

    t_s: float
    position_runway_m: FloatArray
    velocity_ned_m_s: FloatArray | None
    sigma_horizontal_m: float
    sigma_vertical_m: float
    sigma_speed_m_s: float
    sigma_north_east_m: tuple[float, float] | None = None
    reset: bool = False

    def position_sigma_ned_m(self) -> FloatArray:
        """Return the position's sigma north, east, down, (3,)."""
        horizontal = (self.sigma_horizontal_m,) * 2 if self.sigma_north_east_m is None else self.sigma_north_east_m
        return np.array([*horizontal, self.sigma_vertical_m])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Receipt:
    """The verdict on one message; ``sample`` where it was taken."""

    verdict: ReceiptVerdict
    sample: ReceivedSample | None = None


class PositionReceiver(Protocol):
    """A vehicle's end of the stream."""

    def receive(self, message: MavlinkMessage, now_s: float) -> Receipt:
        """Take a message that arrives at ``now_s`` on the vehicle's clock."""


def refused(verdict: ReceiptVerdict) -> Receipt:
    """Return the receipt of a message that is not taken."""
    return Receipt(verdict=verdict)


def number(message: MavlinkMessage, name: str) -> float:
    """Return a numeric field."""
    value = message.fields[name]
    if not isinstance(value, int | float):
        raise TypeError(f"{message.name}.{name}: got {type(value).__name__}, wanted a number")
    return float(value)


def numbers(message: MavlinkMessage, *names: str) -> FloatArray:
    """Return numeric fields."""
    return np.array([number(message, name) for name in names])


def listed(message: MavlinkMessage, name: str) -> FloatArray:
    """Return a field that is a list of numbers."""
    value = message.fields[name]
    if not isinstance(value, list):
        raise TypeError(f"{message.name}.{name}: got {type(value).__name__}, wanted a list")
    return np.array(value, dtype=np.float64)


def geodetic_position(message: MavlinkMessage, frame: LocalFrame) -> FloatArray:
    """Return latitude, longitude (1e-7 degrees) and ``alt`` (m above mean sea level) as (3,) of the runway frame."""
    lat, lon, height_m = numbers(message, "lat", "lon", "alt")
    return frame.runway_position(1e-7 * lat, 1e-7 * lon, height_m)


def local_position(message: MavlinkMessage, frame: LocalFrame) -> FloatArray:
    """Return ``x``, ``y``, ``z``, north, east, down of the frame's origin, as (3,) of the runway frame."""
    return np.asarray(frame.ned_from_runway.T @ numbers(message, "x", "y", "z"))


def finite(values: FloatArray) -> bool:
    """Return whether all are finite."""
    return all(math.isfinite(v) for v in values.flat)
