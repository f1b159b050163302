"""The nose of silhouettes drawn from a simple solid aircraft under known attitude, range and wing position."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.detection.nose_point import NosePoint, find_nose
from groundstation.detection.point_noise import uncorrelated_covariance

FINE = 6
NOISE = 0.05


@dataclass(frozen=True, kw_only=True)
class Solid:
    """An aircraft in spans, x behind the nose, z above its centre: fuselage sections, wing, tailplane, gear."""

    wing_x: float = 0.25
    wing_z: float = 0.07
    chord: float = 0.15
    length: float = 0.7
    radius: float = 0.042
    tail_span: float = 0.32


HIGH_WING = Solid()
LOW_WING = Solid(wing_z=-0.035, wing_x=0.28, length=0.75)


@dataclass(frozen=True, kw_only=True)
class View:
    """Attitude against the line of sight in rad, span in px, true nose in px, the path's direction in the image."""

    span: float
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    nose: tuple[float, float] = (0.0, 0.0)


def axes(view: View) -> FloatArray:
    """Return the (2, 3) image shift in px of one span forward, to the aircraft's image right, and up."""
    cy, sy, cp, sp = math.cos(view.yaw), math.sin(view.yaw), math.cos(view.pitch), math.sin(view.pitch)
    # image right, image down, towards the camera
    forward = np.array([sy * cp, -sp, cy * cp])
    right = np.array([cy, 0.0, -sy])
    up = np.cross(forward, right)
    up *= -np.sign(up[1])
    c, s = math.cos(view.roll), math.sin(view.roll)
    turn = np.array([[c, -s], [s, c]])
    return view.span * turn @ np.stack([forward[:2], right[:2], up[:2]], axis=1)


def silhouette(solid: Solid, view: View, rng: np.random.Generator) -> tuple[np.ndarray, FloatArray]:
    """Return the soft, blurred, noisy membership (h, w) and the nose (2,) in it."""
    w, h = int(1.25 * view.span) + 12, int(1.0 * view.span) + 12
    nose = np.array([0.5 * w + rng.uniform(-0.5, 0.5), 0.45 * h + rng.uniform(-0.5, 0.5)])
    shift = axes(view)
    fine = np.zeros((h * FINE, w * FINE), np.uint8)

    def fill(points: list[tuple[float, float, float]]) -> None:
        image = np.array(points) @ shift.T + nose
        corners = cv2.convexHull(np.round((image + 0.5) * FINE - 0.5).astype(np.int32))
        cv2.fillConvexPoly(fine, corners, 1)

    angles = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
    rings = []
    for x, r, z in (
        (0.0, 0.015, 0.0),
        (0.03, 0.65 * solid.radius, 0.0),
        (0.1, solid.radius, 0.0),
        (0.2, 1.05 * solid.radius, 0.005),
        (0.35, 1.05 * solid.radius, 0.005),
        (0.5, 0.6 * solid.radius, 0.005),
        (solid.length, 0.3 * solid.radius, 0.01),
    ):
        rings.append([(-x, r * math.cos(a), z + r * math.sin(a)) for a in angles])
    for one, other in pairwise(rings):
        fill(one + other)
    cabin = [(-0.18, y, 0.03) for y in (-0.03, 0.03)] + [(-x, y, 0.072) for x in (0.24, 0.36) for y in (-0.028, 0.028)]
    fill([*cabin, (-0.45, 0.0, 0.03)])
    for span, x, chord, z in (
        (1.0, solid.wing_x, solid.chord, solid.wing_z),
        (solid.tail_span, solid.length - 0.08, 0.09, 0.015),
    ):
        thick = 0.12 * chord / 2
        fill([(-x - a, b * span / 2, z + c) for a in (-chord / 2, chord / 2) for b in (-1, 1) for c in (-thick, thick)])
    fin = solid.length - 0.02
    fill([(-fin, 0.0, 0.0), (-fin, 0.0, 0.12), (-fin + 0.1, 0.0, 0.02), (-fin + 0.04, 0.0, 0.12)])
    for side in (-1, 1):
        y = 0.13 * side
        fill([(-0.2, 0.02 * side, -0.03), (-0.23, 0.03 * side, -0.03), (-0.2, y, -0.12), (-0.23, y, -0.12)])
    cover = fine.reshape(h, FINE, w, FINE).mean(axis=(1, 3), dtype=np.float64)
    soft = cv2.GaussianBlur(cover, (0, 0), 0.6)
    seen = np.where(soft > 0.1, soft + rng.normal(0.0, NOISE, soft.shape), 0.0)
    # a contrast well above the reference saturates
    return np.clip(1.4 * seen, 0.0, 1.0).astype(np.float32), nose


