"""Approaches as they are watched: what is a landing and what is none, its report, forecasts and log lines."""

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from groundstation.integrity.gnss_watch import GnssVerdict, GnssWatch
from groundstation.integrity.own_position import OwnPosition
from groundstation.landing.landing_monitor import LandingMonitor, LandingStatus
from groundstation.landing.landing_report import ApproachOutcome, LandingReport, landing_table
from groundstation.landing.touchdown import NoTouchdown, TouchdownForecast
from groundstation.landing_site.approach_prior import ApproachPrior
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import StepReport, TrackEvent, TrackState, TrackStatus
from groundstation.simulation.drawn_flights import FlightKind, FlightSpec, build_flight
from groundstation.simulation.planned_landing import draw_planned_landing
from groundstation.simulation.repeated_landings import RepeatedLandings
from groundstation.simulation.trajectory import SampledTrajectory, Trajectory
from tests.landing.approaches import GLIDE_RAD, SITE, WHEELS
from tests.landing.flights import reports_of, tracked

# the site of the simulation's flights: they land towards the stations and touch down at y = 130 m
_PLAIN = LandingSite(
    runway=LandingRunway(threshold_m=(0.0, 150.0, 0.0)),
    approach=PlannedApproach(glide_path_rad=GLIDE_RAD, aim_past_threshold_m=15.0, speed_m_s=18.0),
)


@dataclass(frozen=True)
class _Watched:
    statuses: list[LandingStatus]
    events: list[TrackEvent]
    reports: list[LandingReport]


def _watch(monitor: LandingMonitor, trajectory: Trajectory, seed: int = 0, until_s: float | None = None) -> _Watched:
    found = _Watched([], [], [])
    steps = [monitor.step(report) for report in reports_of(trajectory, seed=seed, until_s=until_s)]
    for step in [*steps, monitor.finish()]:
        if step.status is not None:
            found.statuses.append(step.status)
        found.events.extend(step.events)
        found.reports.extend(step.reports)
    return found


def _outcomes(kind: FlightKind, **changed: float) -> list[ApproachOutcome]:
    flown = build_flight(replace(FlightSpec(kind=kind), **changed), 0)  # type: ignore[arg-type]
    monitor = LandingMonitor(_PLAIN, WHEELS, forecast_every_s=100.0)
    return [r.outcome for r in _watch(monitor, flown).reports]


def test_landings_are_reported_where_and_when_they_were() -> None:
    """Expected: eight landings, each found; errors over their sigmas as of normal numbers, and small in themselves."""
    off = []
    for seed in range(8):
        flown = draw_planned_landing(
            np.random.default_rng([seed, 1]), SITE, prior=ApproachPrior(), wheels=WHEELS, start_before_aim_m=120.0
        )
        found = _watch(LandingMonitor(SITE, WHEELS, forecast_every_s=100.0), flown.trajectory, seed)
        assert [r.outcome for r in found.reports] == [ApproachOutcome.LANDED]
        down = found.reports[0].touchdown
        assert down is not None
        place = (down.point_m - flown.touchdown_m) / down.sigma_m
        sink = (down.sink_m_s - flown.touchdown_sink_m_s) / down.sigma_sink_m_s
        off.append([(down.t_s - flown.touchdown_s) / down.sigma_t_s, *place, sink])
        assert down.t_s == pytest.approx(flown.touchdown_s, abs=0.7)
        assert down.sink_m_s == pytest.approx(flown.touchdown_sink_m_s, abs=0.5)
    assert np.all(np.sqrt(np.mean(np.square(off), axis=0)) < 1.8)


@pytest.mark.parametrize("lowest_m", [1.0, 3.0, 8.0])
def test_a_go_around_is_no_landing(lowest_m: float) -> None:
    assert _outcomes(FlightKind.GO_AROUND, lowest_m=lowest_m) == [ApproachOutcome.GO_AROUND]


