"""What `groundstation check` says of one device."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckLine:
    """One device: whether it is well, and the line that says so."""

    good: bool
    text: str


def well(text: str) -> CheckLine:
    """Return a line on a device that is well."""
    return CheckLine(good=True, text=text)


def wrong(text: str) -> CheckLine:
    """Return a line on one that is not."""
    return CheckLine(good=False, text=text)
