"""A whole simulated flight: exact without noise, wrong by what calibration and clocks make it, the same each time."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.errors import ScenarioError
from groundstation.messages import Epoch, PixelMeasurement, PtuSample
from groundstation.rig.rig import ClockModel
from groundstation.simulation import (
    Scenario,
    SimulatedFlight,
    StationErrors,
    case_b,
    case_c,
    perturbed,
    simulate,
    standard_rig,
)
from groundstation.simulation.approach import GlideApproach, bound_glide, weaving_approach
from groundstation.simulation.detection_camera import CameraModel
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.pointing import FixedPointing, LoopLimits, SecondOrderLoop
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.rig_errors import drawn_errors
from groundstation.simulation.standard_cases import STEP_RAD
from tests.simulation.observed import triangulated

STRAIGHT = bound_glide()
HUNDREDTH_RAD = np.radians(0.01)
AT_200_M = 160


def exact(**changes: object) -> Scenario:
    """Case B's straight glide without any noise."""
    return replace(case_b(trajectory=STRAIGHT).without_noise(), **changes)


def error_of(flight: SimulatedFlight) -> np.ndarray:
    return triangulated(flight)[1] - flight.truth.position_runway_m


@pytest.mark.parametrize("pointing", [None, SecondOrderLoop(limits=LoopLimits(command_delay_s=0.05))])
def test_without_noise_a_flight_triangulates_to_the_truth(pointing: SecondOrderLoop | None) -> None:
    """Pixels away from the image's middle too, where the head lags."""
    flight = simulate(case_b(trajectory=weaving_approach(), pointing=pointing).without_noise())
    assert np.abs(error_of(flight)).max() < 1e-6
    off_axis_px = float(np.abs(flight.truth.stations["left"].pixel_px - [639.5, 479.5]).max())
    assert off_axis_px < 1e-6 if pointing is None else off_axis_px > 20


def test_truth_is_exact() -> None:
    flight = simulate(case_c(seed=3))
    truth = flight.truth
    assert truth.t_s == pytest.approx(np.arange(len(truth.t_s)) / 10)
    assert truth.position_runway_m == pytest.approx(weaving_approach().position(truth.t_s))
    assert truth.velocity_runway_m_s == pytest.approx(weaving_approach().velocity(truth.t_s))
    for name, seen in truth.stations.items():
        for k in range(0, len(truth.t_s), 20):
            pan, tilt = seen.angles_rad[k]
            projection = flight.rig[name].geometry().project(truth.position_runway_m[k], pan, tilt)
            assert projection is not None
            assert projection.pixel == pytest.approx(seen.pixel_px[k], abs=1e-9)


def test_the_same_seed_gives_the_same_flight() -> None:
    scenario = replace(case_b(seed=11), dgps=DgpsModel())
    first, again = simulate(scenario), simulate(replace(case_b(seed=11), dgps=DgpsModel()))
    assert first.events == again.events
    assert np.array_equal(first.arrival_s, again.arrival_s)
    assert all(
        np.array_equal(a.position_runway_m, b.position_runway_m) for a, b in zip(first.dgps, again.dgps, strict=True)
    )
    assert simulate(case_b(seed=12)).events != first.events


def test_a_change_of_one_device_leaves_the_others_as_they_were() -> None:
    quiet = case_b(seed=4)
    cameras = {**quiet.cameras, "left": CameraModel(miss_probability=0.5)}
    before, after = simulate(quiet), simulate(replace(quiet, cameras=cameras, dgps=DgpsModel()))
    for kind, station in ((PixelMeasurement, "right"), (PtuSample, "left"), (PtuSample, "right")):
        mine = [[e for e in f.events if isinstance(e, kind) and e.station == station] for f in (before, after)]
        assert mine[0] == mine[1]


# ------------------------------------------------------------------------------------- calibration
@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [
        # relative pan: y² / b · 0.01°; common pan and common tilt: y · 0.01°
        ([0.0, 0.0, 0.5], [0.0, 0.0, -0.5], [0.0, 0.648, None]),
        ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [-0.0349, 0.0, 0.0]),
        ([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0349]),
        ([0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ],
)
def test_a_wrong_mount_makes_the_error_that_theory_predicts(
    left: list[float], right: list[float], expected: list[float | None]
) -> None:
    """At y = 200 m, in m; the mounts differ from the truth by these multiples of 0.01° (tilt, roll, pan)."""
    errors = {
        name: StationErrors(mount_rad=HUNDREDTH_RAD * np.array(mount))
        for name, mount in (("left", left), ("right", right))
    }
    scenario = exact()
    flight = simulate(replace(scenario, rig=perturbed(scenario.rig, errors)))
    assert flight.truth.position_runway_m[AT_200_M, 1] == pytest.approx(200.0)
    for error, wanted in zip(error_of(flight)[AT_200_M], expected, strict=True):
        if wanted is not None:
            assert error == pytest.approx(wanted, rel=0.02, abs=3e-3)


