"""[clocks] of session.toml: offsets of stations and tables to the DGPS clock, for stations whose rig states none."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from groundstation.files.toml_table import TomlTable
from groundstation.rig.covariance import ParameterCovariance, joined
from groundstation.rig.rig import ClockModel, Rig, parse_clock

# names in [clocks] other than the stations
CLOCKED_TABLES = ("frames", "detections", "ptu", "dgps", "truth")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockedRig:
    """A rig with the clocks of a session.

    ``entries`` are the clocks that its file does not state, ``station.camera_clock`` or ``station.ptu_clock``, and for
    each the entry of [clocks] that it is a copy of.
    """

    rig: Rig
    entries: Mapping[str, str]


def parse_clocks(table: TomlTable, stations: set[str]) -> dict[str, ClockModel]:
    """Parse [clocks]: by station or table, t_dgps = t + offset. Raises the table's error for an unknown name."""
    clocks = {}
    for name in table.values:
        if name not in stations and name not in CLOCKED_TABLES:
            wanted = f"a station ({', '.join(sorted(stations))}) or a table ({', '.join(CLOCKED_TABLES)})"
            raise table.fail(name, "an unknown clock", wanted)
        entry = table.table(name)
        entry.number("offset_s")
        clocks[name] = parse_clock(entry)
    return clocks


def with_session_clocks(rig: Rig, clocks: Mapping[str, ClockModel], pictures: str) -> ClockedRig:
    """Return the rig with its missing clocks taken from [clocks]; clocks in the rig file take precedence.

    ``pictures`` is the table of the cameras' stamps. A PTU with neither shares its station's clock, as in a session
    without [clocks]. The error of an entry is one, however many clocks are copies of it: the rig's covariance has them
    with its ``sigma_s``, fully correlated.
    """
    stations = []
    entries: dict[str, str] = {}
    for station in rig.stations:
        camera, ptu = station.camera_clock, station.ptu_clock
        by_camera = next((name for name in (station.name, pictures) if name in clocks), None)
        if camera is None and by_camera is not None:
            camera = clocks[by_camera]
            entries[f"{station.name}.camera_clock"] = by_camera
        by_ptu = next((name for name in ("ptu", station.name) if name in clocks), None)
        if not station.ptu_clock_given and by_ptu is not None:
            ptu = clocks[by_ptu]
            if not station.fixed:
                entries[f"{station.name}.ptu_clock"] = by_ptu
        stations.append(replace(station, camera_clock=camera, ptu_clock=ptu))
    shared = joined(_copied_errors(entries, clocks).without(rig.shared_covariance.names), rig.shared_covariance)
    return ClockedRig(rig=replace(rig, stations=tuple(stations), shared_covariance=shared), entries=entries)


def _copied_errors(entries: Mapping[str, str], clocks: Mapping[str, ClockModel]) -> ParameterCovariance:
    """Return the covariance of all clocks that are copies of an entry with a sigma."""
    uncertain = [clock for clock, entry in entries.items() if clocks[entry].sigma_s > 0.0]
    sigmas = np.array([clocks[entries[clock]].sigma_s for clock in uncertain])
    entry = np.array([entries[clock] for clock in uncertain])
    return ParameterCovariance(
        names=tuple(f"{clock}.offset" for clock in uncertain),
        matrix=np.where(entry[:, None] == entry, np.outer(sigmas, sigmas), 0.0),
    )
