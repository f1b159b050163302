"""The renderer against the geometry that the filter uses, and against its own noise model."""

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.errors import ScenarioError
from groundstation.geometry.aim import aim_at
from groundstation.geometry.station import StationGeometry
from groundstation.picture import BayerPattern
from groundstation.simulation.airframes.trainer import trainer
from groundstation.simulation.optics import Optics
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.scenery import Scenery
from tests.simulation.small_site import AWAY, QUIET, ball, camera_at, grey, small_station

GEOMETRY = small_station().geometry()


def aimed(
    geometry: StationGeometry, at_m: tuple[float, float, float], off_px: tuple[float, float]
) -> tuple[float, float]:
    """Angles that put a point about so far from the principal point."""
    aim = aim_at(geometry, np.array(at_m))
    assert aim is not None
    focal = geometry.lens.focal_px
    return aim.pan_rad + off_px[0] / focal[0], aim.tilt_rad + off_px[1] / focal[1]


@pytest.mark.parametrize(
    ("place", "off", "rates", "velocity"),
    [
        ((0.0, 100.0, 20.0), (0.0, 0.0), (0.0, 0.0), (0.0, -20.0, 0.0)),
        ((3.0, 60.0, 14.0), (110.3, 70.7), (0.0, 0.0), (0.0, -20.0, 0.0)),
        ((-4.0, 250.0, 60.0), (-90.6, -61.2), (0.0, 0.0), (0.0, -20.0, 0.0)),
        ((0.0, 100.0, 20.0), (30.25, 10.5), (0.6, -0.3), (0.0, -20.0, 0.0)),
        ((0.0, 40.0, 15.0), (-12.3, 5.1), (0.0, 0.0), (6.0, -25.0, -4.0)),
    ],
)
def test_a_body_is_where_it_is_projected(
    place: tuple[float, float, float],
    off: tuple[float, float],
    rates: tuple[float, float],
    velocity: tuple[float, float, float],
) -> None:
    """Its centroid, at rest and in motion of head or aircraft, is the projected nose to 0.05 px.

    The body is turned towards the track; seen off its axis its outline stays symmetric about its middle.
    """
    pan, tilt = aimed(GEOMETRY, place, off)
    shape = ball(0.004 * place[1])
    camera = camera_at(place, airframe=shape, velocity_m_s=velocity)
    empty = camera_at(AWAY, airframe=shape)
    lack = grey(empty, 0.0, pan, tilt, *rates) - grey(camera, 0.0, pan, tilt, *rates)
    lack[np.abs(lack) < 1.5] = 0.0
    truth = camera.truth(0.0, pan, tilt, *rates)
    projection = GEOMETRY.project(np.array(place), pan, tilt)
    assert projection is not None
    assert truth.visible
    np.testing.assert_allclose(truth.pixel_px, projection.pixel, atol=1e-9)
    # weighed by cover: the sky behind is not quite even
    behind = grey(empty, 0.0, pan, tilt, *rates)
    cover = lack / np.maximum(behind - lack[lack > 0].min(initial=1.0), 1.0)
    v, u = np.mgrid[: lack.shape[0], : lack.shape[1]]
    assert cover.sum() > 20.0
    centroid = np.array([(u * cover).sum(), (v * cover).sum()]) / cover.sum()
    np.testing.assert_allclose(centroid, projection.pixel, atol=0.05)


def test_motion_within_the_exposure_blurs() -> None:
    """A head that turns by L px while exposing adds L²/12 to the second moment along its motion, none across."""
    place = (0.0, 100.0, 20.0)
    pan, tilt = aimed(GEOMETRY, place, (0.0, 0.0))
    camera, empty = camera_at(place, airframe=ball(0.4)), camera_at(AWAY)
    moments = []
    for rate in (0.0, 2.5):
        lack = grey(empty, 0.0, pan, tilt, rate) - grey(camera, 0.0, pan, tilt, rate)
        lack[np.abs(lack) < 1.5] = 0.0
        v, u = np.mgrid[: lack.shape[0], : lack.shape[1]]
        middle = [(lack * u).sum() / lack.sum(), (lack * v).sum() / lack.sum()]
        moments.append([((u - middle[0]) ** 2 * lack).sum(), ((v - middle[1]) ** 2 * lack).sum()] / lack.sum())
    length = 1600.0 * 2.5 * QUIET.exposure_s * math.cos(tilt)
    grown = moments[1] - moments[0]
    assert grown[0] == pytest.approx(length**2 / 12.0, rel=0.08)
    assert abs(grown[1]) < 0.4


