"""A simulated approach: exact trajectory, inertial samples, corner pixels; for tests and studies of the navigator."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z
from groundstation.geometry.rotation_series import (
    matrices_from_vectors,
    matrices_from_wxyz,
    rotation_vectors,
    wxyz_from_matrices,
)
from groundstation.onboard.pose.inertial_filter import CameraMount, ImuSample, InertialConfig
from groundstation.onboard.pose.inertial_kernel import GRAVITY_M_S2
from groundstation.onboard.pose.pose_solver import PointCorrespondences
from groundstation.onboard.pose.runway import Runway, rectangle

# a body flying level towards the runway: x forward is −y, y right is −x, z down
RUNWAY_FROM_LEVEL_BODY = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# a camera looking forward: x right is body y, y down is body z, z forward is body x
BODY_FROM_FORWARD_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_GUSTS = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ApproachSetup:
    """The flight and its sensors.

    Attributes
    ----------
    from_m, speed_m_s, glide_deg, duration_s : where it starts along the runway, and how it flies.
    imu_hz, camera_hz : rates; camera_hz divides imu_hz.
    corner_sigma_px : noise of each corner coordinate.
    lost_s : from when to when no corner is seen.
    """

    runway: Runway
    lens: Lens
    mount: CameraMount
    config: InertialConfig
    from_m: float = 1500.0
    speed_m_s: float = 25.0
    glide_deg: float = 3.5
    duration_s: float = 54.0
    imu_hz: int = 100
    camera_hz: int = 10
    corner_sigma_px: float = 0.5
    lost_s: tuple[float, float] = (25.0, 45.0)


def default_setup(corner_sigma_px: float = 0.5, lost_s: tuple[float, float] = (25.0, 45.0)) -> ApproachSetup:
    """Return a small UAV's approach to a runway of 900 m by 30 m with a camera of 1280 by 960 px."""
    return ApproachSetup(
        runway=rectangle(900.0, 30.0),
        lens=Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([1400.0, 1400.0]),
            principal_point_px=np.array([639.5, 479.5]),
            distortion=np.zeros(5),
        ),
        mount=CameraMount(
            camera_in_body_m=np.array([0.4, 0.0, 0.1]),
            body_from_camera=rotation_y(np.radians(-3.0)) @ BODY_FROM_FORWARD_CAMERA,
        ),
        config=InertialConfig(),
        corner_sigma_px=corner_sigma_px,
        lost_s=lost_s,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedApproach:
    """One flight: truth at every inertial sample, the samples, and the camera's pixels at some of them.

    ``position_m``, ``velocity_m_s`` (n, 3), ``runway_from_body`` (n, 3, 3), ``force_bias``, ``rate_bias`` (n, 3);
    ``seen`` has an entry for each sample with a picture that shows all corners.
    """

    t_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray
    runway_from_body: FloatArray
    force_bias: FloatArray
    rate_bias: FloatArray
    samples: list[ImuSample]
    seen: dict[int, PointCorrespondences]


def fly(setup: ApproachSetup, rng: np.random.Generator) -> SimulatedApproach:
    """Simulate one approach; the trajectory's gusts, the biases and all noise are drawn from ``rng``."""
    n = round(setup.duration_s * setup.imu_hz)
    t = np.asarray(np.arange(n) / setup.imu_hz, dtype=np.float64)
    runway_from_body = drawn_attitudes(t, rng)
    acceleration = _acceleration(t, rng)
    glide = np.radians(setup.glide_deg)
    velocity = setup.speed_m_s * np.array([0.0, -np.cos(glide), -np.sin(glide)])
    start = np.array([0.0, setup.from_m, setup.from_m * np.tan(glide)])
    return motion_of(setup, t, start, velocity, acceleration, runway_from_body, rng)


def motion_of(
    setup: ApproachSetup,
    t: FloatArray,
    start_m: FloatArray,
    start_m_s: FloatArray,
    acceleration: FloatArray,
    runway_from_body: FloatArray,
    rng: np.random.Generator,
) -> SimulatedApproach:
    """Return the flight under accelerations (n, 3) from a place (3,) and a velocity (3,), with samples and corners.

    ``t`` (n,) are the inertial samples' times, ``runway_from_body`` (n, 3, 3); biases and noise are drawn from ``rng``.
    """
    n, dt = len(t), 1.0 / setup.imu_hz
    velocity = np.empty((n, 3))
    velocity[0] = start_m_s
    velocity[1:] = velocity[0] + np.cumsum(acceleration[:-1] * dt, axis=0)
    position = np.empty((n, 3))
    position[0] = start_m
    steps = dt * velocity[:-1] + 0.5 * dt * dt * acceleration[:-1]
    position[1:] = position[0] + np.cumsum(steps, axis=0)
    force_bias, rate_bias = drawn_biases(setup.config, n, dt, rng)
    samples = inertial_samples(setup.config, t, runway_from_body, acceleration, (force_bias, rate_bias), rng)
    every = setup.imu_hz // setup.camera_hz
    seen = {}
    for k in range(0, n, every):
        if setup.lost_s[0] <= t[k] < setup.lost_s[1]:
            continue
        view = see_runway(setup, position[k], runway_from_body[k], rng)
        if view is not None:
            seen[k] = view
    return SimulatedApproach(
        t_s=t,
        position_m=position,
        velocity_m_s=velocity,
        runway_from_body=runway_from_body,
        force_bias=force_bias,
        rate_bias=rate_bias,
        samples=samples,
        seen=seen,
    )