def test_what_touches_and_flies_on_has_not_landed() -> None:
    """Expected: 0.8 s on the wheels between descent and climb; who rolls for 2 s and more has landed before."""
    t = np.linspace(0.0, 18.0, 1801)
    height = WHEELS.below_nose_m + np.maximum(np.maximum(1.2 * (10.0 - t), 2.0 * (t - 10.8)), 0.0)
    position = np.column_stack([np.zeros_like(t), 340.0 - 20.0 * t, height])
    flown = SampledTrajectory(t_s=t, position_m=position, velocity_m_s=np.gradient(position, t, axis=0))
    reports = _watch(LandingMonitor(_PLAIN, WHEELS, forecast_every_s=100.0), flown).reports
    assert [r.outcome for r in reports] == [ApproachOutcome.TOUCHED]
    rolled = _outcomes(FlightKind.TOUCH_AND_GO, event_s=10.0, level_s=2.0, duration_s=18.0, event_y_m=180.0)
    assert rolled == [ApproachOutcome.LANDED]


@pytest.mark.parametrize("floats_m", [0.7, 1.0])
def test_what_floats_along_after_a_dip_has_not_landed(floats_m: float) -> None:
    """Wheels at 0.1 m for a moment, then level below the height at which an aircraft counts as flying for 4 s.

    Expected: no landing if it climbs away then; if it comes down, one whose touchdown is not that of the dip.
    """
    t = np.linspace(0.0, 20.0, 2001)
    dipped = np.maximum(0.1 + 1.2 * (8.0 - t), np.clip(0.1 + 0.9 * (t - 8.0), 0.1, floats_m))
    for ends, outcome in (
        (np.maximum(dipped, floats_m + 2.0 * (t - 12.5)), ApproachOutcome.TOUCHED),
        (np.clip(floats_m - 0.5 * (t - 12.5), 0.0, dipped), ApproachOutcome.LANDED),
    ):
        position = np.column_stack([np.zeros_like(t), 340.0 - 14.0 * t, WHEELS.below_nose_m + ends])
        flown = SampledTrajectory(t_s=t, position_m=position, velocity_m_s=np.gradient(position, t, axis=0))
        (report,) = _watch(LandingMonitor(_PLAIN, WHEELS, forecast_every_s=100.0), flown).reports
        assert report.outcome is outcome
        if report.touchdown is not None:
            assert report.touchdown.t_s == pytest.approx(12.5 + 2.0 * floats_m, abs=0.7)


def test_a_take_off_is_no_approach() -> None:
    assert _outcomes(FlightKind.TAKE_OFF_TOWARDS, event_s=1.0, event_y_m=250.0) == []
    assert _outcomes(FlightKind.TAKE_OFF_AWAY, event_s=1.0, event_y_m=30.0) == []


def test_a_drawn_landing_with_its_roll_is_one() -> None:
    assert _outcomes(FlightKind.LANDING) == [ApproachOutcome.LANDED]


def test_a_track_that_ends_on_the_runway_has_landed_and_one_in_the_air_has_not() -> None:
    flown = build_flight(FlightSpec(kind=FlightKind.LANDING), 0)
    for until_s, outcome in ((13.2, ApproachOutcome.LANDED), (9.0, ApproachOutcome.NOT_SEEN)):
        monitor = LandingMonitor(_PLAIN, WHEELS, forecast_every_s=100.0)
        assert [r.outcome for r in _watch(monitor, flown, until_s=until_s).reports] == [outcome]


def test_landings_one_after_the_other_are_numbered() -> None:
    """Expected: the simulated day's laps level off at 5 m, so each is an approach without a touchdown."""
    laps = RepeatedLandings(115.0)
    monitor = LandingMonitor(_PLAIN, WHEELS, forecast_every_s=100.0)
    reports = []
    for report in reports_of(laps, seed=3, rate_hz=5.0):
        # out of sight past the stations
        if report.estimates[0].kinematics is not None and report.estimates[0].kinematics.position_runway_m[1] > 50.0:
            reports += monitor.step(report).reports
    reports += monitor.finish().reports
    assert [(r.number, r.outcome) for r in reports] == [(k, ApproachOutcome.NOT_SEEN) for k in (1, 2, 3)]


