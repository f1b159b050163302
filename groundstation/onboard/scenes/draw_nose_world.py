"""An approach as the nose camera sees it, drawn at random from its seed; each part from a stream of its own.

Seeds are those of drawn worlds: sets *train*, *validate* and *test* of a million each; snow and dusk occur in *test*
alone. From number 500,000 of each set on the ground is as bright as pavement or brighter (`bright_grounds`).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z
from groundstation.onboard.edges.camera_file import PoseNoise
from groundstation.onboard.edges.pose import Attitude
from groundstation.onboard.pose.inertial_filter import CameraMount, InertialConfig
from groundstation.onboard.pose.runway import rectangle
from groundstation.onboard.pose.simulated_approach import BODY_FROM_FORWARD_CAMERA, ApproachSetup
from groundstation.onboard.scenes.drawn_airfield import DrawnAirfield, draw_airfield
from groundstation.onboard.scenes.drawn_light import draw_light
from groundstation.onboard.scenes.flight import Sensors, StraightApproach
from groundstation.onboard.scenes.nose_flight import NoseFlight, navigation_poses, nose_flight
from groundstation.onboard.scenes.sequences import Sequence
from groundstation.simulation.world.world_sets import SEEDS_PER_SET, WorldSet, set_of

PICTURES = 24
# number in its set from which on a world has bright ground
BRIGHT_FROM = 500_000
_AIRFIELD, _LIGHT, _CAMERA, _FLIGHT, _SENSORS, _REPORTED = range(501, 507)
# in the first picture the runway is at least so wide at its near end, px
_LEAST_WIDTH_PX = 15.0
# the last picture is at least so far before the threshold, m
_LEAST_LEFT_M = 40.0
# share of approaches whose data sheet is written into the camera file, and of those without poses
_STATED, _WITHOUT_POSES = 0.5, 0.2
_UNITS = {
    "good": Sensors(
        attitude_bias_rad=math.radians(0.05), attitude_noise_rad=math.radians(0.02),
        position_bias_m=(0.3, 0.3, 0.3), position_noise_m=(0.03, 0.03, 0.03),
    ),
    "usual": Sensors(),
    "poor": Sensors(
        attitude_bias_rad=math.radians(0.8), attitude_noise_rad=math.radians(0.4),
        position_bias_m=(2.0, 2.0, 1.5), position_noise_m=(0.2, 0.2, 0.2),
    ),
}  # fmt: skip
# noise of force and rate over that of `InertialConfig`
_TIMES_USUAL = {"good": 0.3, "usual": 1.0, "poor": 3.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseWorld:
    """A drawn approach.

    Attributes
    ----------
    flight : over the drawn airfield in its light, with exact poses and inertial samples.
    mount : of the camera, roll, pitch, yaw.
    announced_m : width of the runway as it is announced.
    sensors : what the navigation's poses are off by. poses : whether there are any but the first.
    noise : of the poses as the camera file states it.
    factors : what was drawn, each as one of few words, for tables.
    """

    flight: NoseFlight
    mount: Attitude
    announced_m: float
    sensors: Sensors
    poses: bool
    noise: PoseNoise
    factors: dict[str, str]


def draw_nose_world(seed: int, pictures: int = PICTURES) -> NoseWorld:
    """Draw the approach of a seed; its set decides which grounds and lights may occur.

    Raises `ScenarioError` for a seed of no set.
    """
    everything = set_of(seed) is WorldSet.TEST

    def stream(number: int) -> np.random.Generator:
        return np.random.default_rng([seed, number])

    drawn = draw_airfield(stream(_AIRFIELD), snow=everything, bright=seed % SEEDS_PER_SET >= BRIGHT_FROM)
    light = draw_light(stream(_LIGHT), drawn.airfield.surfaces, dusk=everything, lamps=drawn.lamps)
    unit, sensors, noise, poses = _sensors(stream(_SENSORS))
    setup, mount = _setup(stream(_CAMERA), stream(_FLIGHT), drawn, pictures, _TIMES_USUAL[unit])
    sequence = Sequence(
        name="drawn", seed=seed, airfield=drawn.airfield, light=light.light, approach=StraightApproach()
    )
    unit, sensors, noise, poses = _sensors(stream(_SENSORS))
    near_px = drawn.airfield.width_m * float(setup.lens.focal_px[0]) / setup.from_m
    factors = {
        **drawn.factors,
        **light.factors,
        "poses": unit if poses else "pictures alone",
        "rate": f"{setup.camera_hz} Hz",
        "noise": "stated" if noise.attitude_rad is not None else "not stated",
        "runway's near end": _class_of(near_px, (40.0, 100.0), "px"),
    }
    return NoseWorld(
        flight=nose_flight(sequence, setup),
        mount=mount,
        announced_m=drawn.announced_m,
        sensors=sensors,
        poses=poses,
        noise=noise,
        factors=factors,
    )


def _setup(
    camera: np.random.Generator, flight: np.random.Generator, drawn: DrawnAirfield, pictures: int, worse: float
) -> tuple[ApproachSetup, Attitude]:
    """Return the camera, how it sits, and how it is flown with a unit so many times as noisy as usual."""
    usual = InertialConfig()
    roll, pitch, yaw = (math.radians(float(one)) for one in camera.normal((0.0, -3.0, 0.0), (1.0, 2.0, 1.5)))
    focal = float(camera.uniform(480.0, 1100.0))
    curved = float(camera.uniform(-0.15, 0.02)) if camera.uniform() < 0.5 else 0.0
    lens = Lens(
        image_size_px=(640, 480),
        focal_px=np.array([focal, focal * float(camera.normal(1.0, 0.002))]),
        principal_point_px=np.array([319.5, 239.5]) + camera.normal(0.0, 5.0, 2),
        distortion=np.array([curved, -0.3 * curved, 0.0, 0.0, 0.0]),
    )
    turned = rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)
    field, rate, speed = drawn.airfield, int(flight.choice([2, 5, 10])), float(flight.uniform(18.0, 38.0))
    duration = pictures / rate
    nearest = _LEAST_LEFT_M + speed * duration
    farthest = max(field.width_m * focal / _LEAST_WIDTH_PX, nearest + 1.0)
    setup = ApproachSetup(
        runway=rectangle(field.length_m, field.width_m),
        lens=lens,
        mount=CameraMount(
            camera_in_body_m=np.array([0.4, 0.0, 0.1]), body_from_camera=turned @ BODY_FROM_FORWARD_CAMERA
        ),
        config=replace(
            usual,
            force_noise=worse * usual.force_noise,
            rate_noise=worse * usual.rate_noise,
            force_bias_sigma=worse * usual.force_bias_sigma,
            rate_bias_sigma=worse * usual.rate_bias_sigma,
        ),
        from_m=min(float(np.exp(flight.uniform(math.log(nearest), math.log(farthest)))), 1200.0 + speed * duration),
        speed_m_s=speed,
        glide_deg=float(flight.uniform(2.7, 5.5)),
        duration_s=duration,
        camera_hz=rate,
        lost_s=(0.0, duration),
    )
    return setup, Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)


def _sensors(generator: np.random.Generator) -> tuple[str, Sensors, PoseNoise, bool]:
    """Return the unit in a word, what it is off by, what of that is stated, and whether it gives poses."""
    unit = list(_UNITS)[int(generator.integers(len(_UNITS)))]
    sensors, poses = _UNITS[unit], bool(generator.uniform() >= _WITHOUT_POSES)
    stated = bool(generator.uniform() < _STATED) and poses
    noise = PoseNoise(
        attitude_rad=sensors.attitude_noise_rad,
        position_m=sensors.position_noise_m[0],
        lasting_attitude_rad=sensors.attitude_bias_rad,
        lasting_height_m=sensors.position_bias_m[2],
    )
    return unit, sensors, noise if stated else PoseNoise(), poses


def _class_of(value: float, borders: tuple[float, float], unit: str) -> str:
    if value < borders[0]:
        return f"below {borders[0]:g} {unit}"
    return f"{borders[0]:g} to {borders[1]:g} {unit}" if value < borders[1] else f"above {borders[1]:g} {unit}"


def reported_poses(world: NoseWorld) -> tuple[FloatArray, FloatArray]:
    """Return the navigation's attitude (n, 3) in rad and the camera's place (n, 3) in m at each of n samples."""
    generator = np.random.default_rng([world.flight.sequence.seed, _REPORTED])
    return navigation_poses(world.flight, generator, world.sensors)
