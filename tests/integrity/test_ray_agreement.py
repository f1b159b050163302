"""Rays that do not meet are noticed and their fault is named; rays that meet, or are parallel, are not doubted."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.geometry.camera import Lens
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.ray_agreement import RayAgreementMonitor, RayFault
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    Miss,
    MissReason,
    PixelMeasurement,
    PtuSample,
    RecognisedPixel,
)
from tests.stereo_rig import aim, flight_events, glide, make_rig, make_station

Stored = Callable[[PtuSample], PtuSample]
NAMES = ("left", "right")


def fault_of(
    rng: np.random.Generator,
    reading: Stored = lambda sample: sample,
    *,
    names: tuple[str, ...] = NAMES,
    path: Callable[[float], np.ndarray] = glide,
) -> RayFault | None:
    """The fault of a flight whose readings are stored so."""
    rig = make_rig(names)
    geometries = {station.name: station.geometry() for station in rig.stations}
    monitor = RayAgreementMonitor(geometries, names)
    for event in flight_events(rig, path, rng):
        if isinstance(event, PtuSample):
            list(monitor.watched([reading(event)]))
        elif isinstance(event, PixelMeasurement):
            monitor.add_pixel(event.epoch, event.station, event.t_s, (event.u_px, event.v_px))
    return monitor.fault()


def changed(sample: PtuSample, **values: object) -> PtuSample:
    fields = {"t_s": sample.t_s, "station": sample.station, "pan_rad": sample.pan_rad, "tilt_rad": sample.tilt_rad}
    return PtuSample(**{**fields, **values})  # type: ignore[arg-type]


@pytest.mark.parametrize("names", [NAMES, (*NAMES, "third")])
def test_rays_that_meet_are_not_doubted(rng: np.random.Generator, names: tuple[str, ...]) -> None:
    assert fault_of(rng, names=names) is None


FAULTS: dict[str, tuple[Stored, str]] = {
    "exchanged stations": (
        lambda s: changed(s, station="right" if s.station == "left" else "left"),
        "angles of left and right exchanged",
    ),
    "exchanged angles": (lambda s: changed(s, pan_rad=s.tilt_rad, tilt_rad=s.pan_rad), "pan and tilt exchanged"),
    "pan reversed": (lambda s: changed(s, pan_rad=-s.pan_rad), "pan reversed"),
    "radians": (
        lambda s: changed(s, pan_rad=math.radians(s.pan_rad), tilt_rad=math.radians(s.tilt_rad)),
        "angles in radians",
    ),
    "one station's tilt": (
        lambda s: changed(s, tilt_rad=-s.tilt_rad) if s.station == "left" else s,
        "tilt reversed in sign for station left",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_readings_is_named(rng: np.random.Generator, fault: str) -> None:
    stored, words = FAULTS[fault]
    found = fault_of(rng, stored)
    assert found is not None
    assert words in found.line()
    assert found.meeting > 0.9 * found.rays
    assert found.meeting_as_stored < 0.65 * found.rays_as_stored


def fixed_station(name: str, x_m: float) -> StationGeometry:
    lens = Lens(
        image_size_px=(1280, 960),
        focal_px=np.array([900.0, 900.0]),
        principal_point_px=np.array([639.5, 479.5]),
        distortion=np.zeros(5),
    )
    return replace(make_station(name, x_m, fixed=True), lens=lens).geometry()


@pytest.mark.parametrize("exchanged", [False, True])
def test_exchanged_pixels_of_fixed_stations_are_named(rng: np.random.Generator, exchanged: bool) -> None:
    stations = {"left": fixed_station("left", -15.0), "right": fixed_station("right", 15.0)}
    monitor = RayAgreementMonitor(stations, ())
    for epoch, t_s in enumerate(np.arange(0.0, 10.0, 0.1)):
        for name, geometry in stations.items():
            seen = geometry.project(glide(t_s), 0.0, 0.0)
            assert seen is not None
            u, v = seen.pixel + rng.normal(0.0, 0.5, 2)
            stored = {"left": "right", "right": "left"}[name] if exchanged else name
            list(monitor.watched([PixelMeasurement(t_s=t_s, station=stored, epoch=epoch, u_px=u, v_px=v)]))
    found = monitor.fault()
    if not exchanged:
        assert found is None
    else:
        assert found is not None
        assert "the pixels of left and right exchanged (100 of 100)" in found.line()


def test_exchanged_lenses_are_named_and_what_the_pictures_refute_is_not(rng: np.random.Generator) -> None:
    """Expected: principal points 40 px apart are 0.34°; a focal length explains that only against the motion."""
    rig = make_rig()
    left, right = rig.stations
    shifted = replace(right.lens, principal_point_px=right.lens.principal_point_px - 40.0)
    true = {"left": left.geometry(), "right": replace(right, lens=shifted).geometry()}
    stored = {"left": true["left"].with_lens(shifted), "right": true["right"].with_lens(left.lens)}
    monitor = RayAgreementMonitor(stored, NAMES)
    for epoch, t_s in enumerate(np.arange(0.0, 12.0, 0.1)):
        for name, geometry in true.items():
            pan, tilt = aim(geometry, glide(t_s))
            seen = geometry.project(glide(t_s), pan, tilt)
            assert seen is not None
            u, v = seen.pixel + rng.normal(0.0, 0.5, 2)
            list(monitor.watched([PtuSample(t_s=t_s, station=name, pan_rad=pan, tilt_rad=tilt)]))
            monitor.add_pixel(epoch, name, t_s, (u, v))
    found = monitor.fault(lambda name, reading: reading.focal_factor != 1.0)
    assert found is not None
    assert "with the lenses of left and right exchanged" in found.line()
    assert monitor.fault(lambda name, reading: True) is not None


@pytest.mark.parametrize("factor", [0.1, 4.0])
def test_a_wrong_focal_length_is_named(rng: np.random.Generator, factor: float) -> None:
    """Expected: with a wobble of the heads, so that the target is not always in the middle."""
    rig = make_rig()
    monitor = RayAgreementMonitor(
        {s.name: replace(s, lens=replace(s.lens, focal_px=s.lens.focal_px * factor)).geometry() for s in rig.stations},
        NAMES,
    )
    geometries = {s.name: s.geometry() for s in rig.stations}
    for epoch, t_s in enumerate(np.arange(0.0, 12.0, 0.1)):
        for k, (name, geometry) in enumerate(geometries.items()):
            pan, tilt = aim(geometry, glide(t_s)) + np.radians(
                [2.0 * math.sin(2 * t_s + k), 2.0 * math.cos(3 * t_s + 2 * k)]
            )
            seen = geometry.project(glide(t_s), pan, tilt)
            assert seen is not None
            list(monitor.watched([PtuSample(t_s=t_s, station=name, pan_rad=pan, tilt_rad=tilt)]))
            monitor.add_pixel(epoch, name, t_s, (seen.pixel[0], seen.pixel[1]))
    found = monitor.fault()
    assert found is not None
    best = found.hypotheses[0].readings.values()
    assert {h.focal_factor for h in best} != {1.0}
    for hypothesis in best:
        assert hypothesis.focal_factor == pytest.approx(1.0 / factor, rel=0.1)


def test_readings_of_another_flight_are_a_fault_without_a_name(rng: np.random.Generator) -> None:
    """Expected: a mount that sways by some degrees is none of the usual faults."""

    def swaying(s: PtuSample) -> PtuSample:
        return changed(s, tilt_rad=s.tilt_rad + (0.05 * math.sin(2.0 * s.t_s) if s.station == "left" else 0.0))

    found = fault_of(rng, swaying)
    assert found is not None
    assert found.hypotheses == ()
    assert "rig, angles, clocks or pixels are wrong" in found.line()


@pytest.mark.parametrize("off_deg", [-2.0, 1.0])
def test_a_tilt_that_is_off_is_named_with_its_amount(rng: np.random.Generator, off_deg: float) -> None:
    """Expected: which of the two stations it is cannot be told, and both are named."""
    off_rad = math.radians(off_deg)
    found = fault_of(rng, lambda s: changed(s, tilt_rad=s.tilt_rad + (off_rad if s.station == "left" else 0.0)))
    assert found is not None
    ways = ("lower", "higher") if off_deg > 0 else ("higher", "lower")
    for station, way in zip(NAMES, ways, strict=True):
        assert f"a tilt {abs(off_deg):.1f}° {way} for station {station}" in found.line()


def test_a_pan_that_makes_rays_diverge_is_named_with_the_least_amount(rng: np.random.Generator) -> None:
    """Expected: 8° off, less the 1.4° and more by which rays from 10.8 m apart converge; by a station's pan or another.

    The same the other way brings the target nearer, and the rays still meet.
    """
    off_rad = math.radians(8.0)
    found = fault_of(rng, lambda s: changed(s, pan_rad=s.pan_rad + (off_rad if s.station == "left" else 0.0)))
    assert found is not None
    for way, station in (("lower", "left"), ("higher", "right")):
        assert f"a pan at least 7.0° {way} for station {station}" in found.line()
    assert fault_of(rng, lambda s: changed(s, pan_rad=s.pan_rad - (off_rad if s.station == "left" else 0.0))) is None


def test_places_exchanged_in_the_rig_are_named(rng: np.random.Generator) -> None:
    rig = make_rig()
    geometries = {station.name: station.geometry() for station in rig.stations}
    left, right = (next(s for s in rig.stations if s.name == name) for name in NAMES)
    geometries["left"] = replace(left, ptu_position_m=right.ptu_position_m).geometry()
    geometries["right"] = replace(right, ptu_position_m=left.ptu_position_m).geometry()
    monitor = RayAgreementMonitor(geometries, NAMES)
    for event in flight_events(rig, glide, rng):
        list(monitor.watched([event]))
    found = monitor.fault()
    assert found is not None
    assert "the places of left and right exchanged" in found.line()


def test_stations_exchanged_in_the_rig_are_named(rng: np.random.Generator) -> None:
    """Each with the place and the mount of the other, which differ by half a degree."""
    rig = make_rig()
    left, right = (next(s for s in rig.stations if s.name == name) for name in NAMES)
    half_rad = np.deg2rad(0.25)
    left = replace(left, runway_from_base_wxyz=np.array([math.cos(half_rad), math.sin(half_rad), 0.0, 0.0]))
    rig = replace(rig, stations=(left, right))
    monitor = RayAgreementMonitor({"left": right.geometry(), "right": left.geometry()}, NAMES)
    for event in flight_events(rig, glide, rng):
        list(monitor.watched([event]))
    found = monitor.fault()
    assert found is not None
    assert "stations left and right of the rig exchanged" in found.line()


def camera_report(event: PixelMeasurement, found: tuple[float, float] | None, odds: float | None) -> CameraReport:
    """A report whose target is ``found`` at log odds of −2, and whose likeliest aircraft is the event's pixel."""
    return CameraReport(
        t_s=event.t_s,
        station=event.station,
        epoch=event.epoch,
        status=DetectionStatus.MISS if found is None else DetectionStatus.OK,
        result=Miss(reason=MissReason.NOT_ACQUIRED) if found is None else detection(*found, log_odds=-2.0),
        roi=None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=0.0,
        tilt_rad=0.0,
        innovation=None,
        elapsed_s=0.0,
        recognised=None if odds is None else RecognisedPixel(u_px=event.u_px, v_px=event.v_px, log_odds=odds),
    )


