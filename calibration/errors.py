"""Errors of calibration: each message is one line with what was got and what was wanted."""

from groundstation.errors import InputError


class IntrinsicsError(InputError):
    """Pictures of a board, a board's description or a lens file is not usable."""
