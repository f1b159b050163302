"""What devices deliver that is not a number: one such value in the filter makes its whole state not a number."""

import math
from dataclasses import dataclass

from groundstation.live.input_queue import DeviceLogLine, Item, TimedPicture
from groundstation.messages import PixelMeasurement, PtuSample, ReferenceFix


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedItem:
    """An item that is not used: of which ``kind``, to be counted, and the line that says why."""

    kind: str
    line: str


def refused(item: Item | PixelMeasurement) -> RefusedItem | None:
    """Return why an item is refused, whose values are not all finite; None for one to be used."""
    if isinstance(item, DeviceLogLine):
        return None
    bad = [(name, value) for name, value in _values(item) if not math.isfinite(value)]
    if not bad:
        return None
    what, whose = _words(item)
    got = ", ".join(f"{name} = {value}" for name, value in bad)
    line = f"{whose}: got {got}, wanted finite numbers: the {what} is not used"
    return RefusedItem(kind=f"{what}s of {whose}, not finite", line=line)


def _words(item: TimedPicture | PtuSample | PixelMeasurement | ReferenceFix) -> tuple[str, str]:
    """Return what an item is, and whose."""
    if isinstance(item, ReferenceFix):
        return "position", "DGPS"
    names = {TimedPicture: "frame", PtuSample: "reading", PixelMeasurement: "pixel"}
    return names[type(item)], item.station


def _values(item: TimedPicture | PtuSample | PixelMeasurement | ReferenceFix) -> list[tuple[str, float]]:
    """Return the numbers of an item by name."""
    values = [("t_s", item.t_s)]
    if isinstance(item, PtuSample):
        values += [("pan_rad", item.pan_rad), ("tilt_rad", item.tilt_rad)]
    elif isinstance(item, PixelMeasurement):
        values += [("u_px", item.u_px), ("v_px", item.v_px)]
        values += [("sigma_px", sigma) for sigma in item.sigma_px or ()]
    elif isinstance(item, ReferenceFix):
        values += list(zip(("x_m", "y_m", "z_m"), item.position_runway_m.tolist(), strict=True))
        values += [("sigma_m", sigma) for sigma in item.sigma_m.tolist()]
    return values
