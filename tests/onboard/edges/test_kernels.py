"""Each compiled kernel equals plain numpy, to rounding."""

import cv2
import numpy as np
import pytest

from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.detection import line_energies
from groundstation.onboard.edges.frame_geometry import TrackerCamera, geometry_between_rows, pose_noise
from groundstation.onboard.edges.kalman import LineState, update_crossings
from groundstation.onboard.edges.kalman_kernel import between
from groundstation.onboard.edges.line_kernel import seen_rows
from groundstation.onboard.edges.lines import bias_jacobian, line_map, pose_jacobian, project_lines, state_from_ground
from groundstation.onboard.edges.marking_removal import median_grey
from groundstation.onboard.edges.pose import NoseCameraPose, ground_from_pixels
from groundstation.onboard.edges.strip_kernel import (
    displacement_scores,
    edges_agree,
)
from tests.onboard.edges import plain
from tests.onboard.edges.seen import KAPPA, ROWS, SIZE, approach, painted_runway

SEEDS = range(8)


def drawn_pose(rng: np.random.Generator) -> NoseCameraPose:
    x, y, z = rng.uniform(-8.0, 8.0), rng.uniform(40.0, 300.0), rng.uniform(5.0, 30.0)
    roll, pitch, yaw = rng.uniform(-0.1, 0.1, 3)
    return approach(x=x, y=y, z=z, roll=roll, pitch=-0.05 + 0.3 * pitch, yaw=yaw)


