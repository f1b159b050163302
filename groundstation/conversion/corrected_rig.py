"""The rig file that belongs to angles which have been corrected by ``ptu_axes``."""

from dataclasses import replace

from groundstation.rig.ptu_axes import IDEAL_AXES
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml


def corrected_rig(rig: Rig, data: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return the rig file for the events of a session, and a note if it is not ``data``, the session's own.

    Events have angles, not readings: what ``ptu_axes`` makes of readings is in them, and would be applied again. The
    lean of an axis is no error of a reading and stays.
    """
    changed = [s.name for s in rig.stations if not s.ptu_axes.is_ideal_apart_from_lean]
    if not changed:
        return data, ()
    stations = tuple(replace(s, ptu_axes=replace(IDEAL_AXES, lean_rad=s.ptu_axes.lean_rad)) for s in rig.stations)
    note = f"the angles of {', '.join(changed)} are corrected by ptu_axes, which rig.toml therefore lacks"
    note += "; operation needs it"
    return rig_to_toml(replace(rig, stations=stations)).encode(), (note,)
