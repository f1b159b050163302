"""Options of an import that are given and have nothing to act on: said in a remark each."""

from groundstation.conversion.import_request import ImportRequest
from groundstation.rig.rig import Rig
from groundstation.session.logs.fixes import ReadingNotes
from groundstation.session.logs.read import GnssLog


def unused_options(request: ImportRequest, rig: Rig, log: GnssLog | None) -> list[str]:
    """Return a remark on each option that is not used; a log of places on Earth (``log``) has remarks of its own."""
    told = []
    if request.ptu is not None and all(station.fixed for station in rig.stations):
        told.append(f"--ptu: {request.ptu.name} is not used: all stations of the rig are fixed")
    if request.ptu_start is not None and request.ptu is None:
        told.append("--ptu-start is not used: there is no --ptu")
    if (request.origin_deg_m is None) != (request.azimuth_deg is None):
        given, missing = ("--origin", "--azimuth") if request.azimuth_deg is None else ("--azimuth", "--origin")
        told.append(f"{given} is not used: the session's place on Earth takes {missing} as well")
    if log is not None:
        return told
    notes = ReadingNotes("--dgps, which is not given" if request.dgps is None else request.dgps.name)
    notes.note_unused(request.reading)
    return [*told, *notes.lines()]
