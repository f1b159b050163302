"""A whole recording of a nose camera: pictures of a rendered airfield along a flight, with its inertial samples."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_y, wxyz_from_matrix
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.pose.inertial_filter import CameraMount, InertialConfig
from groundstation.onboard.pose.runway import Runway, rectangle
from groundstation.onboard.pose.simulated_approach import (
    BODY_FROM_FORWARD_CAMERA,
    RUNWAY_FROM_LEVEL_BODY,
    ApproachSetup,
    SimulatedApproach,
    drawn_attitudes,
    motion_of,
)
from groundstation.onboard.scenes.flight import Sensors
from groundstation.onboard.scenes.sequences import NOSE_LENS, Renderer, Sequence

CAMERA_PITCH_DEG = -3.0
# the path meets the ground so far behind the threshold
AIM_M = 60.0
# of the path's waves about the glide path, 1 sigma
GUST_M = (0.6, 0.4, 0.4)
_WAVES = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseFlight:
    """A flight over a sequence's airfield in its light.

    Attributes
    ----------
    sequence : airfield, light and the seed of the pictures' noise; its own approach is not used.
    setup : camera, mount and inertial unit. motion : the exact flight and its samples.
    """

    sequence: Sequence
    setup: ApproachSetup
    motion: SimulatedApproach

    @property
    def runway(self) -> Runway:
        """Return the airfield's runway."""
        return self.setup.runway

    @property
    def frames(self) -> range:
        """Return the samples at which a picture is taken."""
        return range(0, len(self.motion.t_s), self.setup.imu_hz // self.setup.camera_hz)

    def pose(self, sample: int) -> NoseCameraPose:
        """Return the camera's exact pose at a sample."""
        R = self.motion.runway_from_body[sample]
        return NoseCameraPose(
            threshold_from_camera=R @ self.setup.mount.body_from_camera,
            camera_threshold_m=self.motion.position_m[sample] + R @ self.setup.mount.camera_in_body_m,
        )

    def pictures(self) -> Iterator[tuple[int, ImageArray]]:
        """Yield the number of the sample and the picture (h, w, 3) uint8 BGR, in order."""
        renderer = Renderer(self.sequence, self.setup.lens)
        for sample in self.frames:
            yield sample, renderer.picture(self.pose(sample), sample)


def nose_setup(
    sequence: Sequence, duration_s: float = 13.0, from_m: float = 330.0, camera_hz: int = 10
) -> ApproachSetup:
    """Return a small UAV's approach to a sequence's runway: 22 m/s, 4°, a camera that looks 3° down."""
    field = sequence.airfield
    return ApproachSetup(
        runway=rectangle(field.length_m, field.width_m),
        lens=NOSE_LENS,
        mount=CameraMount(
            camera_in_body_m=np.array([0.4, 0.0, 0.1]),
            body_from_camera=rotation_y(np.radians(CAMERA_PITCH_DEG)) @ BODY_FROM_FORWARD_CAMERA,
        ),
        config=InertialConfig(),
        from_m=from_m,
        speed_m_s=22.0,
        glide_deg=4.0,
        duration_s=duration_s,
        camera_hz=camera_hz,
        lost_s=(0.0, duration_s),
    )


def nose_flight(sequence: Sequence, setup: ApproachSetup | None = None) -> NoseFlight:
    """Return a flight drawn from the sequence's seed."""
    chosen = setup or nose_setup(sequence)
    rng = np.random.default_rng([sequence.seed, 77])
    n = round(chosen.duration_s * chosen.imu_hz)
    t = np.asarray(np.arange(n) / chosen.imu_hz, dtype=np.float64)
    runway_from_body = drawn_attitudes(t, rng)
    shift, acceleration = _gusts(t, rng)
    glide = np.radians(chosen.glide_deg)
    velocity = chosen.speed_m_s * np.array([0.0, -np.cos(glide), -np.sin(glide)])
    start = np.array([0.0, chosen.from_m, (chosen.from_m + AIM_M) * np.tan(glide)]) + shift[0]
    velocity = velocity + (shift[1] - shift[0]) * chosen.imu_hz - 0.5 / chosen.imu_hz * acceleration[0]
    flown = motion_of(chosen, t, start, velocity, acceleration, runway_from_body, rng)
    return NoseFlight(sequence=sequence, setup=chosen, motion=flown)


def _gusts(t: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return the path's shift (n, 3) in m and its acceleration (n, 3): waves of 3 to 8 s."""
    periods, phases = rng.uniform(3.0, 8.0, (_WAVES, 3)), rng.uniform(0.0, 2.0 * np.pi, (_WAVES, 3))
    size = np.array(GUST_M) / np.sqrt(0.5 * _WAVES)
    turn = 2.0 * np.pi / periods
    angle = turn * t[:, None, None] + phases
    shift = (size * np.sin(angle)).sum(axis=1)
    return np.asarray(shift), np.asarray((-size * turn**2 * np.sin(angle)).sum(axis=1))


def attitude_of(runway_from_body_wxyz: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (3,) in rad, yaw from the landing direction, clockwise seen from above."""
    M = RUNWAY_FROM_LEVEL_BODY.T @ matrix_from_wxyz(runway_from_body_wxyz)
    pitch = -math.asin(float(np.clip(M[2, 0], -1.0, 1.0)))
    return np.array([math.atan2(M[2, 1], M[2, 2]), pitch, math.atan2(M[1, 0], M[0, 0])])


def navigation_poses(
    flight: NoseFlight, rng: np.random.Generator, sensors: Sensors | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return a navigation's pose at each sample: attitude (n, 3) in rad and the camera's place (n, 3) in m."""
    sensors, motion = sensors or Sensors(), flight.motion
    attitude = np.array([attitude_of(wxyz_from_matrix(R)) for R in motion.runway_from_body])
    attitude += rng.normal(0.0, sensors.attitude_bias_rad, 3)
    attitude += rng.normal(0.0, sensors.attitude_noise_rad, attitude.shape)
    place = motion.position_m + motion.runway_from_body @ flight.setup.mount.camera_in_body_m
    place = place + rng.normal(0.0, sensors.position_bias_m)
    return attitude, place + rng.normal(0.0, sensors.position_noise_m, place.shape)
