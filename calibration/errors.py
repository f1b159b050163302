"""Errors of calibration: each is one line that says what was got and what was wanted."""

from groundstation.errors import InputError


class IntrinsicsError(InputError):
    """Pictures of a board, a board's description or a lens file is not usable."""