def test_the_background_stays_in_the_world() -> None:
    """A picture after the head has turned is the one before, moved as far-away points move, to 0.1 px."""
    camera = camera_at(AWAY)
    one, two = (0.02, 0.01), (0.045, 0.027)
    first, second = grey(camera, 0.0, *one), grey(camera, 0.0, *two)
    h, w = first.shape
    into = np.zeros((h, w, 2), np.float32)
    for v in range(h):
        for u in range(w):
            direction = GEOMETRY.ray(u, v, *two).direction_runway
            far = GEOMETRY.project(1e7 * direction, *one)
            into[v, u] = (-1e4, -1e4) if far is None else far.pixel
    moved = cv2.remap(first.astype(np.float32), into[..., 0], into[..., 1], cv2.INTER_CUBIC, borderValue=-1.0)
    seen = (into[..., 0] > 2) & (into[..., 0] < w - 3) & (into[..., 1] > 2) & (into[..., 1] < h - 3)
    rows, columns = slice(40, h - 4), slice(50, w - 4)
    assert seen[rows, columns].all()
    a, b = moved[rows, columns], second[rows, columns].astype(np.float32)
    assert b.std() > 20.0, "hills, runway and marks are in it"
    shift, _ = cv2.phaseCorrelate(a - a.mean(), b - b.mean(), cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F))
    assert math.hypot(*shift) < 0.1
    assert np.abs(a - b).mean() < 1.5


def test_noise_is_what_the_optics_say() -> None:
    """Two pictures of one scene differ by twice the variance of shot noise, read noise and rounding."""
    optics = Optics(pattern=None, electrons_per_level=25.0, read_noise_electrons=20.0, gain=0.8)
    camera = camera_at(AWAY, optics)
    still = grey(camera_at(AWAY, replace(QUIET, gain=0.8)), 0.0, 0.0, 0.02)
    first, second = grey(camera, 1.0, 0.0, 0.02), grey(camera, 2.0, 0.0, 0.02)
    slope, floor = optics.noise
    expected = slope * still + floor + 1.0 / 12.0
    squares = 0.5 * (first - second) ** 2 / expected
    for low, high in ((0.0, 90.0), (90.0, 150.0), (150.0, 230.0)):
        chosen = squares[(still >= low) & (still < high)]
        assert chosen.size > 2000
        # each is a χ² of one degree of freedom; five sigma of their mean
        assert abs(chosen.mean() - 1.0) < 5.0 * math.sqrt(2.0 / chosen.size) + 0.01, (low, chosen.mean())
    lag = np.mean((first - still)[:, 1:] * (first - still)[:, :-1] / expected[:, 1:])
    assert abs(lag) < 5.0 / math.sqrt(first.size), "neighbours are independent"


@pytest.mark.parametrize("pattern", list(BayerPattern))
def test_raw_pictures_have_the_scene_s_colours(pattern: BayerPattern) -> None:
    """Whatever the pattern, the demosaiced sky is that of a sensor with three colours at each pixel, blue above all."""
    optics = replace(QUIET, pattern=pattern)
    raw = camera_at(AWAY, optics).picture(0.0, 0.0, 0.25)
    colour = raw.whole().astype(np.float64)
    light = np.array([camera_at(AWAY, replace(QUIET)).picture(0.0, 0.0, 0.25).whole()[:, :, 0].mean()])
    blue, green, red = colour[4:-4, 4:-4].reshape(-1, 3).mean(axis=0)
    assert blue > green + 3.0
    assert green > red + 3.0
    assert 0.114 * blue + 0.587 * green + 0.299 * red == pytest.approx(light[0], abs=1.0)


