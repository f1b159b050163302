"""Motion from pictures of the ground: exact for exact points, close for rendered pictures, refused by name."""

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from groundstation.geometry.rotation import rotation_from_vector
from groundstation.onboard.edges.pose import NoseCameraPose, intrinsic_matrix, pixels_from_points
from groundstation.onboard.edges.visual_odometry import (
    Motion,
    MotionConfig,
    NoMotion,
    VisualOdometry,
    composed,
    decompose,
    recover_motion,
)
from groundstation.onboard.scenes.sequences import NOSE_LENS, SEQUENCES, NoseFrame, Renderer
from tests.onboard.edges.seen import KAPPA, approach


def later(pose: NoseCameraPose, turn: tuple[float, float, float], move: tuple[float, float, float]) -> NoseCameraPose:
    return NoseCameraPose(
        threshold_from_camera=pose.threshold_from_camera @ rotation_from_vector(np.array(turn)),
        camera_threshold_m=pose.camera_threshold_m + np.array(move),
    )


def apart(a: NoseCameraPose, b: NoseCameraPose) -> tuple[float, float]:
    """Return metres and rad between two poses."""
    turn = cv2.Rodrigues(a.threshold_from_camera.T @ b.threshold_from_camera)[0]
    return float(np.linalg.norm(a.camera_threshold_m - b.camera_threshold_m)), float(np.linalg.norm(turn))


def seen_from(first: NoseCameraPose, second: NoseCameraPose, rng: np.random.Generator, noise: float, strays: int):
    ground = np.column_stack([rng.uniform(-60, 60, 300), rng.uniform(-100, 110, 300), np.zeros(300)])
    a, b = pixels_from_points(first, KAPPA, ground), pixels_from_points(second, KAPPA, ground)
    a, b = a + noise * rng.normal(size=a.shape), b + noise * rng.normal(size=b.shape)
    if strays:
        b[:strays] += rng.uniform(-60, 60, (strays, 2))
    return a, b


def test_the_decomposition_of_an_exact_homography_is_the_motion(rng: np.random.Generator) -> None:
    first = approach()
    second = later(first, (0.01, -0.02, 0.03), (0.5, -6.0, -0.4))
    a, b = seen_from(first, second, rng, 0.0, 0)
    homography, _ = cv2.findHomography(a, b)
    motion = decompose(homography, a, first, KAPPA)
    assert isinstance(motion, Motion)
    metres, turn = apart(composed(first, motion), second)
    assert metres < 1e-3
    assert turn < 1e-5


def test_motion_survives_noise_and_strays(rng: np.random.Generator) -> None:
    first = approach()
    second = later(first, (0.01, -0.02, 0.03), (0.1, -2.2, -0.15))
    a, b = seen_from(first, second, rng, 0.3, 80)
    motion = recover_motion(a, b, first, KAPPA, MotionConfig())
    assert isinstance(motion, Motion)
    metres, turn = apart(composed(first, motion), second)
    assert metres < 0.3
    assert turn < math.radians(0.2)


def test_no_motion_has_a_name(rng: np.random.Generator) -> None:
    few = rng.uniform(200, 400, (10, 2))
    assert recover_motion(few, few, approach(), KAPPA, MotionConfig()) is NoMotion.FEW_MATCHES
    many = rng.uniform(200, 400, (60, 2)), rng.uniform(200, 400, (60, 2))
    assert recover_motion(*many, approach(), KAPPA, MotionConfig()) is NoMotion.NO_HOMOGRAPHY


@cache
def rendered() -> tuple[NoseFrame, ...]:
    """Six pictures of an approach."""
    sequence = SEQUENCES[0]
    return tuple(Renderer(replace(sequence, approach=replace(sequence.approach, frames=6))).frames())


@pytest.mark.parametrize("refine", [True, False], ids=["refined", "the paper's"])
def test_poses_from_rendered_pictures_stay_near_the_truth(refine: bool) -> None:
    """After 0.5 s and 11 m: within 1 m and 0.5°; the decomposition alone only has to give a motion at all."""
    kappa, frames = intrinsic_matrix(NOSE_LENS), rendered()
    odometry = VisualOdometry(kappa, frames[0].truth, MotionConfig(refine=refine))
    poses = [odometry.step(frame.t_s, frame.image).pose for frame in frames]
    metres, turn = apart(poses[-1], frames[-1].truth)
    if refine:
        assert not odometry.failures
        assert metres < 1.0
        assert turn < math.radians(0.5)
    else:
        assert len(odometry.failures) < 5
        assert np.isfinite(metres)


def test_a_picture_without_motion_gets_the_last_rates_for_its_own_interval() -> None:
    """Expected: three times the motion in three times the time, its size as sigmas, and the failure told."""
    frames = rendered()
    odometry = VisualOdometry(intrinsic_matrix(NOSE_LENS), frames[0].truth)
    first, second = (odometry.step(frame.t_s, frame.image) for frame in frames[:2])
    assert first.failure is second.failure is None
    assert first.shift_m == second.shift_m == 0.0
    interval_s = frames[1].t_s - frames[0].t_s
    blank = np.full_like(frames[0].image, 128)
    lost = odometry.step(frames[1].t_s + 3.0 * interval_s, blank)
    assert lost.failure is NoMotion.FEW_MATCHES
    assert odometry.failures == [NoMotion.FEW_MATCHES]
    metres, turn = apart(first.pose, second.pose)
    assert apart(second.pose, lost.pose)[0] == pytest.approx(3.0 * metres)
    assert (lost.shift_m, lost.turn_rad) == pytest.approx((3.0 * metres, 3.0 * turn))


def test_without_any_motion_the_aircraft_may_have_gone_far() -> None:
    odometry = VisualOdometry(KAPPA, approach())
    blank = np.full((480, 640, 3), 128, np.uint8)
    odometry.step(0.0, blank)
    lost = odometry.step(0.2, blank)
    assert lost.shift_m == pytest.approx(10.0)
    assert lost.turn_rad == pytest.approx(math.radians(2.0))
