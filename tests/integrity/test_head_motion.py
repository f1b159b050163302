"""Readings that contradict the motion of the pictures are named; those that are right, or not to be judged, are not."""

import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundstation.geometry.camera import Lens
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.angle_series import AngleSeries
from groundstation.integrity.head_motion import HeadMotionMonitor
from groundstation.integrity.head_motion_fault import fault_lines
from groundstation.integrity.reading_hypothesis import GRADIAN_DEG
from groundstation.messages import Frame, PtuSample
from groundstation.picture import BgrPicture
from tests.stereo_rig import make_station

FOCAL_PX = 3000.0
SIZE = (320, 240)
NAMES = ("left", "right")
DURATION_S = 8.0
# (station, time, pan, tilt) to what is stored
Stored = Callable[[str, float, float, float], tuple[str, float, float, float]]


def angles_at(name: str, t_s: float) -> tuple[float, float]:
    """Pan and tilt in rad; the two heads turn alike in tilt and unlike in pan, as in an approach, with a wobble."""
    side = 1.0 if name == "left" else -1.0
    pan = side * (0.4 + 0.15 * t_s) + 0.25 * math.sin(1.7 * t_s + side)
    tilt = 3.0 + 0.2 * t_s + 0.15 * math.sin(2.3 * t_s) - side * 0.1 * math.cos(1.1 * t_s)
    return math.radians(pan), math.radians(tilt)


def geometry(focal_px: float = FOCAL_PX) -> StationGeometry:
    lens = Lens(
        image_size_px=SIZE,
        focal_px=np.array([focal_px, focal_px]),
        principal_point_px=np.array([159.5, 119.5]),
        distortion=np.zeros(5),
    )
    return replace(make_station("left", 0.0), lens=lens).geometry()


def panorama(rng: np.random.Generator) -> NDArray[np.uint8]:
    """A textured scene around the directions that the heads see, at the scale of the lens."""
    noise = rng.normal(size=(950, 1150)).astype(np.float32)
    scene = cv2.GaussianBlur(noise, (0, 0), 4.0)
    return np.clip(128 + 50 * scene / scene.std(), 0, 255).astype(np.uint8)


