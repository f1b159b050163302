"""Events of a recording by the clocks and axes of another rig than the one that they were recorded by.

A recording has session times and angles: stamps and readings of the devices as the recorded rig corrects them. Another
rig corrects the same stamps and readings, which its own one gives back.
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace

from groundstation.errors import RigError
from groundstation.messages import Epoch, Event, Frame, FrameAngles, PixelMeasurement, PtuSample, ReferenceFix
from groundstation.rig.ptu_axes import AxisCorrection, PtuAxes
from groundstation.rig.rig import EQUAL_CLOCKS, ClockModel, Rig, Station

Clock = Callable[[float], float]


class Recorrection:
    """Maps events, in their order, from one rig to another; events of stations that one of them lacks stay.

    Positions of a reference receiver stay, too, but for what ``reference`` makes of them.
    Angles of stations in ``applied``, which have no readings, stay. Where the readings are not known any more, of a
    head whose backlash was corrected, a rig without axes is that of the angles, as in a folder converted from them:
    they stay. Raises `RigError` for one with other axes.
    """

    def __init__(
        self,
        recorded: Rig,
        wanted: Rig,
        applied: Collection[str] = (),
        reference: Callable[[ReferenceFix], ReferenceFix] | None = None,
    ) -> None:
        self._applied = applied
        self._reference = reference
        self._cameras: dict[str, Clock] = {}
        self._heads: dict[str, Callable[[PtuSample], PtuSample]] = {}
        for station in wanted.stations:
            if station.name not in recorded.names:
                continue
            own = recorded[station.name]
            before, after = own.camera_clock or EQUAL_CLOCKS, station.camera_clock or EQUAL_CLOCKS
            if _differ(before, after):
                self._cameras[station.name] = _clock(before, after)
            if not station.fixed and not own.fixed:
                self._add_head(own, station, wanted.path)

    @property
    def is_needed(self) -> bool:
        """Whether any event changes."""
        return bool(self._cameras or self._heads or self._reference)

    def of(self, events: Iterator[Event]) -> Iterator[Event]:
        """Yield the events."""
        for event in events:
            yield self._corrected(event)

    def _corrected(self, event: Event) -> Event:
        if isinstance(event, PtuSample) and event.sigma_rad is None:
            head = self._heads.get(event.station)
            return event if head is None else head(event)
        if isinstance(event, Frame | PixelMeasurement | FrameAngles | PtuSample):
            camera = self._cameras.get(event.station)
            return event if camera is None else replace(event, t_s=camera(event.t_s))
        if isinstance(event, Epoch) and self._cameras:
            moved = [self._cameras[name](event.t_s) if name in self._cameras else event.t_s for name in event.stations]
            return replace(event, t_s=sum(moved) / len(moved)) if moved else event
        if isinstance(event, ReferenceFix) and self._reference is not None:
            return self._reference(event)
        return event

    def _add_head(self, own: Station, station: Station, path: str) -> None:
        clocks, axes = _differ(own.ptu_clock, station.ptu_clock), own.ptu_axes
        same = replace(axes, lean_rad=0.0) == replace(station.ptu_axes, lean_rad=0.0)
        hidden = _hides_readings(axes)
        bare = hidden and station.ptu_axes.is_ideal_apart_from_lean
        unchanged = same or bare or station.name in self._applied
        if not clocks and unchanged:
            return
        if hidden and not unchanged:
            got = f"other axes of {station.name} than the recorded ones, whose backlash has been taken out"
            raise RigError(f"{path}: station {station.name}: ptu_axes", got=got, wanted="the recorded ones")
        clock = _clock(own.ptu_clock, station.ptu_clock) if clocks else None
        correction = None if unchanged else AxisCorrection(station.ptu_axes)

        def corrected(sample: PtuSample) -> PtuSample:
            t_s = sample.t_s if clock is None else clock(sample.t_s)
            pan_rad, tilt_rad = sample.pan_rad, sample.tilt_rad
            if correction is not None:
                pan_rad, tilt_rad = correction.angles(*axes.readings(pan_rad, tilt_rad, 0.0, 0.0))
            return replace(sample, t_s=t_s, pan_rad=pan_rad, tilt_rad=tilt_rad)

        self._heads[station.name] = corrected


def without_axes_now(recorded: Rig, wanted: Rig, applied: Collection[str] = ()) -> list[str]:
    """Return the stations whose readings `Recorrection` takes for angles, and whose recorded angles are corrected."""
    return [
        station.name
        for station in wanted.stations
        if station.name in recorded.names
        and station.name not in applied
        and not (station.fixed or recorded[station.name].fixed)
        and station.ptu_axes.is_ideal_apart_from_lean
        and not recorded[station.name].ptu_axes.is_ideal_apart_from_lean
        and not _hides_readings(recorded[station.name].ptu_axes)
    ]


def _hides_readings(axes: PtuAxes) -> bool:
    return axes.pan_backlash_rad != 0.0 or axes.tilt_backlash_rad != 0.0


def _differ(one: ClockModel, other: ClockModel) -> bool:
    return (one.offset_s, one.drift_ppm) != (other.offset_s, other.drift_ppm)


def _clock(before: ClockModel, after: ClockModel) -> Clock:
    return lambda t_s: after.session_from_device(before.device_from_session(t_s))
