"""Opening a unit for `groundstation ptu`: by its URL, or as the head of a station file, with its keep-out zones."""

import argparse
import math
import sys
import time
from pathlib import Path

from groundstation.errors import UsageError


def open_unit(options: argparse.Namespace):  # type: ignore[no-untyped-def] # it would import the drivers for --help
    """Open the unit that the options name, by its URL or by a station file."""
    from ptu_drivers import AxisSettings, UnitSettings, open_ptu

    if options.station is not None:
        return _open_of_station(options)
    if options.url is None:
        raise UsageError(f"ptu {options.ptu}", got="no URL", wanted="one, or --station FILE NAME")

    def soft(limits: tuple[float, float] | None) -> AxisSettings:
        if limits is None:
            return AxisSettings()
        return AxisSettings(low_rad=math.radians(limits[0]), high_rad=math.radians(limits[1]))

    settings = UnitSettings(pan=soft(options.pan_limits), tilt=soft(options.tilt_limits), baud=options.baud)
    own = {"patience_s": options.patience} if options.protocol == "flir" else {}
    unit = open_ptu(options.url, options.protocol, settings, **{**own, **dict(options.option)})
    if options.baud and unit.describe().details["baud"] != str(options.baud):
        print(f"groundstation: {options.url}: baud {unit.describe().details['baud']}", file=sys.stderr)
    return unit


def _open_of_station(options: argparse.Namespace):  # type: ignore[no-untyped-def] # as for open_unit
    from groundstation.live.keep_out_unit import KeepOutUnit
    from groundstation.live.keep_out_zones import open_station_head

    file, name = options.station
    own = {
        "URL": options.url,
        "--protocol": options.protocol != "flir",
        "--baud": options.baud,
        "--option": options.option,
        "--pan-limits": options.pan_limits,
        "--tilt-limits": options.tilt_limits,
    }
    conflicting = [option for option, given in own.items() if given]
    if conflicting:
        where = f"ptu {options.ptu}"
        raise UsageError(
            where, got=f"{conflicting[0]} and --station", wanted="one of them: the file holds the connection"
        )
    unit = open_station_head(Path(file), name, time.monotonic, time.time)
    if isinstance(unit, KeepOutUnit):
        unit.report = lambda text: print(f"groundstation: {name}: {text}", file=sys.stderr)
    return unit


def warn_unguarded(options: argparse.Namespace) -> None:
    """Warn before a move that a unit opened by its URL has no keep-out zones."""
    if options.station is None:
        text = "nothing keeps the lens from the Sun or closed sectors; --station FILE NAME does"
        print(f"groundstation: {options.url}: {text}", file=sys.stderr)
