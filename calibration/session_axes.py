"""Axis errors of a calibrated session in the rig file that is written: [ptu_axes_applied] is true of its heads."""

from dataclasses import dataclass, replace

from groundstation.rig.ptu_axes import PtuAxes, axes_to_toml
from groundstation.rig.rig import Rig, Station
from groundstation.session import Session
from groundstation.session.applied_axes import APPLIED_AXES


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WrittenAxes:
    """A rig to be written, and a note on the axes that it takes from the session; "" where it takes none."""

    rig: Rig
    note: str


def written_axes(session: Session, rig: Rig) -> WrittenAxes:
    """Return the rig with the axis errors that the session's angles are corrected by, where it states none.

    What was estimated from such angles holds for corrected ones: without the axes in the rig the readings of the next
    recording would be taken for angles. The lean is part of the geometry and stays the rig's.
    """
    taken = {s.name: session.applied_axes[s.name] for s in rig.stations if _lacks_axes(session, s)}
    if not taken:
        return WrittenAxes(rig=rig, note="")
    values = "; ".join(f"{name} {axes_to_toml(axes)}" for name, axes in taken.items())
    return WrittenAxes(
        rig=replace(rig, stations=tuple(_with_axes(s, taken.get(s.name)) for s in rig.stations)),
        note=(
            f"note: ptu_axes taken from [{APPLIED_AXES}] in session.toml, which its angles are corrected by and the rig"
            f" lacked: {values}"
        ),
    )


def _lacks_axes(session: Session, station: Station) -> bool:
    applied = session.applied_axes.get(station.name)
    if station.fixed or applied is None or applied.is_ideal_apart_from_lean:
        return False
    return station.ptu_axes.is_ideal_apart_from_lean


def _with_axes(station: Station, axes: PtuAxes | None) -> Station:
    if axes is None:
        return station
    return replace(station, ptu_axes=replace(axes, lean_rad=station.ptu_axes.lean_rad))
