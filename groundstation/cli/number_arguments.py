"""Lists of numbers on a command line that begin with a minus sign: values, where argparse would see an option."""

import argparse
import re

_NUMBERS = re.compile(r"-[\d.][\d.,eE+-]*$")


def take_negative_numbers(parser: argparse.ArgumentParser) -> None:
    """Let values such as "-5,20,40,30" follow an option of this parser; none of its options may look like that."""
    parser._negative_number_matcher = _NUMBERS
