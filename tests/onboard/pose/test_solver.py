"""The pose solver: Jacobians, against scipy, from any start, and its covariance."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from groundstation.geometry.dual_quaternion import from_pose, quaternion_conjugate, translation_of
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.onboard.pose import pose_solver
from groundstation.onboard.pose.coplanarity_solver import FOUR_SIDES, SIX_PAIRS, dual_part, solve_coplanarity
from groundstation.onboard.pose.inertial_filter import rotation_vector
from groundstation.onboard.pose.levenberg_marquardt import COPLANARITY, REPROJECTION, PoseCost, residuals
from groundstation.onboard.pose.pose_solver import (
    KnownAttitude,
    PointCorrespondences,
    PoseStatus,
    RunwayPose,
    SolverInput,
    attitude_rows,
    pair_normals,
    pose_covariance,
    solve_pose,
)
from tests.onboard.pose.approaches import LENS, RUNWAY, pose_on_approach, project, quaternion, seen


def evaluate(kind: int, q: np.ndarray, view: SolverInput, attitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = 2 * len(SIX_PAIRS) + 2 if kind == COPLANARITY else 2 * len(view.points) + len(attitude) + 2
    r, J = np.empty(count), np.empty((count, 8))
    normals = pair_normals(view.rays, SIX_PAIRS)
    problem = PoseCost(kind, view.points, view.rays, view.tangents, attitude, normals, SIX_PAIRS, view.scale_m)
    good = residuals(problem, q, r, J)
    assert good
    return r, J


def error_of(pose: RunwayPose, truth: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Truth less estimate, (6,), as the covariance has it."""
    R = matrix_from_wxyz(pose.runway_from_camera_wxyz)
    return np.concatenate([truth[0] - pose.position_m, rotation_vector(truth[1] @ R.T)])


@pytest.mark.parametrize("kind", [COPLANARITY, REPROJECTION])
@pytest.mark.parametrize("range_m", [200.0, 900.0, 4000.0])
def test_jacobians_against_differences(kind: int, range_m: float, rng: np.random.Generator) -> None:
    """Away from the solution and off the unit length, near and far."""
    for _ in range(20):
        truth = pose_on_approach(rng, range_m)
        view = SolverInput(seen(rng, truth, 0.5))
        known = KnownAttitude(runway_from_camera_wxyz=quaternion(truth), sigma_rad=np.array([0.01, 0.02, np.inf]))
        q = view.dual(quaternion(truth), truth[0]) * rng.uniform(0.8, 1.2) + 0.01 * rng.standard_normal(8)
        _, J = evaluate(kind, q, view, attitude_rows(known))
        step = 1e-6
        for k in range(8):
            d = np.zeros(8)
            d[k] = step
            more, less = (evaluate(kind, q + s * d, view, attitude_rows(known))[0] for s in (1, -1))
            np.testing.assert_allclose(J[:, k], (more - less) / (2 * step), rtol=1e-5, atol=1e-5 * np.abs(J).max())


@pytest.mark.parametrize("kind", [COPLANARITY, REPROJECTION])
def test_the_compiled_solver_ends_where_scipy_ends(kind: int, rng: np.random.Generator) -> None:
    for _ in range(15):
        truth = pose_on_approach(rng)
        picture = seen(rng, truth, 0.5)
        view = SolverInput(picture)
        start = view.dual(quaternion(truth), truth[0])
        none = np.zeros((0, 4))
        theirs = least_squares(
            lambda q: evaluate(kind, q, view, none)[0],  # noqa: B023 - used within the loop's turn
            start,
            lambda q: evaluate(kind, q, view, none)[1],  # noqa: B023
            method="lm", x_scale="jac", xtol=1e-13, ftol=1e-13, gtol=1e-13, max_nfev=500,
        )  # fmt: skip
        if kind == REPROJECTION:
            ours = solve_pose(picture)
            assert ours is not None
            assert ours.chi_square == pytest.approx(2 * theirs.cost, rel=1e-6, abs=1e-9)
            position = ours.position_m
        else:
            paper = solve_coplanarity(picture)
            assert paper is not None
            assert paper.converged
            position = paper.position_m
        q = theirs.x
        t = translation_of(q) * view.scale_m
        np.testing.assert_allclose(position, -matrix_from_wxyz(q[:4] / np.linalg.norm(q[:4])).T @ t, atol=0.05)