def look(
    solid: Solid, view: View, path: tuple[float, float], rng: np.random.Generator, reduced: int = 1
) -> tuple[NosePoint, FloatArray]:
    """Find the nose when the path is off the body axis by ``path`` (crab, incidence), rad; return it with its error.

    ``reduced`` px of the camera make one of the processed picture; the result is in these.
    """
    membership, nose = silhouette(solid, view, rng)
    if reduced > 1:
        size = tuple(n // reduced for n in membership.shape[::-1])
        whole = membership[: size[1] * reduced, : size[0] * reduced]
        membership = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)
        nose, view = (nose - 0.5 * (reduced - 1)) / reduced, replace(view, span=view.span / reduced)
    along = View(span=view.span, yaw=view.yaw - path[0], pitch=view.pitch - path[1])
    forward = axes(along)[:, 0]
    up = axes(View(span=view.span))[:, 2]
    width = float(np.ptp(np.flatnonzero((membership > 0.5).any(axis=0)))) + 1.0
    scale = width / view.span
    found = find_nose(membership, width, 20.0, scale * forward, scale * up, (view.span, 0.15), 5.0, reduced)
    return found, found.point - nose


def errors(
    solid: Solid, span: float, elevation: float, rng: np.random.Generator, count: int = 24
) -> tuple[FloatArray, FloatArray]:
    """Return errors (n, 2) in px and normalised squares (n,) over crab, incidence and roll."""
    offsets, squares = [], []
    for _ in range(count):
        crab = float(np.clip(rng.normal(0.0, math.radians(4.0)), -0.17, 0.17))
        incidence = float(rng.normal(math.radians(5.0), math.radians(2.0)))
        sight = float(rng.normal(0.0, math.radians(2.0)))
        view = View(span=span, yaw=sight + crab, pitch=elevation, roll=float(rng.normal(0.0, 0.1)))
        found, error = look(solid, view, (crab, incidence), rng)
        offsets.append(error)
        squares.append(float(error @ np.linalg.solve(found.covariance, error)))
    return np.array(offsets), np.array(squares)


@pytest.mark.parametrize("solid", [HIGH_WING, LOW_WING], ids=["high wing", "low wing"])
@pytest.mark.parametrize("elevation_deg", [0.0, 8.0, 15.0])
@pytest.mark.parametrize("span", [18.0, 40.0, 80.0, 150.0])
def test_nose_is_found_under_crab_roll_and_elevation(
    rng: np.random.Generator, solid: Solid, elevation_deg: float, span: float
) -> None:
    offsets, _ = errors(solid, span, math.radians(elevation_deg), rng)
    rms = np.sqrt(np.mean(offsets**2, axis=0))
    assert rms[0] < max(1.0, 0.025 * span)
    assert rms[1] < max(1.0, 0.035 * span)


@pytest.mark.parametrize("solid", [HIGH_WING, LOW_WING], ids=["high wing", "low wing"])
def test_errors_fit_the_stated_covariance(rng: np.random.Generator, solid: Solid) -> None:
    """Aircraft differ more than this one solid does, so the covariance may be wide, but never too narrow."""
    squares = np.concatenate([errors(solid, span, math.radians(e), rng)[1] for span in (40.0, 100.0) for e in (2, 12)])
    assert np.sum(squares) < chi2.ppf(0.999, 2 * squares.size)
    assert np.mean(squares) / 2.0 > 0.15