def test_an_error_of_the_truth_is_the_opposite_of_one_of_the_belief() -> None:
    errors = {"left": StationErrors(mount_rad=np.array([0.0, 0.0, HUNDREDTH_RAD]), position_m=np.array([0.01, 0, 0]))}
    scenario = exact()
    stated = error_of(simulate(replace(scenario, rig=perturbed(scenario.rig, errors))))
    true = error_of(simulate(replace(scenario, true_rig=perturbed(scenario.true_rig, errors))))
    assert stated[AT_200_M, 1] == pytest.approx(-true[AT_200_M, 1], rel=0.01)


def test_every_part_of_a_station_can_be_wrong() -> None:
    """A perturbed rig is undone by nothing but the same numbers the other way; each one alone is seen."""
    rig = standard_rig()
    by = {
        "mount_rad": np.array([1e-3, 2e-3, 3e-3]),
        "boresight_rad": np.array([1e-3, -2e-3, 3e-3]),
        "position_m": np.array([0.1, 0.2, 0.3]),
        "camera_in_head_m": np.array([0.01, 0.02, 0.03]),
        "focal_share": 0.01,
    }
    point = np.array([3.0, 150.0, 8.0])

    def pixel(errors: StationErrors) -> np.ndarray:
        projection = perturbed(rig, {"left": errors})["left"].geometry().project(point, -0.05, 0.04)
        assert projection is not None
        return projection.pixel

    straight = pixel(StationErrors())
    for name, value in by.items():
        assert np.abs(pixel(StationErrors(**{name: value})) - straight).max() > 0.1, name
    # the picture moves against the mount's pan: u by f · angle
    turned = pixel(StationErrors(mount_rad=np.array([0.0, 0.0, 1e-4])))
    assert turned[0] - straight[0] == pytest.approx(0.6667, rel=0.02)
    raised = pixel(StationErrors(boresight_rad=np.array([1e-4, 0.0, 0.0])))
    assert raised[1] - straight[1] == pytest.approx(0.6667, rel=0.02)
    with pytest.raises(ScenarioError, match="got station 'third'; wanted one of left, right"):
        perturbed(rig, {"third": StationErrors()})


def test_drawn_errors_have_their_sigmas() -> None:
    sigma = StationErrors(mount_rad=np.array([1e-4, 0.0, 3e-4]), ptu_offset_s=0.02)
    draws = [drawn_errors(np.random.default_rng(seed), ["left"], sigma)["left"] for seed in range(400)]
    low, high = chi2.ppf([0.001, 0.999], 400) / 400
    assert low < np.mean([(d.mount_rad[2] / 3e-4) ** 2 for d in draws]) < high
    assert low < np.mean([(d.ptu_offset_s / 0.02) ** 2 for d in draws]) < high
    assert all(d.mount_rad[1] == 0.0 and d.focal_share == 0.0 for d in draws)


# ------------------------------------------------------------------------------------------ clocks
def test_cameras_ten_milliseconds_off_are_a_quarter_of_a_metre_off() -> None:
    """At 25 m/s, if both cameras and both PTUs share the wrong clock: the whole track is late."""
    clock = StationErrors(camera_offset_s=0.010, ptu_offset_s=0.010)
    scenario = exact()
    flight = simulate(replace(scenario, rig=perturbed(scenario.rig, dict.fromkeys(scenario.rig.names, clock))))
    stamps, points = triangulated(flight)
    assert stamps == pytest.approx(flight.truth.t_s + 0.010)
    late = points - STRAIGHT.position(stamps)
    assert late[:, 1] == pytest.approx(0.25, abs=1e-6)