def test_exact_pixels_give_the_exact_pose(rng: np.random.Generator) -> None:
    for _ in range(50):
        truth = pose_on_approach(rng)
        for pose in (solve_pose(seen(rng, truth, 0.0)), solve_coplanarity(seen(rng, truth, 0.0))):
            assert pose is not None
            np.testing.assert_allclose(pose.position_m, truth[0], atol=1e-3 * np.linalg.norm(truth[0]) / 100)


@pytest.mark.parametrize("sigma_px", [0.3, 1.0])
def test_it_converges_from_any_start(sigma_px: float, rng: np.random.Generator) -> None:
    """At least 99.9 % of arbitrary attitudes and places end in the best pose known: the one started from the truth."""
    worse = 0
    count = 1000
    for _ in range(count):
        truth = pose_on_approach(rng)
        picture = seen(rng, truth, sigma_px)
        start = rng.standard_normal(4)
        ours = solve_pose(picture, start=(start / np.linalg.norm(start), rng.uniform(-3000, 3000, 3)))
        best = solve_pose(picture, start=(quaternion(truth), truth[0]))
        assert best is not None
        worse += ours is None or ours.chi_square > best.chi_square + 1e-6
    assert worse <= count // 1000


def test_points_out_of_a_plane_and_more_than_four(rng: np.random.Generator) -> None:
    for _ in range(50):
        truth = pose_on_approach(rng, 500.0)
        points = np.vstack([RUNWAY.corners_m, rng.uniform([-60, -400, 0], [60, 0, 25], (5, 3))])
        pixels = project(points, *truth, LENS) + 0.3 * rng.standard_normal((9, 2))
        pose = solve_pose(
            PointCorrespondences(
                points_m=points, pixels=pixels, covariance_px2=np.broadcast_to(0.09 * np.eye(2), (9, 2, 2)), lens=LENS
            )
        )
        assert pose is not None
        assert pose.status is PoseStatus.OK
        assert error_of(pose, truth) @ np.linalg.solve(pose.covariance, error_of(pose, truth)) < chi2.isf(1e-6, 6)


@pytest.mark.parametrize("sigma_px", [0.3, 0.5, 1.0])
def test_the_covariance_is_consistent(sigma_px: float, rng: np.random.Generator) -> None:
    """NEES and the cost at the solution lie in their two-sided 99 % bounds."""
    nees, costs = [], []
    for _ in range(600):
        truth = pose_on_approach(rng)
        picture = seen(rng, truth, sigma_px)
        pose = solve_pose(picture)
        assert pose is not None
        e = error_of(pose, truth)
        nees.append(e @ np.linalg.solve(pose.covariance, e))
        costs.append(pose.chi_square)
    n = len(nees)
    low, high = chi2.ppf([0.005, 0.995], 6 * n) / n
    assert low < np.mean(nees) < high
    low, high = chi2.ppf([0.005, 0.995], 2 * n) / n
    assert low < np.mean(costs) < high


