"""What follows from the pipeline's reports during an approach: advice, landing reports, autopilot stream, JSON lines.

One object for operation and replay. It is fed every report, and told the time often; events that it returns belong into
the log and the recording.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.approach.approach_state import ApproachState
from groundstation.approach.estimate_record import estimate_record
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.output import AutopilotOutput
from groundstation.autopilot.settings import AutopilotMode
from groundstation.autopilot.vehicle_state import GnssReport
from groundstation.errors import InputError
from groundstation.files.whole_file import write_text_whole
from groundstation.integrity.approach_advice import AdviceLevel
from groundstation.integrity.approach_integrity import ApproachIntegrity
from groundstation.integrity.gnss_watch import GnssWatch
from groundstation.integrity.own_position import OwnPosition
from groundstation.landing.landing_monitor import LandingMonitor, LandingStep
from groundstation.landing.landing_report import LandingReport, landing_table
from groundstation.landing.touchdown import NoTouchdown, TouchdownForecast
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import Kinematics, StepReport, TrackEvent, TrackStatus
from groundstation.rig.rig import Rig
from groundstation.sinks.udp_json import UdpJsonSender

LANDINGS_FILE, LANDINGS_FORMAT = "landings.json", "groundstation-landings/1"
# a time to alert of half a second wants more than two evaluations in it
_ADVISE_EVERY_S = 0.05
# one sigma, horizontal and vertical, of a receiver that does not tell: a plain one
_PLAIN_SIGMA_M = (2.5, 4.0)
_FIX_3D = 3
# no aircraft is landed so far before a runway
_SHORT_M = 100.0
# MAV_SEVERITY
_CRITICAL, _WARNING, _INFO = 2, 4, 6
_SEVERITIES = {AdviceLevel.GO: _INFO, AdviceLevel.CAUTION: _WARNING, AdviceLevel.WAVE_OFF: _CRITICAL}


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachSummary:
    """Result: reports of the approaches, and a line each of what was sent."""

    reports: tuple[LandingReport, ...]
    lines: tuple[str, ...]

    @property
    def text(self) -> str:
        """The table of the landings and the lines; "" without either."""
        table = [landing_table(self.reports)] if self.reports else []
        return "\n".join([*table, *self.lines])

    def write(self, folder: Path) -> Path | None:
        """Write the reports as ``landings.json``, if there are any; returns its path."""
        if not self.reports:
            return None
        path = folder / LANDINGS_FILE
        values = {"format": LANDINGS_FORMAT, "approaches": [report.to_dict() for report in self.reports]}
        write_text_whole(path, json.dumps(values, indent=1) + "\n")
        return path


class ApproachOutputs:
    """Advice and outputs of one operation or replay.

    Parameters
    ----------
    rig, span_m : as the pipeline has them; ``span_m`` None for an unknown aircraft.
    site : runway, plan and alert limits.
    autopilot : None without a stream; `close` closes it.
    udp : the same for JSON lines, with ``unix_s``, what is added to session time for Unix time.
    frame : the runway frame on Earth; None where that is unknown: then GNSS is not watched.
    """

    def __init__(
        self,
        rig: Rig,
        span_m: float | None,
        site: LandingSite,
        *,
        autopilot: AutopilotOutput | None = None,
        udp: UdpJsonSender | None = None,
        unix_s: float = 0.0,
        frame: LocalFrame | None = None,
    ) -> None:
        if span_m is None:
            self._integrity = ApproachIntegrity(rig, site)
        else:
            self._integrity = ApproachIntegrity(rig, site, span_m=span_m)
        self._runway = site.runway
        self._tracked = False
        self._watch = GnssWatch() if autopilot is not None and frame is not None else None
        self._landing = LandingMonitor(site, gnss=self._watch)
        self._autopilot, self._udp, self._unix_s, self._frame = autopilot, udp, unix_s, frame
        self._advised_s = -np.inf
        self._reports: list[LandingReport] = []
        self._step: LandingStep | None = None
        self._told: AdviceLevel | None = None
        self._gnss_us: int | None = None

    @property
    def runway(self) -> LandingRunway:
        """The site's runway."""
        return self._runway

    @property
    def state(self) -> ApproachState:
        """What is known now."""
        status = None if self._step is None else self._step.status
        if status is None:
            return ApproachState(advice=self._integrity.advice)
        foretold = status.touchdown
        return ApproachState(
            advice=self._integrity.advice,
            deviations=status.deviations,
            touchdown=foretold if isinstance(foretold, TouchdownForecast) else None,
            no_touchdown=foretold if isinstance(foretold, NoTouchdown) else None,
            gnss=status.gnss,
        )

    def note(self, report: StepReport, now_s: float) -> list[TrackEvent]:
        """Take a report that the pipeline gave at session time ``now_s``; return what is to be logged."""
        if self._autopilot is not None:
            self._autopilot.note(report)
        self._tracked |= any(e.status is TrackStatus.TRACKING for e in report.estimates)
        events = self._advised(self._integrity.take(report, now_s))
        self._advised_s = now_s
        events += self._landed(self._landing.step(report))
        if self._udp is not None:
            for estimate in report.estimates:
                self._send(estimate.t_s, estimate.status, estimate.kinematics, estimate.seen_by)
            for state in report.states:
                self._send(state.t_s, state.status, state.kinematics, frozenset())
        return events

    def pass_time(self, now_s: float) -> list[TrackEvent]:
        """Send what is due at session time ``now_s``; return what is to be logged."""
        events: list[TrackEvent] = []
        if self._autopilot is not None:
            self._autopilot.pass_time(now_s)
            events += self._own_position(self._autopilot)
        if now_s >= self._advised_s + _ADVISE_EVERY_S:
            self._advised_s = now_s
            events += self._advised(self._integrity.pass_time(now_s))
        return events

    def lines(self, now_s: float) -> tuple[str, ...]:
        """Return lines for the operator."""
        sent = () if self._autopilot is None else (self._autopilot.status_text(now_s),)
        return (*self.state.lines(now_s), *sent)

    def finish(self) -> list[TrackEvent]:
        """End the approach that is flown, at the end of the input."""
        return self._landed(self._landing.finish())

    def summary(self) -> ApproachSummary:
        """Return what came of it."""
        lines = self._doubts()
        if self._autopilot is not None:
            lines.append(f"autopilot: {self._autopilot.summary().text()}")
        if self._udp is not None:
            lost = f", {self._udp.dropped} dropped" if self._udp.dropped else ""
            lines.append(f"udp: {self._udp.sent} estimates sent{lost}")
        return ApproachSummary(reports=tuple(self._reports), lines=tuple(lines))

    def _doubts(self) -> list[str]:
        """Return a line for each sign that the site's runway is not the one that was flown to."""
        x, y, z = self._runway.threshold_m
        site = f"the site's threshold ({x:g}, {y:g}, {z:g}) m, direction {math.degrees(self._runway.direction_rad):g}°"
        if self._tracked and not self._reports:
            return [f"no approach: the track never came towards {site}"]
        short = [r for r in self._reports if r.touchdown is not None and r.touchdown.point_m[0] < -_SHORT_M]
        return [
            f"approach {r.number} touched down {-r.touchdown.point_m[0]:.0f} m before {site}: is it that runway's?"
            for r in short
            if r.touchdown is not None
        ]

    def close(self) -> None:
        """Close the links."""
        if self._autopilot is not None:
            self._autopilot.close()
        if self._udp is not None:
            self._udp.close()

    # ------------------------------------------------------------------------------------------ inside
    def _advised(self, events: Sequence[TrackEvent]) -> list[TrackEvent]:
        """Pass a change of the advice on to the landing report and to the pilot."""
        advice = self._integrity.advice
        if events:
            self._landing.note(events)
        if self._autopilot is not None and advice is not None and events:
            self._told = advice.level
            self._autopilot.send_text(_SEVERITIES[advice.level], f"{advice.level}: {advice.reason}")
        return list(events)

    def _landed(self, step: LandingStep) -> list[TrackEvent]:
        self._step = step
        self._reports += step.reports
        if self._autopilot is not None:
            for event in step.events:
                if event.level != "info":
                    self._autopilot.send_text(_WARNING, event.text)
        return list(step.events)

    def _own_position(self, autopilot: AutopilotOutput) -> list[TrackEvent]:
        """Give the aircraft's own GNSS position to the watch: of a receiver that is not this stream."""
        if self._frame is None:
            return []
        settings = autopilot.settings
        ours = settings.gps_id if settings.mode is AutopilotMode.GPS_INPUT else None
        gnss = next((report for k, report in sorted(autopilot.vehicle.gnss.items()) if k != ours), None)
        if gnss is None or gnss.fix_type < _FIX_3D or gnss.source_us == self._gnss_us:
            return []
        self._gnss_us = gnss.source_us
        try:
            position = _own_position(gnss, self._frame)
        except InputError:
            # a place far from here: that of another aircraft, or damaged
            return []
        return self._landed(self._landing.take_own_position(position))

    def _send(self, t_s: float, status: Any, kinematics: Kinematics | None, seen_by: frozenset[str]) -> None:
        if self._udp is not None:
            record = estimate_record(
                t_s, status, kinematics, seen_by, self.state, unix_s=self._unix_s, frame=self._frame
            )
            self._udp.send(record)


def _own_position(gnss: GnssReport, frame: LocalFrame) -> OwnPosition:
    horizontal = _PLAIN_SIGMA_M[0] if gnss.sigma_horizontal_m is None else gnss.sigma_horizontal_m
    vertical = _PLAIN_SIGMA_M[1] if gnss.sigma_vertical_m is None else gnss.sigma_vertical_m
    return OwnPosition(
        t_s=gnss.received_s,
        position_runway_m=frame.runway_position(gnss.lat_deg, gnss.lon_deg, gnss.height_amsl_m),
        sigma_m=np.array([horizontal, horizontal, vertical]),
    )