def test_crab_is_measured_where_the_fuselage_is_seen(rng: np.random.Generator) -> None:
    """The nose points 9° aside of the path; seen from 15° below, the fuselage shows it."""
    for crab in (-0.16, 0.16):
        view = View(span=150.0, yaw=crab, pitch=math.radians(15.0))
        _, error = look(HIGH_WING, view, (crab, 0.0), rng)
        assert abs(error[0]) < 0.012 * view.span


@pytest.mark.parametrize("crab", [-0.16, 0.16])
@pytest.mark.parametrize("reduced", [2, 4])
def test_crab_is_measured_in_a_reduced_picture_too(rng: np.random.Generator, crab: float, reduced: int) -> None:
    """A large silhouette is processed in fewer px, which contain as much as the camera resolved."""
    view = View(span=80.0 * reduced, yaw=crab, pitch=math.radians(15.0))
    found, error = look(HIGH_WING, view, (crab, 0.0), rng, reduced)
    assert abs(error[0]) < 0.02 * 80.0
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.99, 2)


def test_unknown_heading_gives_the_thickest_part_and_a_wide_covariance(rng: np.random.Generator) -> None:
    membership, nose = silhouette(HIGH_WING, View(span=60.0), rng)
    found = find_nose(membership, 60.0, 20.0, None, None)
    assert np.hypot(*(found.point - nose)) < 5.0
    assert np.sqrt(found.covariance[0, 0]) > 0.05 * 60.0


def test_a_hidden_wing_half_widens_the_covariance_and_moves_the_nose_little(rng: np.random.Generator) -> None:
    membership, nose = silhouette(HIGH_WING, View(span=80.0), rng)
    half = membership.copy()
    half[:, : int(nose[0] - 18)] = 0.0
    forward, up = np.array([0.0, 0.0]), np.array([0.0, -80.0])
    whole = find_nose(membership, 80.0, 20.0, forward, up, (80.0, 0.05), 5.0)
    found = find_nose(half, 58.0, 20.0, forward * 58 / 80, up * 58 / 80, (80.0, 0.05), 5.0)
    assert abs(found.point[0] - nose[0]) < 2.5
    assert found.covariance[0, 0] > whole.covariance[0, 0]


@pytest.mark.parametrize("contrast", [1.0, 6.0, 20.0, 100.0])
@pytest.mark.parametrize("span", [40.0, 120.0])
@pytest.mark.parametrize("forward", [None, (0.05, 0.1), (0.9, 0.1)], ids=["unknown", "head-on", "side-on"])
def test_what_is_new_in_each_frame_is_a_part_of_the_covariance(
    rng: np.random.Generator, contrast: float, span: float, forward: tuple[float, float] | None
) -> None:
    """Expected: what is left lasts and is a covariance, too; less noise with more contrast."""
    membership, _ = silhouette(HIGH_WING, View(span=span), rng)
    along = None if forward is None else span * np.array(forward)
    found, clearer = (
        find_nose(membership, span, c, along, np.array([0.0, -span]), (span, 0.05), 5.0)
        for c in (contrast, 2 * contrast)
    )
    assert np.linalg.eigvalsh(found.noise).min() > 0.0
    assert np.linalg.eigvalsh(found.covariance - found.noise).min() > 0.0
    assert np.trace(clearer.noise) < np.trace(found.noise)


def test_what_is_new_in_each_frame_is_twice_as_much_in_v_as_in_u() -> None:
    """Expected: 2.2 px over the contrast in u, 4.5 in v, no more than is stated; 8 % of a legible attitude added."""
    attitude = np.array([[3.0, 1.0], [1.0, 7.0]])
    pixels = np.diag([(2.2 / 10.0) ** 2, (4.5 / 10.0) ** 2])
    np.testing.assert_allclose(uncorrelated_covariance(1.0, attitude, 10.0, 0.0), pixels)
    np.testing.assert_allclose(uncorrelated_covariance(1.0, attitude, 10.0, 0.5), pixels + 0.04 * attitude)
    np.testing.assert_allclose(uncorrelated_covariance(0.1, attitude, 10.0, 0.0), np.diag([0.0484, 0.1]))