def test_far_away_the_covariance_counts_that_range_bends_the_rest(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 1800 m and 1 px NEES is in its 99.9 % band to second order, and above it to first order alone."""
    count = 1500
    shipped, plain = [], []
    for _ in range(count):
        truth = pose_on_approach(rng, 1800.0)
        picture = seen(rng, truth, 1.0)
        pose = solve_pose(picture)
        assert pose is not None
        e = error_of(pose, truth)
        shipped.append(e @ np.linalg.solve(pose.covariance, e))
        with monkeypatch.context() as patch:
            patch.setattr(pose_solver, "second_order", lambda *view: np.zeros((6, 6)))
            P = pose_covariance(picture, pose.position_m, pose.runway_from_camera_wxyz)
        plain.append(e @ np.linalg.solve(P, e))
    low, high = chi2.ppf([0.0005, 0.9995], 6 * count) / count
    assert low < np.mean(shipped) < high
    assert np.mean(plain) > high


def test_a_known_horizon_makes_the_pose_better_and_stays_consistent(rng: np.random.Generator) -> None:
    nees, ratios = [], []
    sigma = np.radians([0.1, 0.1])
    for _ in range(600):
        truth = pose_on_approach(rng, 1500.0)
        picture = seen(rng, truth, 0.5)
        turn = np.array([*(sigma * rng.standard_normal(2)), rng.uniform(-0.2, 0.2)])
        # truth = known · exp(δ) in camera_from_runway
        attitude = wxyz_from_matrix(rotation_from_vector(turn) @ truth[1])
        known = KnownAttitude(runway_from_camera_wxyz=attitude, sigma_rad=np.array([*sigma, np.inf]))
        alone, helped = solve_pose(picture), solve_pose(picture, known)
        assert alone is not None
        assert helped is not None
        e = error_of(helped, truth)
        nees.append(e @ np.linalg.solve(helped.covariance, e))
        ratios.append(abs(helped.range_m - np.linalg.norm(truth[0])) / abs(alone.range_m - np.linalg.norm(truth[0])))
    low, high = chi2.ppf([0.005, 0.995], 6 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high
    assert np.median(ratios) < 0.9


def test_the_dual_part_is_linear_in_the_attitude(rng: np.random.Generator) -> None:
    """With the right attitude the linear solve gives q_d = ½ t q_r."""
    truth = pose_on_approach(rng)
    view = SolverInput(seen(rng, truth, 0.0))
    real = quaternion_conjugate(quaternion(truth))
    t = -truth[1].T @ truth[0]
    for pairs in (SIX_PAIRS, FOUR_SIDES):
        dual = dual_part(real, RUNWAY.corners_m, pair_normals(view.rays, pairs), pairs)
        np.testing.assert_allclose(dual, from_pose(real, t)[4:], atol=1e-4)


def test_the_two_constraints_hold_at_the_truth(rng: np.random.Generator) -> None:
    truth = pose_on_approach(rng)
    view = SolverInput(seen(rng, truth, 0.0))
    r, _ = evaluate(COPLANARITY, view.dual(quaternion(truth), truth[0]), view, np.zeros((0, 4)))
    np.testing.assert_allclose(r, 0.0, atol=1e-6)


def test_corners_on_one_line_have_no_pose() -> None:
    points = np.array([[0.0, -k, 0.0] for k in range(4)])
    pixels = np.array([[600.0 + k, 400.0] for k in range(4)])
    covariance = np.broadcast_to(np.eye(2), (4, 2, 2))
    assert (
        solve_pose(PointCorrespondences(points_m=points, pixels=pixels, covariance_px2=covariance, lens=LENS)) is None
    )


def test_wrong_corners_are_reported(rng: np.random.Generator) -> None:
    """A corner that is 30 px off leaves a residual that noise does not."""
    truth = pose_on_approach(rng, 400.0)
    picture = seen(rng, truth, 0.3)
    picture.pixels[0] += [30.0, -10.0]
    pose = solve_pose(picture)
    assert pose is not None
    assert pose.status is PoseStatus.RESIDUAL


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_pixels_that_are_none_are_refused(bad: float, rng: np.random.Generator) -> None:
    picture = seen(rng, pose_on_approach(rng), 0.3)
    picture.pixels[2, 1] = bad
    with pytest.raises(ValueError, match="wanted pixels that this lens can see"):
        solve_pose(picture)


def test_three_corners_are_refused() -> None:
    with pytest.raises(ValueError, match="wanted"):
        PointCorrespondences(
            points_m=np.zeros((3, 3)), pixels=np.zeros((3, 2)), covariance_px2=np.zeros((3, 2, 2)), lens=LENS
        )