def test_the_report_compares_forecasts_and_lists_what_was_called() -> None:
    flown = draw_planned_landing(
        np.random.default_rng(5), SITE, prior=ApproachPrior(), wheels=WHEELS, start_before_aim_m=230.0
    )
    monitor = LandingMonitor(SITE, WHEELS)
    steps = list(reports_of(flown.trajectory, seed=5))
    for number, report in enumerate(steps):
        step = monitor.step(report)
        if number == 40:
            monitor.note([TrackEvent(t_s=4.0, level="warning", text="wave-off: lateral protection level")])
        if step.reports:
            break
    (report,) = step.reports
    assert [f.before_s for f in report.forecasts] == [10.0, 5.0, 2.0]
    assert [e.text for e in report.events] == ["wave-off: lateral protection level"]
    assert report.glide_path is not None
    assert report.glide_path.rms_m < 3.0
    assert report.worst["along"].sigma_m == pytest.approx(0.6, abs=0.02)
    # JSON as it is, without numbers that it does not have
    kept = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert kept["outcome"] == "landed"
    assert kept["touchdown"]["sink_m_s"] == report.touchdown.sink_m_s  # type: ignore[union-attr]
    text = report.text()
    for words in ("touchdown at", "sink at touchdown", "above the glide path", "foretold 10 s before", "wave-off"):
        assert words in text
    table = landing_table([report, replace(report, number=2, touchdown=None, outcome=ApproachOutcome.GO_AROUND)])
    rows = table.splitlines()
    assert len(rows) == 3
    assert len({len(row) for row in rows}) == 1
    assert "go-around" in rows[2]


def test_the_status_holds_what_is_known_and_says_what_is_not() -> None:
    flown = draw_planned_landing(
        np.random.default_rng(6), SITE, prior=ApproachPrior(), wheels=WHEELS, start_before_aim_m=400.0
    )
    found = _watch(LandingMonitor(SITE, WHEELS, forecast_every_s=1.0), flown.trajectory)
    first, middle = found.statuses[0], next(s for s in found.statuses if s.t_s >= flown.touchdown_s - 8.0)
    assert first.touchdown is NoTouchdown.TOO_EARLY
    assert first.approach == 1
    assert first.deviations is not None
    assert first.gnss is None
    assert isinstance(middle.touchdown, TouchdownForecast)
    assert found.statuses[-1].approach is None
    assert [e.level for e in found.events] == ["info"]
    assert found.events[0].text.startswith("approach 1: landed")


def test_without_an_estimate_there_are_no_deviations() -> None:
    monitor = LandingMonitor(SITE, WHEELS)
    step = monitor.step(StepReport(states=(TrackState(t_s=1.0, status=TrackStatus.SEARCHING, kinematics=None),)))
    assert step.status is not None
    assert (step.status.deviations, step.status.touchdown, step.status.approach) == (None, None, None)
    # a position whose status is not that of a track is not shown either
    lost = tracked(2.0, np.zeros(3), np.zeros(3), status=TrackStatus.ACQUIRING)
    step = monitor.step(StepReport(estimates=(lost,)))
    assert step.status is not None
    assert step.status.deviations is None
    # nor is one of a filter that has failed
    failed = tracked(3.0, np.array([np.nan, 0.0, 0.0]), np.zeros(3))
    step = monitor.step(StepReport(estimates=(failed,)))
    assert step.status is not None
    assert step.status.deviations is None


def test_a_gnss_position_that_jumps_is_in_the_log_and_in_the_report() -> None:
    flown = draw_planned_landing(
        np.random.default_rng(7), SITE, prior=ApproachPrior(), wheels=WHEELS, start_before_aim_m=300.0
    )
    monitor = LandingMonitor(SITE, WHEELS, gnss=GnssWatch(), forecast_every_s=100.0)
    events, reports, verdicts = [], [], set()
    for report in reports_of(flown.trajectory, seed=7):
        t_s = report.estimates[0].t_s
        step = monitor.step(report)
        true = flown.trajectory.position(np.array([t_s - 0.2]))[0]
        jumped = np.array([8.0, 0.0, 0.0]) if 6.0 <= t_s < 8.0 else 0.0
        told = monitor.take_own_position(
            OwnPosition(t_s=t_s, position_runway_m=true + jumped, sigma_m=np.full(3, 0.05))
        )
        events += [*step.events, *told.events]
        reports += [*step.reports, *told.reports]
        assert told.status is not None
        if told.status.gnss is not None:
            verdicts.add(told.status.gnss.verdict)
    warnings = [e for e in events if e.level == "warning"]
    assert warnings
    assert 6.0 <= warnings[0].t_s <= 7.0
    assert "GNSS position" in warnings[0].text
    assert {GnssVerdict.AGREES, GnssVerdict.JUMP} <= verdicts
    assert math.isfinite(reports[0].to_s)
    assert any("GNSS position" in e.text for e in reports[0].events)