def test_a_ptu_clock_of_which_nobody_knows_turns_the_rays() -> None:
    """The true unit's stamps are 20 ms late: the angle at an exposure is off by 20 ms of its rate."""
    scenario = exact(ptus=dict.fromkeys(("left", "right"), PtuModel(rate_hz=100.0)))
    late = {n: StationErrors(ptu_offset_s=-0.020) for n in scenario.rig.names}
    flight = simulate(replace(scenario, true_rig=perturbed(scenario.true_rig, late)))
    k = 200  # y = 100 m
    readings = [e for e in flight.events if isinstance(e, PtuSample) and e.station == "left"]
    pans = np.interp(flight.truth.t_s[k], [e.t_s for e in readings], [e.pan_rad for e in readings])
    seen = flight.truth.stations["left"]
    assert pans - seen.angles_rad[k, 0] == pytest.approx(-0.020 * seen.rates_rad_s[k, 0], rel=0.02)


def test_a_known_clock_is_no_error() -> None:
    """Where the user's rig has the true clocks, drift too, the events are in true session time."""
    known = StationErrors(ptu_offset_s=0.3, ptu_drift_ppm=100.0, camera_offset_s=-0.2, camera_drift_ppm=-50.0)
    scenario = exact()
    rig = perturbed(scenario.rig, {"left": known})
    flight = simulate(replace(scenario, rig=rig, true_rig=perturbed(scenario.true_rig, {"left": known})))
    assert np.abs(error_of(flight)).max() < 1e-6


def test_the_cameras_need_not_expose_together() -> None:
    scenario = exact()
    cameras = {**scenario.cameras, "right": replace(scenario.cameras["right"], phase_s=0.04)}
    flight = simulate(replace(scenario, cameras=cameras))
    assert flight.truth.stations["right"].t_s - flight.truth.stations["left"].t_s == pytest.approx(0.04)
    epochs = [e.t_s for e in flight.events if isinstance(e, Epoch)]
    assert epochs == pytest.approx(flight.truth.t_s)
    assert flight.truth.t_s[0] == pytest.approx(0.02)


# ---------------------------------------------------------------------------------- order of arrival
def test_events_come_as_a_live_system_receives_them() -> None:
    """Serial delay and the detector's latency reorder stamps; an epoch comes after its last frame."""
    slow = PtuModel(rate_hz=50.0, delay_s=0.03, delay_jitter_s=0.02)
    cameras = {"left": CameraModel(latency_s=0.02), "right": CameraModel(latency_s=0.05, phase_s=0.004)}
    scenario = replace(case_b(seed=2), ptus={"left": slow, "right": PtuModel()}, cameras=cameras)
    flight = simulate(scenario)
    assert np.all(np.diff(flight.arrival_s) >= 0)
    through: dict[int, float] = {}
    for event, arrival in zip(flight.events, flight.arrival_s, strict=True):
        if isinstance(event, PtuSample):
            delay = arrival - event.t_s
            assert delay >= 0.03 - 1e-9 if event.station == "left" else delay == pytest.approx(0.0, abs=1e-9)
        elif isinstance(event, PixelMeasurement):
            assert arrival - event.t_s == pytest.approx(0.02 if event.station == "left" else 0.05)
            through[event.epoch] = arrival
        else:
            assert arrival >= through[event.epoch]
            assert event.stations == ("left", "right")
    assert any(b.t_s < a.t_s for a, b in pairwise(flight.events))


def test_a_pair_that_nobody_saw_is_still_an_epoch() -> None:
    cameras = dict.fromkeys(("left", "right"), CameraModel(miss_probability=1.0))
    flight = simulate(replace(case_b(), cameras=cameras))
    assert not any(isinstance(e, PixelMeasurement) for e in flight.events)
    assert sum(isinstance(e, Epoch) for e in flight.events) == len(flight.truth.t_s)
    assert not np.any(flight.truth.stations["left"].reported)


# --------------------------------------------------------------------------------- stations and cases
def fixed_scenario() -> Scenario:
    """Two stations that do not turn, mounted to look along the runway and a little up."""
    rig = standard_rig()
    rig = replace(rig, stations=tuple(replace(s, fixed=True) for s in rig.stations))
    up = {n: StationErrors(mount_rad=np.array([np.radians(2.0), 0, 0])) for n in rig.names}
    rig = perturbed(rig, up)
    return replace(exact(), rig=rig, true_rig=rig, ptus={}, trajectory=GlideApproach(start_y_m=400.0, end_y_m=20.0))


