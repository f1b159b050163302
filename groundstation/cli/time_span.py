"""The time span of a session for a command: `--from S` and `--to S`."""

import argparse

from groundstation.cli.number_arguments import parse_number
from groundstation.errors import UsageError


def add_span(parser: argparse.ArgumentParser) -> None:
    """Add `--from` and `--to`, session times in s."""
    parser.add_argument("--from", type=_time, dest="from_s", metavar="S", help="start at this session time, s")
    parser.add_argument("--to", type=_time, dest="to_s", metavar="S", help="stop at this session time, s")


def require_span(options: argparse.Namespace) -> None:
    """Raise `UsageError` unless the end is after the start."""
    if options.from_s is not None and options.to_s is not None and options.from_s >= options.to_s:
        got = f"--from {options.from_s:g} and --to {options.to_s:g}"
        raise UsageError("--from, --to", got=got, wanted="an end after the beginning")


def _time(text: str) -> float:
    return parse_number(text, "a session time in s, as 12.5")
