"""Result of `groundstation check` for one device."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """Result for one device: whether it is well, and the line of text."""

    good: bool
    text: str


def passed(text: str) -> CheckResult:
    """Return a line on a device that is well."""
    return CheckResult(good=True, text=text)


def failed(text: str) -> CheckResult:
    """Return a line on one that is not."""
    return CheckResult(good=False, text=text)
