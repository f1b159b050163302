"""Advice of an approach: on time, never GO without a fresh estimate, and no chatter."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.arrays import FloatArray
from groundstation.errors import ConfigError, InputError
from groundstation.integrity.approach_advice import AdviceConfig, AdviceLevel, AdviceRules, Situation
from groundstation.integrity.approach_integrity import ApproachIntegrity
from groundstation.integrity.fault_geometry import StationLook
from groundstation.integrity.protection_levels import ProtectionLevels
from groundstation.landing_site.alert_limits import AlertLimits
from groundstation.messages import (
    DetectionStatus,
    InitialState,
    Miss,
    MissReason,
    StepReport,
    TrackEvent,
    TrackState,
    TrackStatus,
)
from groundstation.simulation import StationErrors
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.standard_cases import STEP_RAD, standard_rig
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.faulty_flight import broken, scenario
from tests.integrity.approach_reports import SITE, Looks, camera_of, kinematics_at, report_of

RIG = standard_rig(third=True, resolution_rad=0.0, sigma_rad=STEP_RAD / 12**0.5)
LIMITS = AlertLimits()


def levels(vertical_m: float = 0.4, along_m: float = 5.0) -> ProtectionLevels:
    return ProtectionLevels(
        t_s=0.0,
        along_m=along_m,
        lateral_m=0.8,
        vertical_m=vertical_m,
        worst=("mount", "mount", "mount"),
        separation=0.0,
        suspected="mount",
        pairs=5,
    )


def situation(now_s: float, height_m: float, found: ProtectionLevels | None = None, **change: object) -> Situation:
    """Return a good situation at a time, or one with a change."""
    good = Situation(
        now_s=now_s,
        estimate_s=now_s,
        pair_s=now_s,
        status=TrackStatus.TRACKING,
        levels=levels() if found is None else found,
        height_m=height_m,
        sink_m_s=0.0,
        fault_s=-math.inf,
        fault="",
    )
    return replace(good, **change)  # type: ignore[arg-type]


def flown(rules: AdviceRules, situations: list[Situation]) -> list[AdviceLevel]:
    return [rules.advise(s).level for s in situations]


def good_from(start_s: float, seconds: float = 1.1, height_m: float = 20.0) -> list[Situation]:
    return [situation(float(t), height_m) for t in start_s + np.arange(0.0, seconds + 1e-9, 0.1)]


def test_go_comes_after_a_second_of_good_estimates_and_goes_at_once() -> None:
    rules = AdviceRules(LIMITS, AdviceConfig())
    found = flown(rules, good_from(0.0))
    assert found == [AdviceLevel.WAVE_OFF] * 10 + [AdviceLevel.GO] * 2
    assert flown(rules, [situation(1.2, 20.0, levels(vertical_m=1.51))]) == [AdviceLevel.CAUTION]
    # within the limit, but not within nine tenths of it
    assert set(flown(rules, [situation(1.3 + 0.1 * k, 20.0, levels(vertical_m=1.4)) for k in range(20)])) == {
        AdviceLevel.CAUTION
    }
    # back and forth every half second never becomes GO
    waves = [situation(4.0 + 0.1 * k, 20.0, levels(vertical_m=1.2 if k % 10 < 5 else 1.4)) for k in range(40)]
    assert set(flown(rules, waves)) == {AdviceLevel.CAUTION}
    assert flown(rules, good_from(9.0))[-1] is AdviceLevel.GO


@pytest.mark.parametrize(
    ("height_m", "vertical_m", "wanted"),
    [
        (20.0, 1.4, AdviceLevel.GO),
        (20.0, 1.6, AdviceLevel.CAUTION),
        # 6 m less the level of 0.7 m is above 5 m, 5.6 m less it is not
        (6.0, 0.7, AdviceLevel.GO),
        (5.6, 0.7, AdviceLevel.WAVE_OFF),
        (4.0, 0.59, AdviceLevel.GO),
        (4.0, 0.61, AdviceLevel.WAVE_OFF),
    ],
)
def test_limits_and_consequences_by_height(height_m: float, vertical_m: float, wanted: AdviceLevel) -> None:
    rules = AdviceRules(LIMITS, AdviceConfig())
    flown(rules, good_from(0.0))
    advice = rules.advise(situation(1.2, height_m, levels(vertical_m=vertical_m)))
    assert advice.level is wanted
    assert advice.limits is not None
    assert advice.limits.vertical_m == (1.5 if height_m - vertical_m > 5.0 else 0.6)
    if wanted is not AdviceLevel.GO:
        assert f"vertical protection level {vertical_m:.2f} m" in advice.reason


@pytest.mark.parametrize(
    ("change", "high", "low", "words"),
    [
        ({"estimate_s": 0.69, "pair_s": 0.69}, AdviceLevel.WAVE_OFF, AdviceLevel.WAVE_OFF, "no estimate for 0.5 s"),
        ({"status": TrackStatus.LOST}, AdviceLevel.WAVE_OFF, AdviceLevel.WAVE_OFF, "the track is lost"),
        ({"fault_s": 0.0, "fault": "mount"}, AdviceLevel.WAVE_OFF, AdviceLevel.WAVE_OFF, "rays contradict"),
        ({"levels": None}, AdviceLevel.WAVE_OFF, AdviceLevel.WAVE_OFF, "no protection level"),
        ({"levels": levels(along_m=math.nan)}, AdviceLevel.CAUTION, AdviceLevel.WAVE_OFF, "along protection level"),
        ({"status": TrackStatus.COASTING}, AdviceLevel.CAUTION, AdviceLevel.WAVE_OFF, "fewer than two stations"),
        ({"pair_s": 0.6}, AdviceLevel.CAUTION, AdviceLevel.WAVE_OFF, "fewer than two stations"),
        ({"complaints": ("station left: late",)}, AdviceLevel.CAUTION, AdviceLevel.CAUTION, "station left: late"),
    ],
)
def test_each_finding(change: dict[str, object], high: AdviceLevel, low: AdviceLevel, words: str) -> None:
    for height_m, wanted in ((20.0, high), (4.0, low)):
        rules = AdviceRules(LIMITS, AdviceConfig())
        flown(rules, good_from(0.0))
        advice = rules.advise(situation(1.2, height_m, **change))
        assert advice.level is wanted
        assert words in advice.reason


def test_wave_off_below_the_decision_height_stays_until_the_aircraft_has_climbed() -> None:
    rules = AdviceRules(LIMITS, AdviceConfig())
    flown(rules, good_from(0.0))
    assert rules.advise(situation(1.2, 4.0, fault_s=1.2)).latched
    for start_s, height_m in ((5.0, 3.0), (20.0, 9.0)):
        assert set(flown(rules, good_from(start_s, 5.0, height_m))) == {AdviceLevel.WAVE_OFF}
    assert flown(rules, good_from(40.0, 1.1, 20.0))[-1] is AdviceLevel.GO


def test_a_level_just_within_its_limit_is_no_wave_off_where_something_else_is_a_caution() -> None:
    """At 0.58 m of 0.6 m at 4 m height a station falls silent; at 14 m of 15 m a caution descends to 4 m.

    Expected: CAUTION in both, since no level is beyond its limit; WAVE-OFF as soon as one is.
    """
    rules = AdviceRules(LIMITS, AdviceConfig())
    flown(rules, good_from(0.0))
    silent = {"complaints": ("station third: no picture for 0.6 s",)}
    low = [situation(1.3 + 0.1 * k, 4.0, levels(vertical_m=0.58), **silent) for k in range(20)]
    assert set(flown(rules, low)) == {AdviceLevel.CAUTION}
    assert rules.advise(situation(3.4, 4.0, levels(vertical_m=0.61), **silent)).latched
    rules = AdviceRules(LIMITS, AdviceConfig())
    flown(rules, [situation(0.1 * k, 20.0, levels(along_m=16.0)) for k in range(30)])
    descent = [situation(3.0 + 0.1 * k, 20.0 - 0.2 * k, levels(along_m=14.0)) for k in range(80)]
    assert set(flown(rules, descent)) == {AdviceLevel.CAUTION}
    assert rules.advise(situation(11.1, 4.0, levels(along_m=15.1))).latched


def test_after_a_latched_wave_off_go_takes_a_second_of_good_estimates_again() -> None:
    """Half a second good at 6 m, then waved off below 5 m. Expected: what was good before the latch is of no use."""
    rules = AdviceRules(LIMITS, AdviceConfig())
    flown(rules, good_from(0.0, 0.5, 6.0))
    assert rules.advise(situation(0.6, 4.0)).latched
    climbs = [situation(1.0 + 0.1 * k, 9.0, fault_s=1.0 + 0.1 * k) for k in range(40)]
    assert set(flown(rules, climbs)) == {AdviceLevel.WAVE_OFF}
    assert flown(rules, good_from(20.0, 1.1, 20.0)) == [AdviceLevel.WAVE_OFF] * 10 + [AdviceLevel.GO] * 2


def test_an_aircraft_first_seen_below_the_decision_height_is_waved_off() -> None:
    rules = AdviceRules(LIMITS, AdviceConfig())
    assert set(flown(rules, good_from(0.0, 5.0, 4.0))) == {AdviceLevel.WAVE_OFF}


def test_above_the_decision_height_a_fault_counts_for_three_seconds() -> None:
    rules = AdviceRules(LIMITS, AdviceConfig())
    flown(rules, good_from(0.0))
    after = [situation(1.2 + 0.1 * k, 20.0, fault_s=1.2) for k in range(60)]
    found = flown(rules, after)
    assert found.index(AdviceLevel.GO) in range(40, 43)


# ------------------------------------------------------------------------------------- fed with reports
def approach(rng: np.random.Generator, from_s: float = 9.0, to_s: float = 10.51) -> ApproachIntegrity:
    """Return the integrity of an approach that has been good for a second and a half."""
    integrity, looks = ApproachIntegrity(RIG, SITE), Looks(RIG, rng)
    for t_s in np.arange(from_s, to_s, 0.1).tolist():
        integrity.take(report_of(t_s, looks.at(t_s)), t_s)
    assert integrity.advice is not None
    assert integrity.advice.level is AdviceLevel.GO
    return integrity


def test_silence_becomes_wave_off_within_the_time_to_alert(rng: np.random.Generator) -> None:
    integrity = approach(rng)
    assert integrity.pass_time(10.99) == ()
    (event,) = integrity.pass_time(11.01)
    assert event.level == "warning"
    assert event.text.startswith("approach: WAVE-OFF, no estimate for 0.5 s")
    advice = approach(rng).advice
    assert advice is not None
    assert advice.valid_until_s == pytest.approx(11.0)


def test_heartbeats_pass_the_time_and_tell_of_a_loss(rng: np.random.Generator) -> None:
    integrity = approach(rng)
    lost = TrackState(t_s=10.6, status=TrackStatus.LOST, kinematics=None)
    (event,) = integrity.take(StepReport(states=(lost,)), 10.6)
    assert "WAVE-OFF, the track is lost" in event.text
    integrity = approach(rng)
    coasting = TrackState(t_s=11.2, status=TrackStatus.COASTING, kinematics=kinematics_at(11.2))
    (event,) = integrity.take(StepReport(states=(coasting,)), 10.6)
    assert "no estimate for 0.7 s" in event.text


@pytest.mark.parametrize(
    "fault",
    [{"px": {"left": np.array([0.0, 6.0])}}, {"rad": {"left": np.radians([0.4, 0.0])}}],
    ids=["pixel", "mount"],
)
def test_a_fault_that_is_seen_is_called_within_half_a_second(
    fault: dict[str, dict[str, FloatArray]], rng: np.random.Generator
) -> None:
    integrity, looks = approach(rng), Looks(RIG, rng)
    called = []
    for t_s in np.arange(10.6, 11.11, 0.1).tolist():
        called += integrity.take(report_of(t_s, looks.at(t_s, **fault)), t_s)  # type: ignore[arg-type]
    assert called
    assert "WAVE-OFF, the rays contradict each other" in called[0].text
    assert called[0].t_s <= 11.05


def test_a_shorter_time_to_alert_has_a_shorter_window() -> None:
    """At 30 pairs a second, 0.2 s to alert. Expected: a pixel off by 4 px for good is called by then, or not at all."""
    site = replace(SITE, alert_limits=AlertLimits(time_to_alert_s=0.2))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        integrity, looks = ApproachIntegrity(RIG, site), Looks(RIG, rng)
        called, times = [], 9.0 + np.arange(90) / 30.0
        for t_s in times.tolist():
            wrong = {"left": np.array([0.0, 4.0])} if t_s >= 10.0 else None
            events = integrity.take(report_of(t_s, looks.at(t_s, px=wrong)), t_s)
            called += [t_s for event in events if "contradict" in event.text]
        assert all(t_s <= 10.2 + 1e-9 for t_s in called[:1])
        assert integrity.advice is not None
        assert integrity.advice.levels is not None
        assert integrity.advice.levels.pairs <= 7


def test_a_station_s_health_is_told_and_the_others_carry_on(rng: np.random.Generator) -> None:
    integrity, looks = approach(rng), Looks(RIG, rng)
    events: list[TrackEvent] = []
    for t_s in np.arange(10.6, 11.4, 0.1).tolist():
        seen = looks.at(t_s)
        report = report_of(t_s, seen[:2])
        epoch = report.estimates[0].epoch
        no_angle = replace(
            camera_of(seen[2], epoch, DetectionStatus.MISS, accepted=False),
            result=Miss(reason=MissReason.NO_PTU_ANGLE, detail=""),
        )
        events += integrity.take(replace(report, cameras=(*report.cameras, no_angle)), t_s)
    assert [e.text for e in events] == ["approach: CAUTION, station third: no ptu angle"]
    assert integrity.pass_time(12.0)[0].text.startswith("approach: WAVE-OFF")


def test_a_station_that_never_delivers_is_told(rng: np.random.Generator) -> None:
    """The third camera is dead from the start. Expected: CAUTION, where the two others hold the levels."""
    integrity, looks = ApproachIntegrity(RIG, SITE), Looks(RIG, rng)
    for t_s in np.arange(9.0, 11.51, 0.1).tolist():
        integrity.take(report_of(t_s, looks.at(t_s)[:2]), t_s)
    assert integrity.advice is not None
    assert (integrity.advice.level, integrity.advice.reason) == (AdviceLevel.CAUTION, "station third: no picture yet")


def test_a_clock_that_is_set_back_and_one_that_is_no_number(rng: np.random.Generator) -> None:
    integrity = approach(rng)
    (event,) = integrity.pass_time(2.0)
    assert "WAVE-OFF, no estimate yet" in event.text
    with pytest.raises(InputError, match="time: got nan"):
        integrity.pass_time(math.nan)


def test_an_estimate_that_is_no_number_or_of_no_pixel_is_none(rng: np.random.Generator) -> None:
    integrity, looks = approach(rng), Looks(RIG, rng)
    for t_s in (10.6, 10.8, 11.0):
        known = kinematics_at(t_s)
        broken_estimate = replace(known, covariance=np.full((6, 6), np.nan))
        integrity.take(report_of(t_s, looks.at(t_s), known=broken_estimate), t_s)
        integrity.take(report_of(t_s + 0.05, ()), t_s + 0.05)
    assert integrity.advice is not None
    assert integrity.advice.level is AdviceLevel.WAVE_OFF


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["pair", "pair", "pair", "one", "none", "time", "lost", "coasting", "ahead"]),
        st.sampled_from([0.0, 0.1, 0.1, 0.1, 0.2, 0.4, 0.6, 3.0, -0.2, -2.0]),
    ),
    min_size=1,
    max_size=40,
)


@cache
def looks_at(tenths: int) -> tuple[StationLook, ...]:
    """Return looks at a time in tenths of a second, the same for all examples."""
    return Looks(RIG, np.random.default_rng(tenths)).at(0.1 * tenths)


@given(steps=STEPS)
@settings(max_examples=30)
def test_go_needs_a_fresh_estimate_of_two_stations_whatever_happens(steps: list[tuple[str, float]]) -> None:
    """Random reports, gaps, and clocks set back: a GO has a pair of tracked pixels at most 0.5 s old."""
    integrity = ApproachIntegrity(RIG, SITE)
    for tenths in range(90, 106):
        integrity.take(report_of(0.1 * tenths, looks_at(tenths)), 0.1 * tenths)
    now_s, newest_s = 10.5, 10.5
    for what, dt_s in steps:
        back = dt_s < -0.5
        now_s = max(now_s + dt_s, 0.0)
        newest_s = -math.inf if back else newest_s
        at_s = 0.1 * round(10.0 * min(now_s, 13.0))
        match what:
            case "time":
                integrity.pass_time(now_s)
            case "ahead":
                integrity.take(report_of(at_s + 2.0, ()), now_s)
            case "pair" | "one" | "none":
                seen = looks_at(round(10.0 * at_s))[: {"pair": 3, "one": 1, "none": 0}[what]]
                integrity.take(report_of(at_s, seen), now_s)
                newest_s = max(newest_s, at_s) if what == "pair" else newest_s
            case _:
                integrity.take(report_of(at_s, (), status=TrackStatus(what)), now_s)
        advice = integrity.advice
        assert advice is not None
        if advice.level is AdviceLevel.GO:
            assert now_s - newest_s <= 0.5 + 1e-9
            assert what not in ("lost", "coasting")
            assert advice.levels is not None
            assert advice.limits is not None
            assert advice.levels.vertical_m <= advice.limits.vertical_m
            assert advice.valid_until_s >= now_s - 1e-9


def test_an_approach_through_the_pipeline(rng: np.random.Generator) -> None:
    """Three stations: GO to the end; two, and a tilt of 0.1° at y = 250 m: WAVE-OFF within half a second."""
    path = GlideApproach(start_y_m=310.0, end_y_m=130.0)
    good = through_pipeline(scenario(4, ("left", "right", "third"), path), {}, 99.0)
    assert [e.text.split(",")[0] for e in good] == ["approach: WAVE-OFF", "approach: GO"]
    from_s = 60.0 / 25.0
    tilted = {"left": StationErrors(mount_rad=np.radians([0.1, 0.0, 0.0]))}
    found = through_pipeline(scenario(4, ("left", "right"), path), tilted, from_s)
    alarms = [e for e in found if e.t_s > from_s and "WAVE-OFF" in e.text]
    assert alarms[0].t_s <= from_s + 0.55


def through_pipeline(healthy: object, errors: dict[str, StationErrors], from_s: float) -> list[TrackEvent]:
    """Return the events of an approach; its stations have these errors from a time on."""
    flight = broken(healthy, errors, from_s)  # type: ignore[arg-type]
    truth, base = flight.truth, Config()
    start = InitialState(
        t_s=float(truth.t_s[0]),
        position_runway_m=truth.position_runway_m[0],
        velocity_runway_m_s=truth.velocity_runway_m_s[0],
        sigma_position_m=np.ones(3),
        sigma_velocity_m_s=np.ones(3),
    )
    tuned = replace(base.estimation, labelled_sigma_px=0.5, fix_window_s=0.005)
    pipeline = Pipeline(flight.rig, replace(base, estimation=tuned), span_m=2.3, initial=start)
    integrity, events = ApproachIntegrity(flight.rig, SITE), []
    for event in flight.events:
        events += integrity.take(pipeline.step(event), event.t_s)
    return events


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"margin: got 1\.5"):
        AdviceConfig(margin=1.5)
    with pytest.raises(ConfigError, match="recover_s: got nan"):
        AdviceConfig(recover_s=math.nan)
