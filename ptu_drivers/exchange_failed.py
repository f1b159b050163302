"""Internal exception of the drivers: an exchange failed, with its named reason."""

from ptu_drivers.errors import PtuError
from ptu_drivers.health import FailureReason


class ExchangeFailed(Exception):  # noqa: N818 - not an error: a named reason, which never leaves the driver
    """No reply, or a reply that is rejected; never leaves the driver."""

    def __init__(self, reason: FailureReason, got: str = "") -> None:
        self.reason = reason
        self.got = got
        super().__init__(got or reason.value)


def reason_of(fault: ExchangeFailed | PtuError) -> FailureReason:
    """Return the reason that a fault is counted under."""
    return fault.reason if isinstance(fault, ExchangeFailed) else FailureReason.LINE_LOST
