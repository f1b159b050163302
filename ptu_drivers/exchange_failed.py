"""The named reason, inside a driver, for which an answer is not believed."""

from ptu_drivers.health import FailureReason


class ExchangeFailed(Exception):  # noqa: N818 - not an error: a named reason, which never leaves the driver
    """Inside a driver: an answer that cannot be believed, or none."""

    def __init__(self, reason: FailureReason, got: str = "") -> None:
        self.reason = reason
        self.got = got
        super().__init__(got or reason.value)
