"""Table [ptu_axes_applied] of session.toml: axis errors that are taken out of the angles of a session already.

Readings whose backlash was corrected are not known any more. A folder that was made of such angles has them instead of
readings, and no ``ptu_axes`` in its rig.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace

from groundstation.errors import RigError
from groundstation.files.toml_table import TomlTable, quoted
from groundstation.rig.ptu_axes import PtuAxes, axes_in_file_units, axes_to_toml, read_axes
from groundstation.rig.rig import Rig

APPLIED_AXES = "ptu_axes_applied"


def read_applied_axes(table: TomlTable, stations: Collection[str]) -> dict[str, PtuAxes]:
    """Return the axes by station; raises the table's error for a station that is not among ``stations``."""
    found = {}
    for name in table.values:
        if name not in stations:
            raise table.fail(name, quoted(name), f"a station ({', '.join(sorted(stations))})")
        found[name] = replace(read_axes(table.table(name)), lean_rad=0.0)
    return found


def applied_axes_to_toml(applied: Mapping[str, PtuAxes]) -> str:
    """Return a table for each station, to be appended; the lean of an axis belongs to the geometry and is not in it."""
    tables = []
    for name, axes in applied.items():
        values = axes_in_file_units(replace(axes, lean_rad=0.0))
        rows = (f"{key} = {value:.12g}" for key, value in values.items() if value != 0.0)
        tables.append("\n".join([f"[{APPLIED_AXES}.{name}]", *rows]) + "\n")
    return "\n".join(tables)


def require_applied_axes(rig: Rig, applied: Mapping[str, PtuAxes]) -> None:
    """Raise `RigError` for a rig with other axes than those that were applied; it may have the same, or none."""
    for name, axes in applied.items():
        if name not in rig.names or rig[name].ptu_axes.is_ideal_apart_from_lean:
            continue
        # compared as files have them
        if axes_to_toml(replace(rig[name].ptu_axes, lean_rad=0.0)) != axes_to_toml(replace(axes, lean_rad=0.0)):
            got = (
                f"other axes than the session's angles are corrected by ([{APPLIED_AXES}]): their readings are unknown"
            )
            raise RigError(f"{rig.path}: station {name}: ptu_axes", got=got, wanted="those, or none")
