"""Corners from pictures: SUSAN, and sides fitted below the pixel."""

import cv2
import numpy as np

from groundstation.onboard.pose.corners import corners_from_lines, refine_corners
from groundstation.onboard.pose.susan import susan_corner

# seen from short final: near left, far left, far right, near right
QUADRILATERAL = np.array([[70.3, 190.6], [133.2, 61.4], [160.7, 62.1], [240.4, 195.2]])


def picture(corners: np.ndarray, rng: np.random.Generator, noise: float = 2.0) -> np.ndarray:
    """A bright runway on darker grass: sides exact below the pixel, slightly blurred, with noise."""
    v, u = np.mgrid[0:256, 0:320].astype(float)
    inside = np.full(u.shape, np.inf)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        # clockwise to the eye: the runway lies to the right of each side, where v runs down
        inside = np.minimum(inside, along[0] * (v - start[1]) - along[1] * (u - start[0]))
    image = 70.0 + 100.0 * np.clip(0.5 + inside, 0.0, 1.0)
    return cv2.GaussianBlur(image, (0, 0), 0.7) + noise * rng.standard_normal(u.shape)


def moved(rng: np.random.Generator) -> np.ndarray:
    return QUADRILATERAL + rng.uniform(-4, 4, 2) + rng.uniform(-3, 3, (4, 2))


def test_sides_find_corners_below_the_pixel_with_consistent_covariance(rng: np.random.Generator) -> None:
    errors, squares = [], []
    for _ in range(40):
        true = moved(rng)
        found = refine_corners(picture(true, rng), true + rng.uniform(-3, 3, (4, 2)))
        assert found is not None
        errors.append(found.pixels - true)
        for e, P in zip(errors[-1], found.covariance_px2, strict=True):
            squares.append(float(e @ np.linalg.solve(P, e)))
    rmse = float(np.sqrt(np.mean(np.sum(np.square(errors), axis=2))))
    assert rmse < 0.06
    assert 0.5 < np.mean(squares) / 2 < 2.0


def test_susan_finds_corners_to_a_few_pixels(rng: np.random.Generator) -> None:
    distances = []
    for _ in range(20):
        true = moved(rng)
        image = picture(true, rng)
        for corner in true:
            found = susan_corner(image, corner + rng.uniform(-3, 3, 2), 7, 25.0)
            if found is not None:
                distances.append(float(np.linalg.norm(found - corner)))
    assert len(distances) > 70
    assert np.median(distances) < 3.0


def test_a_flat_picture_has_no_corners(rng: np.random.Generator) -> None:
    flat = np.full((256, 320), 100.0)
    assert susan_corner(flat, QUADRILATERAL[0], 7, 25.0) is None
    assert refine_corners(flat, QUADRILATERAL) is None


def test_corners_outside_the_picture_are_none(rng: np.random.Generator) -> None:
    image = picture(QUADRILATERAL, rng)
    assert refine_corners(image, QUADRILATERAL + [400.0, 0.0]) is None
    assert susan_corner(image, np.array([900.0, 50.0]), 7, 25.0) is None


def test_lines_meet_in_corners() -> None:
    homogeneous = np.column_stack([QUADRILATERAL, np.ones(4)])
    left, far, right, near = (np.cross(homogeneous[k], homogeneous[(k + 1) % 4]) for k in range(4))
    corners = corners_from_lines(left, right, near, far)
    assert corners is not None
    np.testing.assert_allclose(corners, QUADRILATERAL, atol=1e-9)
    assert corners_from_lines(left, left, near, near * 2) is not None
    assert corners_from_lines(near, right, near, far) is None


def test_more_noise_is_more_uncertain(rng: np.random.Generator) -> None:
    calm, noisy = (refine_corners(picture(QUADRILATERAL, rng, noise), QUADRILATERAL) for noise in (0.5, 15.0))
    assert calm is not None
    assert noisy is not None
    assert np.trace(noisy.covariance_px2.sum(axis=0)) > 2.0 * np.trace(calm.covariance_px2.sum(axis=0))