@pytest.mark.parametrize("seed", SEEDS)
def test_lines_of_the_ground_in_the_picture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, turn = drawn_pose(rng), rng.uniform(-0.05, 0.05)
    state = np.array([np.cos(turn), np.sin(turn), *rng.uniform(4.0, 12.0, 2) * [-1.0, 1.0]])
    e = plain.line_map(pose, KAPPA)
    np.testing.assert_allclose(line_map(pose, KAPPA), e, rtol=1e-9, atol=1e-12)
    crossings, h = plain.project_lines(state, e, ROWS)
    by_pose = plain.pose_jacobian(crossings, ROWS, pose, KAPPA)
    for found, wanted in (
        (project_lines(state, e, ROWS), (crossings, h)),
        ([pose_jacobian(crossings, ROWS, pose, KAPPA)], [by_pose]),
    ):
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    up = by_pose[:, 3:] @ pose.threshold_from_camera[2]
    np.testing.assert_allclose(bias_jacobian(by_pose, pose), np.stack([by_pose[:, 2], by_pose[:, 0], up], axis=1))
    config = TrackerConfig()
    camera = TrackerCamera(kappa=KAPPA, image_size_px=SIZE, config=config)
    known = LineState(mean=np.concatenate([state, np.zeros(3)]), covariance=np.eye(7))
    look = geometry_between_rows(camera, pose, known, ROWS)
    np.testing.assert_allclose(look.predicted, crossings, rtol=1e-9)
    np.testing.assert_allclose(look.h, np.hstack([h, bias_jacobian(by_pose, pose)]), rtol=1e-9, atol=1e-9)
    sigmas = np.array([config.attitude_sigma_rad] * 3 + list(config.position_sigma_m))
    np.testing.assert_allclose(pose_noise(config, look), (by_pose * sigmas**2) @ by_pose.T, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_pixels_on_the_ground_and_the_rows_of_the_band(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = drawn_pose(rng)
    pixels = rng.uniform([0.0, 250.0], [640.0, 479.0], (4, 2))
    pixels[0, 1] = -300.0
    found = ground_from_pixels(pose, KAPPA, pixels)
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(found, plain.ground_from_pixels(pose, KAPPA, pixels), rtol=1e-9)
    corners = rng.normal(0.0, 30.0, (2, 2, 2))
    np.testing.assert_allclose(state_from_ground(corners), plain.state_from_ground(corners), rtol=1e-9, atol=1e-12)
    rows, sides = np.empty(2), (9.0, -9.0)
    ends = (min(-6.0, float(pose.camera_threshold_m[1]) - 2.0), -494.0)
    wanted = plain.seen_rows(pose, KAPPA, SIZE, sides, ends)
    seen = seen_rows(pose.threshold_from_camera, pose.camera_threshold_m, KAPPA, SIZE, sides, ends, rows)
    assert seen == (wanted is not None)
    if wanted is not None:
        np.testing.assert_allclose(rows, wanted, rtol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_update_is_josephs_with_the_constrained_gain(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root, spread = rng.normal(0.0, 1.0, (7, 7)), rng.normal(0.0, 1.0, (4, 4))
    mean = np.array([np.cos(0.02), np.sin(0.02), -9.0, 9.0, 0.0, 0.0, 0.1])
    p, noise, h = 1e-2 * root @ root.T, spread @ spread.T + np.eye(4), rng.normal(0.0, 3.0, (4, 7))
    innovation = 0.1 * rng.normal(0.0, 1.0, 4)
    found = update_crossings(LineState(mean=mean, covariance=p), np.zeros(4), h, innovation, noise)
    wanted = plain.update(mean, p, h, innovation, noise)
    np.testing.assert_allclose(found.state.mean, wanted[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.state.covariance, wanted[1], rtol=1e-9, atol=1e-12)
    assert abs(found.nis - wanted[2]) < 1e-9 * wanted[2]
    # parts of larger arrays, too: of the paper's own state
    large = np.zeros((9, 9))
    large[:7, :7] = p
    again = update_crossings(LineState(mean=mean, covariance=large[:7, :7]), np.zeros(4), h, innovation, noise)
    np.testing.assert_array_equal(again.state.covariance, found.state.covariance)
    out, covariance = np.empty(4), np.empty((4, 4))
    prior, predicted = h @ p @ h.T + np.eye(4), rng.normal(0.0, 1.0, 4)
    between(predicted, prior, innovation, noise, out, covariance)
    gain = np.linalg.solve(prior + noise, prior).T
    np.testing.assert_allclose(out, predicted + gain @ (innovation - predicted), rtol=1e-9)
    np.testing.assert_allclose(covariance, gain @ noise, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("displacements", [5, 15, 45])
def test_displacements_are_scored_as_place_by_place(displacements: int) -> None:
    """Staircases steeper than one displacement a place too, and places outside the picture."""
    rng = np.random.default_rng(displacements)
    for places, block in ((40, 5), (22, 4), (12, 1)):
        strip = rng.normal(0.0, 0.1, (places, displacements, 3))
        strip[: places // 3, : displacements // 2, 0] = np.nan
        strip[: places - 2, -1, 0] = np.nan
        found = np.empty((displacements, displacements))
        displacement_scores(strip, block, 0.01, found)
        wanted = plain.displacement_scores(strip, block, 0.01)
        assert (wanted < 0.0).any()
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_agreement_of_the_strips_edges() -> None:
    rng = np.random.default_rng(3)
    strip = rng.normal(0.0, 0.1, (2, 22, 7, 3))
    strip[0, 6, 3, 0] = np.nan
    left, right = strip[:, :20, 3].reshape(2, 4, 5, 3).mean(axis=2)[:, [0, 2, 3]]
    wanted = -np.sum(left * right) / np.sqrt(np.sum(left**2) * np.sum(right**2))
    assert abs(edges_agree(strip, 5) - wanted) < 1e-12


def test_the_energies_of_lines_are_those_of_means_beside_them() -> None:
    picture, rows, reaches = painted_runway(approach()), np.array([250.4, 300.2]), np.array([5.0, 21.3])
    rng = np.random.default_rng(5)
    columns, slopes = rng.uniform(0.0, 640.0, 60), rng.uniform(-1.0, 1.0, 60)
    found = np.empty(60)
    line_energies(picture, rows, columns, slopes, reaches, found)
    wanted = plain.line_energies(picture, rows, columns, slopes, reaches)
    # but for lines that leave the picture
    assert (wanted < 0.0).sum() > 50
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_the_median_grey_is_that_of_opencvs_grey_levels() -> None:
    rng = np.random.default_rng(7)
    for columns in (1, 2, 5, 8, 64):
        picture = rng.integers(0, 256, (7, columns, 3)).astype(np.uint8)
        assert median_grey(picture, 4) == np.median(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)[::4, ::4])
