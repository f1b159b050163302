"""Whether a session's angles, pixels, clocks and rig can be right, checked during its replay."""

from collections.abc import Iterable, Iterator

import numpy as np

from groundstation.integrity.apparent_span import ApparentSpanMonitor
from groundstation.integrity.black_bars import BlackBarsMonitor
from groundstation.integrity.camera_mount import odd_mounts, odd_mounts_line
from groundstation.integrity.encoder_counts import EncoderCountsMonitor
from groundstation.integrity.head_motion import HeadMotionMonitor
from groundstation.integrity.head_motion_fault import fault_lines
from groundstation.integrity.lines_of_sight import KnownPositions, LinesOfSight
from groundstation.integrity.ray_agreement import RayAgreementMonitor
from groundstation.integrity.relative_pan import RelativePanMonitor
from groundstation.messages import Event, StepReport
from groundstation.rig.rig import Rig
from groundstation.rig.stations_apart import FAR_APART_M


class InputChecks:
    """Compares a session's inputs with each other; a sink, for the pixels that are found in pictures.

    ``span_m`` is the aircraft's wing span as it was given, None where it was not.
    """

    def __init__(self, rig: Rig, span_m: float | None = None) -> None:
        geometries = {station.name: station.geometry() for station in rig.stations}
        turning = [station.name for station in rig.stations if not station.fixed]
        sigmas_rad = {station.name: station.angle_sigma_rad for station in rig.stations}
        self._heads = HeadMotionMonitor({name: geometries[name] for name in turning}, sigmas_rad)
        self._rays = RayAgreementMonitor(geometries, turning)
        self._size = ApparentSpanMonitor(geometries, span_m)
        self._pan = RelativePanMonitor(geometries, span_m)
        self._sights = LinesOfSight(geometries, turning)
        self._counts = EncoderCountsMonitor({s.name: s.ptu_resolution_rad for s in rig.stations if not s.fixed})
        self._bars = BlackBarsMonitor(geometries)
        self._odd_mounts = odd_mounts({s.name: s.head_from_camera_wxyz for s in rig.stations if not s.fixed})
        self._span_m = span_m
        places = np.array([station.ptu_position_m for station in rig.stations])
        self._apart_m = float(np.linalg.norm(np.ptp(places, axis=0)))

    def watched(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, and take from them what the checks need."""
        seen = self._bars.watched(self._heads.watched(events))
        return self._counts.watched(self._sights.watched(self._rays.watched(seen)))

    def write(self, report: StepReport) -> None:
        """Take the pixels and silhouettes that were found."""
        self._size.add(report)
        self._pan.add(report)
        for camera in report.cameras:
            self._rays.add_report(camera)

    def close(self) -> None:
        """Do nothing: the checks are of what has been seen."""

    def why_nothing_was_seen(self, references: Iterable[KnownPositions]) -> tuple[str, ...]:
        """Return what the cameras' directions say of a run that tracked no target, against what is known of it."""
        known = list(references)
        line = self._sights.line(known) or self._sights.in_pictures(known, self._span_m)
        return () if line is None else (line,)

    def contradictions(self, *, tracked: bool) -> tuple[str, ...]:
        """Return a line on each contradiction; without a name for the fault only if no target was ``tracked``.

        A near target that fills a picture or a flock of birds can look like a fault of no known kind.
        ``tracked`` is whether a target was tracked in a good part of the epochs.
        """
        if not tracked and self._apart_m > FAR_APART_M:
            return (f"the stations are {self._apart_m:.0f} m apart: is the rig in metres?",)
        counts = self._counts.line(lambda name: self._is_in_degrees(name, tracked=tracked))
        if counts is not None:
            return (counts,)
        found = self._compared(tracked=tracked)
        mount = self._mount_line()
        # either may explain the other: a mount turned by 90 degrees looks like other faults, and may be meant
        if mount is not None and (found or self._sights.line() is not None):
            return (*found, mount)
        return found

    def notes(self, *, tracked: bool) -> list[str]:
        """Return a line on each thing that is possible, but seldom meant.

        That is black bars in the pictures, and of a run that ``tracked`` no target a mount that nothing speaks against.
        """
        mount = None if tracked else self._mount_line()
        told = [] if mount is None or mount in self.contradictions(tracked=tracked) else [mount]
        return [*self._bars.lines(), *told]

    def _mount_line(self) -> str | None:
        """Return a line on mounts that turn the axis away; None if there are none, or if pictures or rays confirm."""
        odd = {name: off for name, off in self._odd_mounts.items() if not self._heads.confirms(name)}
        if not odd or (self._rays.meet() and not self._heads.faults()):
            return None
        return odd_mounts_line(odd)

    def _is_in_degrees(self, name: str, *, tracked: bool) -> bool:
        """Return whether a head's readings are in degrees, by the motion of its pictures or by its rays."""
        if self._heads.confirms(name):
            return True
        # symmetric rays meet in any unit: the pictures' motion must not speak against it
        return tracked and self._rays.meet() and all(fault.station != name for fault in self._heads.faults())

    def _compared(self, *, tracked: bool) -> tuple[str, ...]:
        """Return a line on each contradiction between pictures, readings and rig."""
        faults = [f for f in self._heads.faults() if f.hypothesis is not None or not tracked]
        if faults:
            return fault_lines(faults)
        rays = self._rays.fault(self._heads.refutes)
        if rays is not None and (rays.hypotheses or not tracked):
            return (rays.line(),)
        for found in (self._pan.fault(), self._size.fault()):
            if found is not None:
                return (found.line(),)
        return ()
