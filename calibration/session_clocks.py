"""Clocks of a calibrated session in the rig file that is written: [clocks] belong to their session, not to devices."""

from collections.abc import Collection
from dataclasses import dataclass, replace

from groundstation.rig.rig import EQUAL_CLOCKS, Rig, Station
from groundstation.session import Session


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WrittenClocks:
    """A rig to be written, and a note on the session's clocks; "" where the session has none of its own."""

    rig: Rig
    note: str


def written_clocks(session: Session, rig: Rig, estimated: Collection[str]) -> WrittenClocks:
    """Return the rig without the clocks that are copies of the session's [clocks].

    ``estimated`` are the clocks of ``rig`` that the session has determined, as ``station.ptu_clock``. One estimated on
    top of a copy includes it, and is right only together with the clocks that it was estimated next to: then all stay,
    and the note says whose they are.
    """
    copied = session.clock_entries
    on_top = [name for name in copied if name in estimated]
    if on_top:
        values = ", ".join(f"{name} {_offset_s(session.rig, name):+g} s" for name in copied)
        return WrittenClocks(
            rig=replace(rig, stations=tuple(_stated(s, copied) for s in rig.stations)),
            note=(
                f"note: {', '.join(on_top)}: estimated on top of [clocks] in session.toml, which the rig contains"
                f" ({values}): it is right for sessions with the same [clocks] only, whose entries it replaces"
            ),
        )
    if not copied:
        return WrittenClocks(rig=rig, note="")
    return WrittenClocks(
        rig=replace(
            rig,
            stations=tuple(_without(s, copied) for s in rig.stations),
            shared_covariance=rig.shared_covariance.without([f"{name}.offset" for name in copied]),
        ),
        note=f"note: [clocks] in session.toml are the session's and were held: the rig has no {', '.join(copied)}",
    )


def _offset_s(rig: Rig, clock: str) -> float:
    station, _, device = clock.rpartition(".")
    if device == "ptu_clock":
        return rig[station].ptu_clock.offset_s
    return (rig[station].camera_clock or EQUAL_CLOCKS).offset_s


def _stated(station: Station, copied: Collection[str]) -> Station:
    """Return the station with a copied clock of its PTU as one of its own."""
    given = station.ptu_clock_given or f"{station.name}.ptu_clock" in copied
    return replace(station, ptu_clock_given=given)


def _without(station: Station, copied: Collection[str]) -> Station:
    if f"{station.name}.camera_clock" in copied:
        station = replace(station, camera_clock=None)
    if f"{station.name}.ptu_clock" in copied:
        station = replace(station, ptu_clock=EQUAL_CLOCKS, ptu_clock_given=False)
    return station
