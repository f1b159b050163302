"""The fault timetable of `groundstation simulate --faults`, converted for the real-time device simulator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from groundstation.errors import InputError
from groundstation.rig.rig import Rig
from groundstation.simulation.device_faults import (
    CAMERA_CLOCK_STEPPED,
    CAMERA_FROZEN,
    CAMERA_LATE,
    CAMERA_LOST,
    PTU_SILENT,
    TimedFault,
)
from groundstation.simulation.event_faults import Fault, FaultKind
from groundstation.simulation.simulated_receiver import ReceiverModel

_OF_STATIONS = {
    FaultKind.CAMERA_LOST: CAMERA_LOST,
    FaultKind.CAMERA_FROZEN: CAMERA_FROZEN,
    FaultKind.CAMERA_LATE: CAMERA_LATE,
    FaultKind.CAMERA_CLOCK_STEP: CAMERA_CLOCK_STEPPED,
    FaultKind.PTU_SILENT: PTU_SILENT,
}
_OF_THE_RECEIVER = (FaultKind.DGPS_GAP, FaultKind.DGPS_CLOCK_STEP)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedDeviceFaults:
    """Faults of the stations' devices, and the receiver (None for none) with its faults."""

    timetable: tuple[TimedFault, ...]
    receiver: ReceiverModel | None


def simulated_device_faults(
    faults: Sequence[Fault], receiver: ReceiverModel | None, where: str
) -> SimulatedDeviceFaults:
    """Return the faults of a timetable in the simulated range's form; times count from the flight's beginning.

    Raises `InputError`, which names ``where``, for what does not happen on a serial line, and for faults of a receiver
    that is not there.
    """
    timetable = []
    for fault in faults:
        if fault.kind in _OF_STATIONS:
            what = _OF_STATIONS[fault.kind]
            timetable.append(
                TimedFault(what=what, station=fault.station, from_s=fault.from_s, to_s=fault.to_s, by_s=fault.by)
            )
        elif fault.kind not in _OF_THE_RECEIVER:
            known = ", ".join((*_OF_STATIONS, *_OF_THE_RECEIVER))
            raise InputError(where, got=fault.kind, wanted=f"one of {known}; a PTU's line has --ptu-fault")
        elif receiver is None:
            raise InputError(where, got=f"{fault.kind} without --dgps", wanted="both")
        elif fault.kind is FaultKind.DGPS_GAP:
            receiver = replace(receiver, gone_s=(*receiver.gone_s, (fault.from_s, fault.to_s)))
        else:
            receiver = replace(receiver, stepped_s=(*receiver.stepped_s, (fault.from_s, fault.to_s, fault.by)))
    return SimulatedDeviceFaults(timetable=tuple(timetable), receiver=receiver)


def check_timetable(timetable: Sequence[TimedFault], rig: Rig) -> None:
    """Raise `InputError` where a fault names a station that is not there, or a PTU where there is none."""
    for fault in timetable:
        where, turning = f"fault {fault.what!r}: station", [s.name for s in rig.stations if not s.fixed]
        if fault.station not in rig.names:
            raise InputError(where, got=repr(fault.station), wanted="one of " + ", ".join(rig.names))
        if fault.what == PTU_SILENT and fault.station not in turning:
            raise InputError(where, got=f"{fault.station!r}, which is fixed", wanted="one that has a pan-tilt unit")