def see_runway(
    setup: ApproachSetup, position_m: FloatArray, runway_from_body: FloatArray, rng: np.random.Generator
) -> PointCorrespondences | None:
    """Return the noisy corner pixels; None where a corner is outside the picture or behind."""
    camera = position_m + runway_from_body @ setup.mount.camera_in_body_m
    x = (setup.runway.corners_m - camera) @ (runway_from_body @ setup.mount.body_from_camera)
    if (x[:, 2] < 1.0).any():
        return None
    exact = setup.lens.focal_px * x[:, :2] / x[:, 2:] + setup.lens.principal_point_px
    if (exact < 0).any() or (exact > np.array(setup.lens.image_size_px) - 1.0).any():
        return None
    sigma = setup.corner_sigma_px
    return PointCorrespondences(
        points_m=setup.runway.corners_m,
        pixels=exact + sigma * rng.standard_normal(exact.shape),
        covariance_px2=np.broadcast_to(sigma**2 * np.eye(2), (4, 2, 2)),
        lens=setup.lens,
    )


def waves(t: FloatArray, periods_s: tuple[float, float], size: float, rng: np.random.Generator) -> FloatArray:
    """Return a sum of sines (n,) with root mean square ``size``."""
    periods = rng.uniform(*periods_s, _GUSTS)
    phases = rng.uniform(0, 2 * np.pi, _GUSTS)
    waves = np.sin(2 * np.pi * t[:, None] / periods + phases).sum(axis=1)
    return np.asarray(size * waves / np.sqrt(0.5 * _GUSTS))


def drawn_attitudes(t: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return runway_from_body (n, 3, 3) of a gusty approach with a crab angle."""
    crab = rng.uniform(-3.0, 3.0)
    yaw = np.radians(crab + waves(t, (4.0, 12.0), 1.0, rng))
    pitch = np.radians(1.0 + waves(t, (2.0, 8.0), 1.0, rng))
    roll = np.radians(waves(t, (2.0, 8.0), 3.0, rng))
    turns = [rotation_z(y) @ rotation_y(p) @ rotation_x(r) for y, p, r in zip(yaw, pitch, roll, strict=True)]
    return np.asarray(RUNWAY_FROM_LEVEL_BODY @ np.array(turns))


def _acceleration(t: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the acceleration (n, 3) of gusts; its mean is taken off, so that the approach stays one."""
    a = np.stack([waves(t, (4.0, 10.0), size, rng) for size in (0.4, 0.3, 0.4)], axis=1)
    return np.asarray(a - a.mean(axis=0))


def drawn_biases(config: InertialConfig, n: int, dt: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return the biases of force and rate (n, 3) of one unit, as the configuration's sigmas and walks have them."""
    walks = []
    for sigma, walk in (
        (config.force_bias_sigma, config.force_bias_walk),
        (config.rate_bias_sigma, config.rate_bias_walk),
    ):
        steps = walk * np.sqrt(dt) * rng.standard_normal((n, 3))
        steps[0] = sigma * rng.standard_normal(3)
        walks.append(np.cumsum(steps, axis=0))
    return walks[0], walks[1]


def inertial_samples(
    config: InertialConfig,
    t: FloatArray,
    runway_from_body: FloatArray,
    acceleration: FloatArray,
    biases: tuple[FloatArray, FloatArray],
    rng: np.random.Generator,
) -> list[ImuSample]:
    """Return samples that, without bias and noise, would reproduce the trajectory exactly."""
    dt = float(t[1] - t[0])
    gravity = np.array([0.0, 0.0, GRAVITY_M_S2])
    force_noise = config.force_noise / np.sqrt(dt) * rng.standard_normal((len(t), 3))
    rate_noise = config.rate_noise / np.sqrt(dt) * rng.standard_normal((len(t), 3))
    body_from_runway = runway_from_body.transpose(0, 2, 1)
    rate = rotation_vectors(body_from_runway[:-1] @ runway_from_body[1:]) / dt
    # after the last sample it turns as before it
    rate = np.vstack([rate, rate[-1:]])
    half = matrices_from_wxyz(wxyz_from_matrices(runway_from_body)) @ matrices_from_vectors(0.5 * dt * rate)
    force = (half.transpose(0, 2, 1) @ (acceleration + gravity)[:, :, None])[:, :, 0] + biases[0] + force_noise
    turning = rate + biases[1] + rate_noise
    return [ImuSample(t_s=float(t[k]), force_m_s2=force[k], rate_rad_s=turning[k]) for k in range(len(t))]
