"""The lens and its sigmas: against the truth over seeds, against OpenCV on the same corners, on unseen views."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from calibration.lens.advice import advise, tilts_deg
from calibration.lens.boards import parse_board
from calibration.lens.fit import BoardView, fit_lens
from calibration.lens.intrinsics import solve_intrinsics
from calibration.lens.quality import hold_out, uncertainty_map
from calibration.lens.view_choice import choose_views
from tests.calibration.lens.boards_seen import a_lens, corner_views, parameters

BOARD = parse_board("charuco:9x7:0.04:0.03")


def test_parameters_lie_within_their_sigmas() -> None:
    """Σ eᵀC⁻¹e over twelve draws is χ² with 9 · 12 degrees of freedom."""
    lens = a_lens(k3=-0.02)
    total = 0.0
    for seed in range(12):
        views = corner_views(np.random.default_rng(seed), BOARD, lens, 16, sigma_px=0.1)
        fit = fit_lens(views, lens.image_size_px)
        error = parameters(fit.lens) - parameters(lens)
        total += float(error @ np.linalg.solve(fit.covariance, error))
    low, high = chi2.ppf([0.001, 0.999], 9 * 12)
    assert low < total < high


def test_sigmas_hold_where_a_view_errs_as_a_whole() -> None:
    """Boards bent differently in each view: each parameter's error over its sigma over 40 draws, and all together.

    With each sigma raised by itself eᵀC⁻¹e came to 13 of 9.
    """
    lens = a_lens(k3=-0.02)
    draws = 40
    squares, together = np.zeros(9), 0.0
    for seed in range(draws):
        generator = np.random.default_rng(seed)
        views = [_bent(v, generator) for v in corner_views(generator, BOARD, lens, 16, sigma_px=0.1)]
        fit = fit_lens(views, lens.image_size_px)
        error = parameters(fit.lens) - parameters(lens)
        squares += (error / fit.sigma) ** 2
        together += float(error @ np.linalg.solve(fit.covariance, error))
    low, high = chi2.ppf([0.0005, 0.9995], draws)
    assert np.all(squares > low)
    assert np.all(squares < high)
    low, high = chi2.ppf([0.0005, 0.9995], 9 * draws)
    assert low < together < high


def _bent(view: BoardView, generator: np.random.Generator) -> BoardView:
    """Move a view's corners by a drawn curved field of 0.1 px."""
    flat = view.board_m - view.board_m.mean(axis=0)
    x, y = (flat / flat.std(axis=0).max())[:, :2].T
    return replace(
        view, pixel=view.pixel + 0.1 * np.column_stack([x * x, y * y, x * y]) @ generator.normal(size=(3, 2))
    )


def test_a_long_lens_is_within_its_sigmas_and_its_correlations_are_reported() -> None:
    lens = a_lens((1280, 960), focal_px=6684.0)
    total = 0.0
    free = list(range(8))
    for seed in range(8):
        views = corner_views(np.random.default_rng(seed), BOARD, lens, 20, sigma_px=0.1)
        fit = fit_lens(views, lens.image_size_px, held=frozenset({"k3"}))
        error = (parameters(fit.lens) - parameters(lens))[free]
        total += float(error @ np.linalg.solve(fit.covariance[np.ix_(free, free)], error))
        assert fit.focal_distance_correlation > 0.95
        assert fit.sigma[8] == 0.0
        assert fit.lens.distortion[4] == 0.0
    low, high = chi2.ppf([0.001, 0.999], 8 * 8)
    assert low < total < high


