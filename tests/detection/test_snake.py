import dataclasses

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundstation.detection import snake
from groundstation.detection.config import SnakeConfig

REST = (400, 0.0, 2)


def disc(shape: tuple[int, int], centre: tuple[float, float], radius: float) -> NDArray[np.float64]:
    """How far inside a circle each pixel lies, in px."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    return radius - np.hypot(x - centre[0], y - centre[1])


def overlap(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


def u_shape() -> NDArray[np.bool_]:
    """A block of 49 × 53 px, open at its top by a slot of 19 × 36 px."""
    y, x = np.mgrid[0:96, 0:96]
    return (np.abs(x - 48) <= 24) & (np.abs(y - 48) <= 26) & ~((np.abs(x - 48) <= 9) & (y < 58))


@pytest.mark.parametrize("gvf", [False, True])
def test_a_displaced_circle_finds_a_blurred_noisy_disc(rng: np.random.Generator, gvf: bool) -> None:
    blurred = 1 / (1 + np.exp(-disc((80, 120), (62, 42), 15)))
    u = np.clip(blurred + rng.normal(0, 0.02, blurred.shape), 0, 1).astype(np.float32)
    start = disc(u.shape, (60, 41), 18) > 0
    phi = snake.segment(u, start, SnakeConfig(sigma_px=2.0), REST, gvf=gvf)
    truth = disc(u.shape, (62, 42), 15) > 0
    assert set(np.unique(phi)) == {-1.0, 1.0}
    assert overlap(start, truth) < 0.72
    assert overlap(phi > 0, truth) > 0.93


def test_gradient_vector_flow_reaches_into_a_concavity_where_the_snake_does_not() -> None:
    """The U of Xu & Prince: near the slot's mouth the plain force only points at its two walls."""
    shape = u_shape()
    u = cv2.GaussianBlur(shape.astype(np.float32), (0, 0), 0.8)
    start = disc(u.shape, (48, 48), 40) > 0
    config = SnakeConfig(sigma_px=1.0, tension=0.4)
    plain = snake.segment(u, start, config, REST, gvf=False) > 0
    flowing = snake.segment(u, start, config, REST, gvf=True) > 0
    slot = np.s_[26:54, 42:55]
    assert plain[slot].mean() > 0.9
    assert flowing[slot].mean() < 0.05
    assert overlap(flowing, shape) > 0.85 > overlap(plain, shape)


def test_one_contour_stays_one_and_covers_one_of_two_discs() -> None:
    """The failure that the paper shows: a wing seen apart from the body is lost to a snake."""
    apart = np.maximum(disc((60, 120), (40, 30), 9), disc((60, 120), (85, 30), 9))
    u = (1 / (1 + np.exp(-apart))).astype(np.float32)
    start = disc(u.shape, (40, 30), 14) > 0
    found = snake.segment(u, start, SnakeConfig(), REST, gvf=True) > 0
    assert found[30, 40]
    assert not found[:, 70:].any()


def test_tension_alone_shrinks_a_circle_by_its_curvature() -> None:
    """With f = 0, dA/dt = −2π α h², h the spacing; differences of points are in units of the spacing."""
    config = SnakeConfig(tension=0.5, rigidity=0.0, step=1.0, spacing_px=1.0)
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    circle = 60 + 30 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    force = np.zeros((120, 120, 2), np.float32)
    points, done = snake.evolve(circle, force, snake.stiffness_kernel(config), (1.0, 1.0), 100, -1.0, 1)
    area = cv2.contourArea(points.astype(np.float32))
    assert done == 100
    assert area == pytest.approx(np.pi * 30**2 - 2 * np.pi * 0.5 * 100, rel=0.03)


@pytest.mark.parametrize("count", [9, 40, 300])
def test_kernel_is_the_inverse_of_the_circulant_matrix(count: int) -> None:
    config = SnakeConfig(tension=0.3, rigidity=0.2, step=0.7)
    kernel = snake.stiffness_kernel(config)
    half = len(kernel) // 2
    convolution = np.zeros((count, count))
    for m in range(-half, half + 1):
        convolution += kernel[m + half] * np.roll(np.eye(count), -m, axis=0)
    second = 2 * np.eye(count) - np.roll(np.eye(count), 1, axis=0) - np.roll(np.eye(count), -1, axis=0)
    stiffness = config.tension * second + config.rigidity * second @ second
    assert np.allclose(convolution @ (np.eye(count) + config.step * stiffness), np.eye(count), atol=1e-5)


def test_force_of_the_flow_is_the_gradient_near_edges_and_reaches_where_the_gradient_does_not() -> None:
    u = (1 / (1 + np.exp(-disc((60, 60), (30, 30), 10)))).astype(np.float32)
    config = SnakeConfig(gvf_iterations=200)
    flow, plain = snake.gvf_force(u, config), snake.gradient_force(u, config)
    strong = np.hypot(plain[:, :, 0], plain[:, :, 1]) > 0.5
    direction = plain / np.maximum(np.hypot(plain[:, :, 0], plain[:, :, 1]), 1e-9)[:, :, None]
    assert (np.sum(flow * direction, axis=2)[strong] > 0.9).all()
    # 18 px left of the disc: the plain force is gone, the flow points right
    assert abs(plain[30, 2, 0]) < 1e-3
    assert flow[30, 2, 0] > 0.95


def test_resampled_points_lie_evenly_on_the_same_contour(rng: np.random.Generator) -> None:
    angle = np.sort(rng.uniform(0, 2 * np.pi, 500))
    points = snake.resample(50 + 20 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 0.5)
    sides = np.hypot(*np.diff(np.vstack([points, points[:1]]), axis=0).T)
    assert np.hypot(*(points - 50).T) == pytest.approx(20, abs=0.1)
    assert sides == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize("gvf", [False, True])
def test_a_start_outside_the_image_or_a_flat_image_gives_no_fault(gvf: bool) -> None:
    flat, nothing = np.full((20, 30), 0.3, np.float32), np.zeros((20, 30), np.bool_)
    assert (snake.segment(flat, nothing, SnakeConfig(), REST, gvf=gvf) < 0).all()
    start = disc(flat.shape, (15, 10), 6) > 0
    assert np.isfinite(snake.segment(flat, start, SnakeConfig(), REST, gvf=gvf)).all()


@pytest.mark.parametrize("change", [{"tension": -1.0}, {"step": 0.0}, {"gvf_mu": 0.3}, {"spacing_px": 0.0}])
def test_impossible_numerics_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must"):
        dataclasses.replace(SnakeConfig(), **change)