def picture(scene: NDArray[np.uint8], pan_rad: float, tilt_rad: float) -> BgrPicture:
    """The scene as an ideal camera sees it: it moves right when the head turns left, and down when it turns up."""
    move = np.array([[1.0, 0.0, FOCAL_PX * pan_rad - 250.0], [0.0, 1.0, FOCAL_PX * (tilt_rad - 0.1) - 150.0]])
    grey = cv2.warpAffine(scene, move, SIZE, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return BgrPicture(np.repeat(grey[:, :, None], 3, axis=2))


def noisy(seen: BgrPicture, rng: np.random.Generator, sigma: float) -> BgrPicture:
    """A picture as a sensor takes it again: with noise of so many grey levels."""
    pixels = seen.whole()
    return BgrPicture(np.clip(pixels + rng.normal(0.0, sigma, pixels.shape), 0, 255).astype(np.uint8))


def watched(
    rng: np.random.Generator,
    stored: Stored = lambda name, t_s, pan, tilt: (name, t_s, pan, tilt),
    *,
    focal_px: float = FOCAL_PX,
    scene: NDArray[np.uint8] | None = None,
    resting: bool = False,
    angles: Callable[[str, float], tuple[float, float]] = angles_at,
    duration_s: float = DURATION_S,
) -> HeadMotionMonitor:
    """A monitor that has watched both stations for some seconds, with readings ``stored`` so."""
    scene = panorama(rng) if scene is None else scene
    monitor = HeadMotionMonitor({n: geometry(focal_px) for n in NAMES}, dict.fromkeys(NAMES, math.radians(0.01)))
    sigma_rad = math.radians(0.01)
    for t_s in np.arange(-3.0, duration_s + 3.0, 0.02):
        for name in NAMES:
            pan, tilt = angles(name, t_s) + rng.normal(0.0, sigma_rad, 2)
            of, at_s, pan, tilt = stored(name, t_s, pan, tilt)
            monitor.add_reading(PtuSample(t_s=at_s, station=of, pan_rad=pan, tilt_rad=tilt))
    for epoch, t_s in enumerate(np.arange(0.0, duration_s, 0.2)):
        for name in NAMES:
            seen = picture(scene, *angles(name, 0.0 if resting else t_s))
            seen = noisy(seen, rng, 1.0) if resting else seen
            monitor.add_frame(Frame(t_s=t_s, station=name, epoch=epoch, image=seen))
    return monitor


def test_right_readings_are_not_doubted(rng: np.random.Generator) -> None:
    assert watched(rng).faults() == ()


def exchanged_stations(name: str, t_s: float, pan: float, tilt: float) -> tuple[str, float, float, float]:
    return ("right" if name == "left" else "left", t_s, pan, tilt)


FAULTS: dict[str, tuple[Stored, dict[str, object]]] = {
    "exchanged angles": (lambda n, t, p, q: (n, t, q, p), {"exchanged": True}),
    "pan reversed": (lambda n, t, p, q: (n, t, -p, q), {"pan_sign": -1}),
    "tilt reversed": (lambda n, t, p, q: (n, t, p, -q), {"tilt_sign": -1}),
    "radians": (lambda n, t, p, q: (n, t, math.radians(p), math.radians(q)), {"unit": math.degrees(1.0)}),
    "degrees twice": (lambda n, t, p, q: (n, t, math.degrees(p), math.degrees(q)), {"unit": math.radians(1.0)}),
    "late": (lambda n, t, p, q: (n, t + 1.0, p, q), {"lag_s": -1.0}),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_readings_is_named(rng: np.random.Generator, fault: str) -> None:
    stored, expected = FAULTS[fault]
    found = watched(rng, stored).faults()
    assert [f.station for f in found] == list(NAMES)
    for one in found:
        assert one.hypothesis is not None
        for key, value in expected.items():
            got = getattr(one.hypothesis, key)
            assert got == pytest.approx(value, rel=0.02, abs=0.06), one
        assert one.agreeing > 0.8 * one.pairs
        assert one.agreeing_as_stored < 0.3 * one.pairs


@pytest.mark.parametrize(("tilt_from", "sign"), [("zenith", -1.0), ("nadir", 1.0)])
def test_a_tilt_that_is_not_counted_from_the_horizon_is_named(
    rng: np.random.Generator, tilt_from: str, sign: float
) -> None:
    found = watched(rng, lambda n, t, p, q: (n, t, p, math.pi / 2.0 + sign * q)).faults()
    assert [f.station for f in found] == list(NAMES)
    for one in found:
        assert one.hypothesis is not None
        assert one.hypothesis.words().startswith(f"tilt counted from the {tilt_from}, where")
        assert one.agreeing > 0.9 * one.pairs


def test_exchanged_stations_are_named(rng: np.random.Generator) -> None:
    found = watched(rng, exchanged_stations).faults()
    assert [(f.station, f.hypothesis and f.hypothesis.source) for f in found] == [("left", "right"), ("right", "left")]


def test_only_the_station_at_fault_is_named(rng: np.random.Generator) -> None:
    found = watched(rng, lambda n, t, p, q: (n, t, q, p) if n == "right" else (n, t, p, q)).faults()
    assert [f.station for f in found] == ["right"]


@pytest.mark.parametrize("factor", [0.1, 0.4, 2.0, 10.0])
def test_a_wrong_focal_length_is_named_with_its_factor(rng: np.random.Generator, factor: float) -> None:
    for fault in watched(rng, focal_px=factor * FOCAL_PX).faults() or pytest.fail("no fault"):
        assert fault.hypothesis is not None
        assert fault.hypothesis.focal_factor == pytest.approx(1.0 / factor, rel=0.05)


def test_a_fault_of_no_known_kind_is_reported_without_a_name(rng: np.random.Generator) -> None:
    """Expected: readings of a random walk contradict pictures that move enough, and nothing explains them."""
    walk: dict[str, NDArray[np.float64]] = {n: np.zeros(2) for n in NAMES}

    def stored(name: str, t_s: float, pan: float, tilt: float) -> tuple[str, float, float, float]:
        walk[name] = walk[name] + rng.normal(0.0, 8e-4, 2)
        return (name, t_s, *walk[name])

    found = watched(rng, stored).faults()
    assert "left" in [f.station for f in found]
    assert all(f.hypothesis is None for f in found)


@pytest.mark.parametrize("stored", [FAULTS["exchanged angles"][0], exchanged_stations])
def test_an_even_sky_is_no_evidence(rng: np.random.Generator, stored: Stored) -> None:
    sky = np.full((950, 1150), 190, np.uint8)
    assert watched(rng, stored, scene=sky).faults() == ()


def test_a_scene_that_does_not_move_is_no_evidence(rng: np.random.Generator) -> None:
    """Expected: a target that fills the picture is followed by the head, and rests in it."""
    assert watched(rng, resting=True).faults() == ()


def still(rng: np.random.Generator, noise: float) -> HeadMotionMonitor:
    """A head that turns, of which one picture is there over and over, with noise of so many grey levels."""
    scene, monitor = panorama(rng), HeadMotionMonitor({"left": geometry()}, {"left": math.radians(0.01)})
    for t_s in np.arange(0.0, DURATION_S, 0.02):
        pan, tilt = angles_at("left", t_s)
        monitor.add_reading(PtuSample(t_s=t_s, station="left", pan_rad=pan, tilt_rad=tilt))
    one = picture(scene, *angles_at("left", 0.0))
    for epoch, t_s in enumerate(np.arange(0.0, DURATION_S, 0.2)):
        monitor.add_frame(Frame(t_s=t_s, station="left", epoch=epoch, image=noisy(one, rng, noise)))
    return monitor


def test_a_frozen_video_is_named(rng: np.random.Generator) -> None:
    """Expected: the same picture again and again, not one that a camera took again of what rests in it."""
    (line,) = fault_lines(still(rng, 0.0).faults())
    assert "of its pictures are one and the same while its head turns by its angles" in line
    assert still(rng, 2.0).faults() == ()


@pytest.mark.parametrize("pan_rate_deg_s", [0.0, 0.5])
def test_drifting_clouds_are_no_evidence(rng: np.random.Generator, pan_rate_deg_s: float) -> None:
    """Expected: over a head that rests or turns steadily they move by the same in each pair, whatever its lens."""
    scene, monitor = panorama(rng), HeadMotionMonitor({"left": geometry()}, {"left": math.radians(0.01)})
    for t_s in np.arange(0.0, DURATION_S, 0.02):
        pan, tilt = np.radians([pan_rate_deg_s * t_s, 3.0]) + rng.normal(0.0, math.radians(0.01), 2)
        monitor.add_reading(PtuSample(t_s=t_s, station="left", pan_rad=pan, tilt_rad=tilt))
    for epoch, t_s in enumerate(np.arange(0.0, DURATION_S, 0.2)):
        seen = picture(scene, math.radians(pan_rate_deg_s * t_s) + 0.01 * t_s, math.radians(3.0))
        monitor.add_frame(Frame(t_s=t_s, station="left", epoch=epoch, image=seen))
    assert monitor.pair_count("left") > 30
    assert monitor.faults() == ()


def test_a_mast_that_shakes_is_no_evidence(rng: np.random.Generator) -> None:
    scene, monitor = panorama(rng), HeadMotionMonitor({"left": geometry()}, {"left": math.radians(0.01)})
    for t_s in np.arange(0.0, DURATION_S, 0.02):
        pan, tilt = np.radians([0.0, 3.0]) + rng.normal(0.0, math.radians(0.01), 2)
        monitor.add_reading(PtuSample(t_s=t_s, station="left", pan_rad=pan, tilt_rad=tilt))
    for epoch, t_s in enumerate(np.arange(0.0, DURATION_S, 0.2)):
        shake = rng.normal(0.0, 4.0 / FOCAL_PX, 2)
        seen = picture(scene, shake[0], math.radians(3.0) + shake[1])
        monitor.add_frame(Frame(t_s=t_s, station="left", epoch=epoch, image=seen))
    assert monitor.pair_count("left") > 30
    assert monitor.faults() == ()


def test_memory_is_bounded(rng: np.random.Generator) -> None:
    """Expected: of a long session fewer frames are looked at, over all of it."""
    monitor = HeadMotionMonitor({"left": geometry()}, {"left": math.radians(0.01)})
    scene = panorama(rng)
    seen = [picture(scene, *angles_at("left", t)) for t in np.arange(0.0, 4.0, 0.1)]
    for k in range(3000):
        frame = Frame(t_s=0.1 * k, station="left", epoch=k, image=seen[min(k % 80, 79 - k % 80)])
        monitor.add_frame(frame)
    pairs = monitor._pairs["left"]
    assert 40 <= monitor.pair_count("left") < 160
    assert pairs[0].first_s < 30.0
    assert pairs[-1].first_s > 250.0


def test_readings_are_interpolated_inside_of_their_time_only() -> None:
    series = AngleSeries()
    for t_s in (0.0, 0.1, 0.2, 2.0):
        series.add(t_s, 1.0 + t_s, -t_s)
    series.add(1.0, 9.0, 9.0)
    found = series.at(np.array([-0.1, 0.05, 0.2, 1.0, 2.0, 2.1]))
    assert np.allclose(found[[1, 2]], [[1.05, -0.05], [1.2, -0.2]])
    assert np.isnan(found[[0, 3, 5]]).all()


def swinging(name: str, t_s: float) -> tuple[float, float]:
    """Pan and tilt in rad of a head that swings by a degree: it tells a factor from a scene that drifts."""
    phase = 0.0 if name == "left" else 1.0
    return math.radians(1.0 * math.sin(1.1 * t_s + phase)), math.radians(4.0 + 0.7 * math.sin(0.8 * t_s - phase))


def test_all_motions_off_by_a_factor_within_each_pairs_tolerance(rng: np.random.Generator) -> None:
    """Expected: a focal length 15 % too long, and gradians, are reported with the factor and its sigma."""

    def in_gradians(name: str, t_s: float, pan: float, tilt: float) -> tuple[str, float, float, float]:
        return (name, t_s, pan / GRADIAN_DEG, tilt / GRADIAN_DEG)

    for monitor, ratio in (
        (watched(rng, focal_px=1.15 * FOCAL_PX, angles=swinging, duration_s=24.0), 1.0 / 1.15),
        (watched(rng, in_gradians, angles=swinging, duration_s=24.0), GRADIAN_DEG),
    ):
        faults = monitor.faults()
        assert [f.station for f in faults] == list(NAMES)
        for each in faults:
            assert each.scale is not None
            assert abs(each.scale.ratio - ratio) <= max(4.0 * each.scale.sigma, 0.01)
            assert "times as far as its head's angles and its focal length say" in each.line()
            assert ("gradians" in each.line()) == (ratio == GRADIAN_DEG)


def test_two_per_cent_are_no_fault(rng: np.random.Generator) -> None:
    assert watched(rng, focal_px=1.02 * FOCAL_PX, angles=swinging, duration_s=24.0).faults() == ()
