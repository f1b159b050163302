"""Scheduled faults applied to the events and frames of a simulated flight.

A fault changes what a receiver gets; the truth is not changed. Times are session time by the stamps, s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, MaskArray
from groundstation.messages import DgpsFix, Event, PixelMeasurement, PtuSample
from groundstation.simulation.device_clocks import stated_times
from groundstation.simulation.parameter_checks import require, require_finite
from groundstation.simulation.simulate import SimulatedFlight


class FaultKind(StrEnum):
    """Kind of a fault."""

    CAMERA_LOST = "camera_lost"
    CAMERA_FROZEN = "camera_frozen"
    CAMERA_LATE = "camera_late"
    PTU_SILENT = "ptu_silent"
    PTU_SPIKE = "ptu_spike"
    PTU_STUCK = "ptu_stuck"
    DGPS_GAP = "dgps_gap"
    CAMERA_CLOCK_STEP = "camera_clock_step"
    PTU_CLOCK_STEP = "ptu_clock_step"
    DGPS_CLOCK_STEP = "dgps_clock_step"


_OF_DGPS = frozenset({FaultKind.DGPS_GAP, FaultKind.DGPS_CLOCK_STEP})
_OF_CAMERAS = frozenset(
    {FaultKind.CAMERA_LOST, FaultKind.CAMERA_FROZEN, FaultKind.CAMERA_LATE, FaultKind.CAMERA_CLOCK_STEP}
)
_IN_SECONDS = frozenset(
    {FaultKind.CAMERA_LATE, FaultKind.CAMERA_CLOCK_STEP, FaultKind.PTU_CLOCK_STEP, FaultKind.DGPS_CLOCK_STEP}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One fault.

    Attributes
    ----------
    kind : ``camera_lost`` gives no frames, ``camera_frozen`` repeats its last one, ``camera_late`` stamps frames ``by``
        s late, as one that stamps on arrival does; ``ptu_silent`` gives no readings, ``ptu_spike`` adds ``by`` rad to
        pan and tilt, ``ptu_stuck`` repeats its last reading; ``dgps_gap`` gives no fixes; a ``…_clock_step`` puts
        stamps ``by`` s forward.
    station : its name; empty for DGPS.
    from_s, to_s : when; ``to_s`` is not part of it.
    by : size, s or rad; 0 where the kind has none.
    """

    kind: FaultKind
    station: str = ""
    from_s: float = 0.0
    to_s: float = math.inf
    by: float = 0.0

    def __post_init__(self) -> None:
        require_finite(f"fault {self.kind}: from", self.from_s)
        require(self.to_s > self.from_s, f"fault {self.kind}: to", got=self.to_s, wanted=f"after {self.from_s:g} s")
        require(self.to_s > 0.0, f"fault {self.kind}: to", got=self.to_s, wanted="after 0 s, when the flight begins")
        require_finite(f"fault {self.kind}: by", self.by)
        sized = self.kind in _IN_SECONDS or self.kind is FaultKind.PTU_SPIKE
        wanted = "a size other than 0" if sized else "0: this kind has no size"
        require(sized == (self.by != 0.0), f"fault {self.kind}: by", got=self.by, wanted=wanted)
        late = self.kind is not FaultKind.CAMERA_LATE or self.by > 0.0
        require(late, f"fault {self.kind}: by", got=self.by, wanted="a size > 0: no picture comes before it was taken")
        named = self.kind not in _OF_DGPS
        wanted = "a station's name" if named else "none"
        require(named == bool(self.station), f"fault {self.kind}: station", got=repr(self.station), wanted=wanted)

    def holds(self, t_s: FloatArray) -> MaskArray:
        """Return which of the times (n,) are within."""
        return np.asarray((t_s >= self.from_s) & (t_s < self.to_s))

    def at(self, t_s: float) -> bool:
        """Return whether a time is within."""
        return self.from_s <= t_s < self.to_s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DeliveredFrames:
    """Frames that a camera delivers of n exposures.

    ``t_s`` (n,) are the stamps, session time as the rig maps them; ``shown`` (n,) the exposure whose picture is
    delivered; ``there`` (n,) whether one is delivered at all.
    """

    t_s: FloatArray
    shown: NDArray[np.int64]
    there: MaskArray


def check_faults(flight: SimulatedFlight, faults: Sequence[Fault]) -> None:
    """Raise `ScenarioError` where a fault names a device that this flight has not."""
    names = flight.rig.names
    for fault in faults:
        where = f"fault {fault.kind}: station"
        if fault.station:
            require(fault.station in names, where, got=repr(fault.station), wanted="one of " + ", ".join(names))
            turning = fault.kind in _OF_CAMERAS or not flight.rig[fault.station].fixed
            require(turning, where, got=f"{fault.station!r}, which is fixed", wanted="one that has a pan-tilt unit")