def test_the_silhouette_has_the_aircraft_s_size() -> None:
    place = (0.0, 100.0, 8.0)
    pan, tilt = aimed(GEOMETRY, place, (0.0, 0.0))
    truth = camera_at(place).truth(0.0, pan, tilt)
    width_px = 1600.0 * 2.3 / math.hypot(100.0, 5.4)
    assert truth.silhouette.shape[1] == pytest.approx(width_px, abs=1.6)
    assert truth.pixel_px is not None
    u, v = truth.pixel_px - truth.corner_px
    assert truth.silhouette[round(v), round(u)], "the nose is part of it"
    quick = camera_at(place).truth(0.0, pan, tilt, silhouette=False)
    assert quick.silhouette.size == 0
    np.testing.assert_array_equal(quick.pixel_px, truth.pixel_px)


def test_out_of_view_is_said() -> None:
    camera = camera_at((0.0, 100.0, 8.0))
    aside = camera.truth(0.0, 0.8, 0.0)
    assert (aside.visible, aside.silhouette.size) == (False, 0)
    behind = camera.truth(0.0, math.pi, 0.0)
    assert (behind.visible, behind.pixel_px) == (False, None)


def test_the_same_again_is_the_same() -> None:
    def taken(seed: int, t_s: float) -> np.ndarray:
        return camera_at((0.0, 100.0, 8.0), Optics(), seed=seed).picture(t_s, 0.0, 0.06, 0.1, 0.0).whole()

    assert np.array_equal(taken(1, 0.5), taken(1, 0.5))
    assert not np.array_equal(taken(1, 0.5), taken(2, 0.5))
    camera = camera_at((0.0, 100.0, 8.0), Optics(), seed=1)
    camera.picture(3.0, 1.0, 0.5)
    again = camera.picture(0.5, 0.0, 0.06, 0.1, 0.0).whole()
    assert np.array_equal(again, taken(1, 0.5)), "what was looked at before plays no part"


@cache
def swept() -> RenderedCamera:
    return camera_at((0.0, 8.0, 5.0), Optics(), station=small_station(size_px=(97, 61)))


@given(st.floats(-4.0, 4.0), st.floats(-1.7, 1.7), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-3.0, 3.0))
@settings(max_examples=150, deadline=None)
def test_any_direction_gives_a_picture(pan: float, tilt: float, pan_rate: float, tilt_rate: float, t_s: float) -> None:
    """Straight up, backwards, an aircraft that fills the picture or passes behind: always a picture, never a fault."""
    image = swept().picture(t_s, pan, tilt, pan_rate, tilt_rate).whole()
    assert image.shape == (61, 97, 3)
    assert image.mean() > 5.0
    truth = swept().truth(t_s, pan, tilt, pan_rate, tilt_rate)
    h, w = truth.silhouette.shape
    assert 0 <= truth.corner_px[0] <= 97 - w
    assert 0 <= truth.corner_px[1] <= 61 - h


def test_faces_look_outward() -> None:
    """A closed skin: outward normals times area sum to nothing, and the volume is positive."""
    shape = trainer()
    corners = shape.corners_body_m
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(doubled, axis=1)
    np.testing.assert_allclose((areas[:, None] * shape.normals_body).sum(axis=0), 0.0, atol=1e-6)
    volume = np.einsum("ij,ij,i->", corners.mean(axis=1), shape.normals_body, areas) / 3.0
    assert 0.005 < volume < 0.2
    assert np.ptp(corners[:, :, 1]) == pytest.approx(2.3, abs=0.01)


def test_impossible_parts_are_refused() -> None:
    with pytest.raises(ScenarioError, match="exposure_s"):
        Optics(exposure_s=0.0)
    with pytest.raises(ScenarioError, match="cloud_cover"):
        Scenery(cloud_cover=1.5)
    with pytest.raises(ScenarioError, match="span_m"):
        trainer(-1.0)
    huge = small_station(size_px=(9000, 10))
    with pytest.raises(ScenarioError, match="9000 × 10 px"):
        RenderedCamera(camera_at(AWAY).world, huge)