def detection(u_px: float, v_px: float, *, log_odds: float) -> Detection:
    return Detection(
        u_px=u_px,
        v_px=v_px,
        covariance_px2=np.eye(2),
        noise_px2=np.eye(2),
        centroid_px=np.array([u_px, v_px]),
        box=Box(u_px, v_px, 1.0, 1.0),
        area_px=1.0,
        contour_px=np.zeros((0, 2), np.float32),
        contrast_to_noise=1.0,
        channel="learned",
        log_odds=log_odds,
    )


@pytest.mark.parametrize("tracked", [False, True])
def test_an_aircraft_that_is_recognised_tells_before_what_is_tracked(rng: np.random.Generator, tracked: bool) -> None:
    """Expected: with angles exchanged a tracker holds something else, whose rays meet, or nothing."""
    rig = make_rig()
    geometries = {station.name: station.geometry() for station in rig.stations}
    stored = FAULTS["exchanged stations"][0]
    monitor, angles = RayAgreementMonitor(geometries, NAMES), {}
    for event in flight_events(rig, glide, rng):
        if isinstance(event, PtuSample):
            sample = stored(event)
            angles[sample.station] = sample
            list(monitor.watched([sample]))
        elif isinstance(event, PixelMeasurement):
            reading = angles[event.station]
            seen = geometries[event.station].project(np.array([0.0, 300.0, 20.0]), reading.pan_rad, reading.tilt_rad)
            assert seen is not None
            wrong = (float(seen.pixel[0]), float(seen.pixel[1])) if tracked else None
            monitor.add_report(camera_report(event, wrong, 3.0))
    found = monitor.fault()
    assert found is not None
    assert "angles of left and right exchanged" in found.line()