def test_plain_opencv_finds_the_same(rng: np.random.Generator) -> None:
    lens = a_lens()
    views = corner_views(rng, BOARD, lens, 15, sigma_px=0.1)
    fit = fit_lens(views, lens.image_size_px)
    rms, matrix, distortion, _, _ = cv2.calibrateCamera(
        [v.board_m.astype(np.float32) for v in views],
        [v.pixel.astype(np.float32) for v in views],
        lens.image_size_px,
        np.eye(3),
        np.zeros(5),
    )
    plain = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.reshape(-1)])
    assert np.all(np.abs(parameters(fit.lens) - plain) < 0.02 * fit.sigma)
    assert fit.rms_px == pytest.approx(rms, rel=1e-5)
    # OpenCV takes every corner's error as new; what a view's have in common only ever adds
    assert fit.white_sigma == pytest.approx(fit.opencv_sigma, rel=0.01)
    assert np.all(fit.sigma > 0.99 * fit.opencv_sigma)
    assert np.all(fit.sigma < 1.8 * fit.opencv_sigma)


def test_the_held_out_error_is_the_noise(rng: np.random.Generator) -> None:
    lens = a_lens()
    views = corner_views(rng, BOARD, lens, 20, sigma_px=0.1)
    fit = fit_lens(views, lens.image_size_px)
    held_out = hold_out(views, fit, held=frozenset())
    assert fit.rms_px < held_out.rms_px < 1.1 * 0.1 * np.sqrt(2)
    assert fit.sigma_px == pytest.approx(0.1, rel=0.1)


def test_the_map_is_the_uncertainty_of_pixels(rng: np.random.Generator) -> None:
    """Lenses drawn from the covariance move pixels by the map's sigmas."""
    lens = a_lens()
    fit = fit_lens(corner_views(rng, BOARD, lens, 15, sigma_px=0.1), lens.image_size_px)
    shown = uncertainty_map(fit.lens, fit.covariance, columns=9)
    # the same corner of the image, by drawing
    corner = np.array([[[shown.u_px[0], shown.v_px[0]]]])
    f, c, k = fit.lens.focal_px, fit.lens.principal_point_px, fit.lens.distortion
    matrix = np.array([[f[0], 0, c[0]], [0, f[1], c[1]], [0, 0, 1.0]])
    ray = cv2.undistortPoints(corner, matrix, k, criteria=(3, 100, 1e-12)).reshape(2)
    point = np.array([[*ray, 1.0]])
    pixels = []
    for p in rng.multivariate_normal(parameters(fit.lens), fit.covariance, 2000):
        drawn = np.array([[p[0], 0, p[2]], [0, p[1], p[3]], [0, 0, 1.0]])
        pixels.append(cv2.projectPoints(point, np.zeros(3), np.zeros(3), drawn, p[4:])[0].reshape(2))
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(pixels).T))[1])
    assert shown.lens_px[0, 0] == pytest.approx(spread, rel=0.1)
    assert np.all(shown.aligned_px <= shown.lens_px + 1.0)
    assert shown.aligned_px.min() < 0.3 * shown.aligned_px.max()


def test_frontal_boards_get_the_advice_to_tilt(rng: np.random.Generator) -> None:
    lens = a_lens()
    views = corner_views(rng, BOARD, lens, 14, sigma_px=0.05, tilt_deg=12.0)
    found = solve_intrinsics(choose_views(views, BOARD, lens.image_size_px), BOARD, lens.image_size_px)
    assert tilts_deg(found).max() < 20.0
    advice = advise(found)
    assert advice.next_steps[0].startswith("More tilt: 0 of 14 boards")
    assert any("cannot distinguish a longer lens and a nearer board" in note for note in advice.notes)


def test_a_view_with_wrong_corners_is_left_out(rng: np.random.Generator) -> None:
    lens = a_lens()
    views = corner_views(rng, BOARD, lens, 12, sigma_px=0.05)
    views[4].pixel[3:9] += rng.normal(0.0, 6.0, (6, 2))
    found = solve_intrinsics(choose_views(views, BOARD, lens.image_size_px), BOARD, lens.image_size_px)
    assert [v.name for v in found.verdicts if v.choice.value == "does not fit the others"] == ["04"]
    assert found.held_out.rms_px < 0.1
