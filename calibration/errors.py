"""Errors of calibration: each message is one line with the value that was got and the one that was wanted."""

from groundstation.errors import InputError


class IntrinsicsError(InputError):
    """Pictures of a board, a board's description or a lens file is not usable."""