def test_a_distant_target_is_no_evidence(rng: np.random.Generator) -> None:
    """Expected: rays from 30 km away are parallel within the tolerance, whatever is stored."""
    assert fault_of(rng, path=lambda t_s: np.array([0.0, 30_000.0 - 25.0 * t_s, 800.0])) is None


def test_few_pixels_are_no_evidence(rng: np.random.Generator) -> None:
    monitor = RayAgreementMonitor({s.name: s.geometry() for s in make_rig().stations}, NAMES)
    for epoch in range(20):
        for name in NAMES:
            list(
                monitor.watched(
                    [PtuSample(t_s=0.1 * epoch, station=name, pan_rad=0.3 if name == "left" else -0.3, tilt_rad=0.0)]
                )
            )
            monitor.add_pixel(epoch, name, 0.1 * epoch, (640.0, 480.0))
    assert monitor.fault() is None


def test_exchanged_videos_of_heads_that_follow_one_aircraft_come_before_the_lenses(rng: np.random.Generator) -> None:
    """Expected: with principal points 40 px apart; a focal length at the end of what is tried explains anything."""
    left, right = make_rig().stations
    shifted = replace(right.lens, principal_point_px=right.lens.principal_point_px - 40.0)
    stations = {"left": left.geometry(), "right": replace(right, lens=shifted).geometry()}
    monitor = RayAgreementMonitor(stations, NAMES)
    for epoch, t_s in enumerate(np.arange(0.0, 6.0, 0.1)):
        for name, other in (("left", "right"), ("right", "left")):
            pan, tilt = aim(stations[name], glide(t_s))
            list(monitor.watched([PtuSample(t_s=t_s, station=name, pan_rad=pan, tilt_rad=tilt)]))
            seen = stations[name].project(glide(t_s), pan, tilt)
            assert seen is not None
            u, v = seen.pixel + rng.normal(0.0, 0.5, 2)
            monitor.add_pixel(epoch, other, t_s, (u, v))
    found = monitor.fault()
    assert found is not None
    assert "they do with the videos or the pixels of left and right exchanged, or with the lenses of" in found.line()
    assert "a focal length" not in found.line()
