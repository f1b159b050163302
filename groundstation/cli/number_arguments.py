"""Numbers on a command line: parsers for argparse's ``type``, and lists of numbers that begin with a minus sign."""

import argparse
import math
import re
from collections.abc import Callable

_NEGATIVE_NUMBERS = re.compile(r"-[\d.][\d.,eE+-]*$")


def parse_number(text: str, wanted: str, accepts: Callable[[float], bool] = math.isfinite) -> float:
    """Return a number for which ``accepts`` is true; for other text it gets NaN.

    Raises `argparse.ArgumentTypeError` for any other text, with ``wanted`` in its message.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not accepts(value):
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted {wanted}")
    return value


def finite_number(text: str) -> float:
    """Return a finite number."""
    return parse_number(text, "a number")


def positive_number(text: str) -> float:
    """Return a finite number above 0."""
    finite_number(text)
    return parse_number(text, "a number above 0", lambda value: value > 0.0)


def duration_s(text: str) -> float:
    """Return a duration in s, above 0."""
    return parse_number(text, "a number above 0", lambda value: 0.0 < value < 1e7)


def take_negative_numbers(parser: argparse.ArgumentParser) -> None:
    """Let values such as "-5,20,40,30" follow an option of this parser; none of its options may look like that."""
    parser._negative_number_matcher = _NEGATIVE_NUMBERS


def port(text: str) -> int:
    """Return the number of a TCP port that needs no privileges."""
    wanted = "a port from 1024 to 65535"
    return int(parse_number(text, wanted, lambda value: 1024 <= value <= 65535 and value.is_integer()))


def port_or_any(text: str) -> int:
    """Return the number of a TCP port to listen on, 0 for any that is free."""
    wanted = "a free port from 1 to 65535, or 0 for any"
    return int(parse_number(text, wanted, lambda value: 0 <= value <= 65535 and value.is_integer()))


def count(text: str) -> int:
    """Return a whole number from 1 on."""
    return int(parse_number(text, "a whole number from 1 on", lambda value: value >= 1.0 and value.is_integer()))


def whole_number(text: str) -> int:
    """Return a whole number from 0 on."""
    return int(parse_number(text, "a whole number from 0 on", lambda value: value >= 0.0 and value.is_integer()))
