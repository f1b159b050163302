"""The approach as it is watched: deviations, touchdown foretold, GNSS verdict, and a report after each landing.

Fed with the pipeline's reports, it answers with a record of the present, lines for the log, and the reports of
approaches that have ended. It reads no clock: the same reports give the same answers.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from groundstation.integrity.gnss_watch import GnssAssessment, GnssVerdict, GnssWatch
from groundstation.integrity.own_position import OwnPosition
from groundstation.landing.approach_record import ApproachRecord
from groundstation.landing.glide_path import ApproachDeviations, approach_deviations
from groundstation.landing.landing_report import ApproachOutcome, LandingReport
from groundstation.landing.threshold_state import threshold_state
from groundstation.landing.touchdown import NoTouchdown, TouchdownForecast, TouchdownPredictor
from groundstation.landing.touchdown_detection import Contact, TouchdownDetector
from groundstation.landing_site.approach_prior import ApproachPrior, WheelPosition
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.messages import Kinematics, StepReport, TrackEstimate, TrackEvent, TrackState, TrackStatus

_KNOWN = (TrackStatus.TRACKING, TrackStatus.COASTING)
# an approach begins with an aircraft before the threshold, so high, m, that flies towards it, m/s, and does not climb
_BEGINS_M, _TOWARDS_M_S, _NOT_CLIMBING_M_S = 2.0, 2.0, 0.5
# and ends when nothing is known of it for so long
_GONE_S = 5.0


def _usable(status: TrackStatus, known: Kinematics | None) -> Kinematics | None:
    """Return an estimate that may be shown: of a track, and finite, since a filter may fail in the air."""
    if known is None or status not in _KNOWN:
        return None
    parts = (known.position_runway_m, known.velocity_runway_m_s, known.covariance)
    return known if all(bool(np.all(np.isfinite(part))) for part in parts) else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandingStatus:
    """What is known of the approach at session time ``t_s``.

    Attributes
    ----------
    track : the track's status.
    approach : number of the approach that is flown, None between approaches.
    deviations : None without an estimate.
    touchdown : the newest forecast, or why there is none; None without an estimate.
    gnss : None where the aircraft's own position is not watched.
    """

    t_s: float
    track: TrackStatus
    approach: int | None
    deviations: ApproachDeviations | None
    touchdown: TouchdownForecast | NoTouchdown | None
    gnss: GnssAssessment | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingStep:
    """The newest status, None before the first estimate or state; log lines; reports of approaches that have ended."""

    status: LandingStatus | None
    events: tuple[TrackEvent, ...] = ()
    reports: tuple[LandingReport, ...] = ()


class LandingMonitor:
    """Watches approaches to one site.

    Parameters
    ----------
    site : runway, plan and limits.
    wheels, prior : as of `TouchdownPredictor`.
    gnss : compares the aircraft's own positions, None without such.
    forecast_every_s : a forecast takes some 10 ms of a core; the newest stands in between.
    """

    def __init__(
        self,
        site: LandingSite,
        wheels: WheelPosition | None = None,
        prior: ApproachPrior | None = None,
        gnss: GnssWatch | None = None,
        forecast_every_s: float = 0.5,
    ) -> None:
        wheels = site.wheels if wheels is None else wheels
        self._site, self._gnss, self._every_s = site, gnss, forecast_every_s
        self._wheels = wheels
        self._predictor = TouchdownPredictor(site, wheels, prior)
        self._detector = TouchdownDetector(wheels.below_nose_m, wheels.behind_nose_m)
        self._approach: ApproachRecord | None = None
        self._approaches = 0
        self._status: LandingStatus | None = None
        self._foretold: TouchdownForecast | NoTouchdown | None = None
        self._foretold_s = -float("inf")
        self._verdict = GnssVerdict.SILENT
        self._events: list[TrackEvent] = []
        self._reports: list[LandingReport] = []

    def step(self, report: StepReport) -> LandingStep:
        """Take a report of the pipeline."""
        for estimate in report.estimates:
            self._take_estimate(estimate)
        for state in report.states:
            self._take_state(state)
        return self._taken()

    def note(self, events: Iterable[TrackEvent]) -> None:
        """Take lines that the report of the present approach shall hold: wave-offs and other calls."""
        if self._approach is not None:
            for event in events:
                self._approach.add_event(event)

    def take_own_position(self, position: OwnPosition) -> LandingStep:
        """Take a position that the aircraft reports; without a `GnssWatch` it is not used."""
        if self._gnss is not None:
            self._judge(self._gnss.take(position), position.t_s)
        return self._taken()

    def finish(self) -> LandingStep:
        """End the approach that is flown, at the end of the input."""
        self._end_track()
        return self._taken()

    def _taken(self) -> LandingStep:
        events, reports = tuple(self._events), tuple(self._reports)
        self._events.clear()
        self._reports.clear()
        return LandingStep(status=self._status, events=events, reports=reports)

    # ------------------------------------------------------------------------------------- estimates
    def _take_estimate(self, estimate: TrackEstimate) -> None:
        self._age(estimate.t_s)
        known = _usable(estimate.status, estimate.kinematics)
        if known is not None:
            self._follow(estimate.t_s, known)
        self._enter(estimate.t_s, estimate.status, known)

    def _take_state(self, state: TrackState) -> None:
        """Show the state of knowledge between pairs; no measurement is behind it, and no touchdown is seen by it."""
        self._age(state.t_s)
        self._enter(state.t_s, state.status, _usable(state.status, state.kinematics))

    def _enter(self, t_s: float, status: TrackStatus, known: Kinematics | None) -> None:
        """Make the status of a time, and log how it has changed."""
        deviations = None if known is None else approach_deviations(self._site, t_s, known)
        if known is not None:
            self._foretell(t_s, known)
        if self._status is not None and self._status.track is not status and self._approach is not None:
            self._approach.add_event(TrackEvent(t_s=t_s, level="info", text=f"track: {status}"))
        gnss = None if self._gnss is None else self._gnss.assessment(t_s)
        if gnss is not None:
            self._judge(gnss, t_s)
        self._status = LandingStatus(
            t_s=t_s,
            track=status,
            approach=None if self._approach is None else self._approaches,
            deviations=deviations,
            touchdown=None if known is None else self._foretold,
            gnss=gnss,
        )

    def _follow(self, t_s: float, known: Kinematics) -> None:
        """Enter an estimate into the approach, which it may begin or end."""
        found = approach_deviations(self._site, t_s, known)
        if self._gnss is not None:
            self._gnss.add_estimate(t_s, known)
        if self._approach is None and self._approaches_runway(found):
            self._approaches += 1
            self._approach = ApproachRecord(self._approaches, t_s, self._site.alert_limits.low_height_m)
        if self._approach is not None:
            self._approach.add(found)
        contact = self._detector.add(threshold_state(self._site.runway, t_s, known))
        if contact is Contact.LANDED:
            self._end(ApproachOutcome.LANDED)
        elif self._approach is not None:
            # a bounce is no go-around
            self._approach.touched |= contact is Contact.CLIMBED_AWAY
            if self._approach.has_gone_around:
                self._end(ApproachOutcome.TOUCHED if self._approach.touched else ApproachOutcome.GO_AROUND)

    def _approaches_runway(self, found: ApproachDeviations) -> bool:
        return (
            found.to_threshold.value > 0.0
            and found.height.value - self._wheels.below_nose_m > _BEGINS_M
            and found.ground_speed.value > _TOWARDS_M_S
            and -found.sink_rate.value < _NOT_CLIMBING_M_S
        )

    def _foretell(self, t_s: float, known: Kinematics) -> None:
        if self._foretold is not None and t_s - self._foretold_s < self._every_s - 1e-9:
            return
        self._foretold, self._foretold_s = self._predictor.forecast(t_s, known), t_s
        if self._approach is not None and isinstance(self._foretold, TouchdownForecast):
            self._approach.add_forecast(self._foretold)

    # ------------------------------------------------------------------------------------------ ends
    def _age(self, t_s: float) -> None:
        """End an approach of which nothing has been known for long."""
        if self._approach is not None and t_s - self._approach.last_s > _GONE_S:
            self._end_track()

    def _end_track(self) -> None:
        if self._detector.finish() is Contact.LANDED:
            self._end(ApproachOutcome.LANDED)
        elif self._approach is not None:
            self._end(ApproachOutcome.TOUCHED if self._approach.touched else ApproachOutcome.NOT_SEEN)
        self._detector.forget()
        if self._gnss is not None:
            self._gnss.forget()

    def _end(self, outcome: ApproachOutcome) -> None:
        ended, self._approach = self._approach, None
        if ended is None:
            return
        touchdown = self._detector.touchdown if outcome is ApproachOutcome.LANDED else None
        report = ended.report(outcome, touchdown)
        self._reports.append(report)
        words = f"approach {report.number}: {outcome}"
        if touchdown is not None:
            along, right = touchdown.point_m.tolist()
            words += f" {along:.1f} m past the threshold, {right:+.1f} m right, at {touchdown.sink_m_s:.2f} m/s"
        self._events.append(TrackEvent(t_s=report.to_s, level="info", text=words))

    # ------------------------------------------------------------------------------------------ GNSS
    def _judge(self, found: GnssAssessment, t_s: float) -> None:
        """Log a verdict that differs from the last."""
        if found.verdict is self._verdict:
            return
        called = found.verdict.called
        if called or self._verdict.called:
            event = TrackEvent(t_s=t_s, level="warning" if called else "info", text=found.reason)
            self._events.append(event)
            self.note([event])
        self._verdict = found.verdict