def test_fixed_stations_send_no_readings() -> None:
    flight = simulate(fixed_scenario())
    assert not any(isinstance(e, PtuSample) for e in flight.events)
    visible = flight.truth.stations["left"].visible & flight.truth.stations["right"].visible
    error = error_of(flight)
    assert 20 < visible.sum() < len(visible)
    assert np.abs(error[visible]).max() < 1e-6
    assert np.all(np.isnan(error[~visible]))
    assert np.all(flight.truth.stations["left"].angles_rad == 0.0)


def test_a_third_station() -> None:
    rig = standard_rig(third=True)
    scenario = exact(
        rig=rig,
        true_rig=replace(
            rig, stations=tuple(replace(s, ptu_resolution_rad=0.0, ptu_sigma_rad=0.0) for s in rig.stations)
        ),
        ptus=dict.fromkeys(rig.names, PtuModel(rate_hz=10.0)),
        cameras=dict.fromkeys(rig.names, exact().cameras["left"]),
    )
    assert np.abs(error_of(simulate(scenario))).max() < 1e-6


def test_the_cases_have_their_noise() -> None:
    """In B 0.00625° is the step, in C the rms."""
    assert case_b().rig["left"].angle_sigma_rad == pytest.approx(STEP_RAD / np.sqrt(12))
    assert case_b(white_encoder=True).rig["left"].angle_sigma_rad == pytest.approx(STEP_RAD / np.sqrt(12))
    assert case_c().rig["left"].angle_sigma_rad == pytest.approx(STEP_RAD)
    for scenario, angle, pixel in ((case_b(white_encoder=True), STEP_RAD / np.sqrt(12), 0.5), (case_c(), STEP_RAD, 1)):
        flight = simulate(scenario)
        seen = flight.truth.stations["left"]
        pixels = [e for e in flight.events if isinstance(e, PixelMeasurement) and e.station == "left"]
        readings = {round(e.t_s, 6): e for e in flight.events if isinstance(e, PtuSample) and e.station == "left"}
        off_px = np.array([[p.u_px, p.v_px] for p in pixels]) - seen.pixel_px
        at = [readings[round(t, 6)] for t in seen.t_s]
        off_rad = np.array([[r.pan_rad, r.tilt_rad] for r in at]) - seen.angles_rad
        low, high = chi2.ppf([0.001, 0.999], off_px.size) / off_px.size
        assert low < np.mean(off_px**2) / pixel**2 < high
        assert low < np.mean(off_rad**2) / angle**2 < high


def test_thirty_pairs_a_second() -> None:
    flight = simulate(case_b(rate_hz=30.0))
    assert len(flight.truth.t_s) == 649
    assert np.diff(flight.truth.t_s) == pytest.approx(1 / 30)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame_hz": -1.0}, "Scenario: frame_hz: got -1.0; wanted a finite number > 0"),
        ({"frame_hz": 1e6}, "Scenario: frame_hz: got 21600000 pairs"),
        ({"ptus": {}}, r"Scenario: ptus: got \[\]; wanted \['left', 'right'\]"),
        ({"cameras": {"left": CameraModel()}}, r"Scenario: cameras: got \['left'\]"),
        ({"rig": standard_rig(third=True)}, "Scenario: rig: got stations"),
        ({"seed": -1}, "Scenario: seed"),
        ({"lead_s": -0.1}, "Scenario: lead_s"),
    ],
)
def test_a_scenario_that_cannot_be_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        replace(case_b(), **change)


def test_a_parked_head_loses_the_target() -> None:
    """Outside the image there is no pixel, and the other station continues alone."""
    scenario = exact()
    ptus = {
        **scenario.ptus,
        "left": replace(scenario.ptus["left"], pointing=FixedPointing(pan_rad=-0.02, tilt_rad=0.05)),
    }
    flight = simulate(replace(scenario, ptus=ptus))
    seen = flight.truth.stations["left"]
    assert 0 < seen.reported.sum() < len(seen.reported)
    assert np.all(flight.truth.stations["right"].reported)


def test_true_clock_models_are_those_of_the_rig_file() -> None:
    """t_session = t_device + offset: a device with a positive offset is behind session time."""
    scenario = exact()
    true = replace(scenario.true_rig["left"], camera_clock=ClockModel(offset_s=0.5))
    rig = replace(scenario.true_rig, stations=(true, scenario.true_rig["right"]))
    flight = simulate(replace(scenario, true_rig=rig))
    first = next(e for e in flight.events if isinstance(e, PixelMeasurement) and e.station == "left")
    assert first.t_s == pytest.approx(-0.5)