def delivered_frames(flight: SimulatedFlight, name: str, faults: Sequence[Fault] = ()) -> DeliveredFrames:
    """Return the frames that the camera of a station delivers, with or without a detection."""
    true, stated = flight.scenario.true_rig[name], flight.rig[name]
    t = stated_times(flight.truth.stations[name].t_s, true.camera_clock, stated.camera_clock)
    stamps, shown, there = t.copy(), np.arange(t.size), np.ones(t.size, dtype=bool)
    for fault in faults:
        if fault.station != name:
            continue
        hit = fault.holds(t)
        if fault.kind is FaultKind.CAMERA_LOST:
            there &= ~hit
        elif fault.kind is FaultKind.CAMERA_FROZEN and hit.any():
            shown[hit] = max(int(np.argmax(hit)) - 1, 0)
        elif fault.kind in (FaultKind.CAMERA_LATE, FaultKind.CAMERA_CLOCK_STEP):
            stamps[hit] += fault.by
    return DeliveredFrames(t_s=stamps, shown=shown, there=there)


def with_faults(flight: SimulatedFlight, faults: Sequence[Fault]) -> SimulatedFlight:
    """Return the flight as its receivers get it; arrivals stay, but for late frames. Truth is as it was."""
    check_faults(flight, faults)
    frames = {name: delivered_frames(flight, name, faults) for name in flight.rig.names}
    latest: dict[str, PtuSample] = {}
    pixels = {(e.station, e.epoch): e for e in flight.events if isinstance(e, PixelMeasurement)}
    kept: list[tuple[float, Event]] = []
    for arrival, event in zip(flight.arrival_s, flight.events, strict=True):
        late, changed = 0.0, event
        if isinstance(event, PtuSample):
            sample = _reading(event, faults, latest)
            if sample is None:
                continue
            changed = sample
        elif isinstance(event, PixelMeasurement):
            own, k = frames[event.station], event.epoch
            shown = pixels.get((event.station, int(own.shown[k])))
            if not own.there[k] or shown is None:
                continue
            changed = replace(shown, t_s=float(own.t_s[k]), epoch=k)
            late = sum(f.by for f in faults if _late(f, event))
        kept.append((float(arrival) + late, changed))
    kept.sort(key=lambda pair: pair[0])
    return replace(
        flight,
        events=tuple(event for _, event in kept),
        arrival_s=np.array([arrival for arrival, _ in kept]),
        dgps=_fixes(flight, faults),
    )


def _late(fault: Fault, event: PixelMeasurement) -> bool:
    return fault.kind is FaultKind.CAMERA_LATE and fault.station == event.station and fault.at(event.t_s)


def _reading(sample: PtuSample, faults: Sequence[Fault], latest: dict[str, PtuSample]) -> PtuSample | None:
    """Return what becomes of a reading; ``latest`` is the last one of each station before it stuck."""
    given = sample
    stuck = False
    for fault in faults:
        if fault.station != sample.station or not fault.at(sample.t_s):
            continue
        if fault.kind is FaultKind.PTU_SILENT:
            return None
        if fault.kind is FaultKind.PTU_STUCK and sample.station in latest:
            stuck = True
            held = latest[sample.station]
            given = replace(given, pan_rad=held.pan_rad, tilt_rad=held.tilt_rad)
        elif fault.kind is FaultKind.PTU_SPIKE:
            given = replace(given, pan_rad=given.pan_rad + fault.by, tilt_rad=given.tilt_rad + fault.by)
        elif fault.kind is FaultKind.PTU_CLOCK_STEP:
            given = replace(given, t_s=given.t_s + fault.by)
    if not stuck:
        latest[sample.station] = sample
    return given


def _fixes(flight: SimulatedFlight, faults: Sequence[Fault]) -> tuple[DgpsFix, ...]:
    model = flight.scenario.dgps
    if model is None:
        return ()
    fixes = []
    for fix in flight.dgps:
        # the timetable is in session time; a fix at its very start is within
        t = round((fix.t_s - model.clock_offset_s) / (1.0 + model.clock_drift_ppm * 1e-6), 9)
        now = [f for f in faults if f.kind in _OF_DGPS and f.at(t)]
        if any(f.kind is FaultKind.DGPS_GAP for f in now):
            continue
        fixes.append(replace(fix, t_s=fix.t_s + sum(f.by for f in now)))
    return tuple(fixes)
