"""The controllers of a station file's heads, by what is known of their units, mounts and axes."""

from collections.abc import Mapping

from groundstation.live.station_file import StationFile
from groundstation.pointing.head_limits import HeadLimits
from groundstation.pointing.pointing_law import HeadController
from groundstation.rig.rig import Rig


def head_controllers(
    file: StationFile, rig: Rig, limits: Mapping[str, HeadLimits], start_s: float
) -> dict[str, HeadController]:
    """Return a controller for each head with limits; ``start_s`` is the session's zero on the host's clock."""
    closed = {station.name: station.head.keep_out for station in file.stations if station.head is not None}
    found = {}
    for name, own in limits.items():
        keep_out, station = closed.get(name), rig[name]
        since = None if keep_out is None else keep_out.since(start_s)
        found[name] = HeadController(station.geometry(), own, file.pointing, since, station.ptu_axes)
    return found
