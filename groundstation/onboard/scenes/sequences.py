"""Sequences of rendered nose-camera pictures, from a seed each, with exact truth."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.camera import Lens
from groundstation.onboard.edges.pose import NoseCameraPose, intrinsic_matrix, nose_pose, pixels_from_points
from groundstation.onboard.scenes.flight import PoseSeries, Sensors, StraightApproach, fly, measured
from groundstation.onboard.scenes.ground import Airfield, Surfaces, edge_lamps, patches
from groundstation.onboard.scenes.ground_kernel import GroundTexture, add_lamps, render_ground
from groundstation.onboard.scenes.light import DAY, DUSK, HAZE, NIGHT, Light

NOSE_LENS = Lens(
    image_size_px=(640, 480),
    focal_px=np.array([620.0, 620.0]),
    principal_point_px=np.array([319.5, 239.5]),
    distortion=np.zeros(5),
)
_GAMMA = 1.0 / 2.2
_SAND = Surfaces(
    ground=(0.62, 0.52, 0.36), ground_other=(0.52, 0.43, 0.29), runway=(0.20, 0.20, 0.21),
    runway_end=(0.36, 0.35, 0.33), taxiway=(0.26, 0.25, 0.25), road=(0.24, 0.23, 0.23),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Sequence:
    """One approach to render: airfield, light, flight, sensors, and the seed of everything random."""

    name: str
    seed: int
    airfield: Airfield
    light: Light
    approach: StraightApproach
    sensors: Sensors = field(default_factory=Sensors)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseFrame:
    """A picture (h, w, 3) uint8 BGR with its number, time, exact pose and the sensors' measurement of it."""

    index: int
    t_s: float
    image: ImageArray
    truth: NoseCameraPose
    reported: NoseCameraPose


_ROAD = math.radians(90.0)
# what lamps' places are drawn of, next to the seeds of all else
_LAMPS = 1
SEQUENCES: tuple[Sequence, ...] = (
    Sequence(
        name="day",
        seed=101,
        airfield=Airfield(roads=((-46.0, -150.0, math.radians(2.0), 8.0), (0.0, 70.0, _ROAD + 0.15, 8.0))),
        light=DAY,
        approach=StraightApproach(start_y_m=280.0),
    ),
    Sequence(
        name="haze, sand",
        seed=202,
        airfield=Airfield(
            roads=((40.0, 0.0, math.radians(-4.0), 9.0),),
            surfaces=_SAND,
            taxiway_side=-1,
            edge_stripe_m=0.3,
            width_m=22.0,
        ),
        light=HAZE,
        approach=StraightApproach(start_y_m=210.0, start_x_m=-6.0, crab_rad=math.radians(-4.0)),
    ),
    Sequence(
        name="dusk, turbulence",
        seed=303,
        airfield=Airfield(roads=((-38.0, 0.0, math.radians(1.0), 7.0),)),
        light=DUSK,
        approach=StraightApproach(
            start_y_m=190.0, gust_rad=(math.radians(4.0), math.radians(2.0), math.radians(2.0)), gust_s=0.35
        ),
    ),
    Sequence(
        name="night",
        seed=404,
        airfield=Airfield(roads=((-50.0, 0.0, math.radians(3.0), 8.0),)),
        light=NIGHT,
        approach=StraightApproach(start_y_m=220.0, start_x_m=5.0),
    ),
    Sequence(
        name="day, short final",
        seed=505,
        airfield=Airfield(
            taxiway_side=-1, roads=((36.0, -100.0, math.radians(-1.5), 8.0), (0.0, 25.0, _ROAD, 6.0)), edge_stripe_m=0.0
        ),
        light=replace(DAY, cloud_shadow=0.5),
        approach=StraightApproach(
            start_y_m=130.0, start_x_m=-2.0, gust_rad=(math.radians(3.0), math.radians(1.5), math.radians(1.5))
        ),
    ),
    # light and pavement that change along the runway, from darker than the grass to lighter: one mean does not fit
    Sequence(
        name="day, broken cloud",
        seed=606,
        airfield=Airfield(
            roads=((44.0, -60.0, math.radians(-2.0), 8.0), (0.0, 55.0, _ROAD - 0.1, 7.0)),
            taxiway_side=-1,
            repair=(0.3, 2.2),
            repair_tint=0.0,
        ),
        light=replace(DAY, cloud_shadow=0.75, cloud_m=(110.0, 60.0)),
        approach=StraightApproach(start_y_m=200.0, start_x_m=4.0, crab_rad=math.radians(-3.0)),
    ),
)


def varied(
    sequence: Sequence, seed: int, stripe_inset_m: float | None = 0.5, lamps_out_m: float | None = 1.0
) -> Sequence:
    """Return another approach in the same light: airfield, roads, flight path and everything random drawn again.

    Painted side lines lie ``stripe_inset_m`` inside the edges; None: on the edge, half a metre inside, or anywhere to
    one metre, drawn too. Lamps stand ``lamps_out_m`` outside them; None: 0.8 to 3 m, drawn too.
    """
    draw = np.random.default_rng([seed, sequence.seed])
    field, approach, side = sequence.airfield, sequence.approach, float(draw.choice([-1.0, 1.0]))
    across = (float(draw.uniform(-30.0, 30.0)), float(draw.uniform(15.0, 90.0)), _ROAD + float(draw.normal(0.0, 0.15)))
    side_road = (
        -side * float(draw.uniform(32.0, 60.0)),
        float(draw.uniform(-200.0, 0.0)),
        float(draw.normal(0.0, 0.05)),
    )
    drawn = replace(
        sequence,
        seed=seed,
        airfield=replace(
            field,
            width_m=float(draw.uniform(16.0, 24.0)),
            length_m=float(draw.uniform(420.0, 600.0)),
            end_m=float(draw.choice([0.0, 50.0])),
            edge_stripe_m=float(draw.choice([0.0, 0.3, 0.45])),
            bars=int(draw.integers(3, 6)),
            taxiway_side=int(side),
            roads=((*side_road, float(draw.uniform(6.0, 10.0))), (*across, float(draw.uniform(6.0, 9.0)))),
        ),
        approach=replace(
            approach,
            start_y_m=approach.start_y_m + float(draw.uniform(-20.0, 40.0)),
            start_x_m=float(draw.normal(0.0, 4.0)),
            crab_rad=float(draw.normal(0.0, math.radians(3.0))),
        ),
    )
    if stripe_inset_m is None:
        stripe_inset_m = float(draw.choice([0.0, 0.5, draw.uniform(0.0, 1.0)]))
    if lamps_out_m is None:
        # seeds of their own, so that nothing else that is drawn depends on whether these are
        lamps_out_m = float(np.random.default_rng([seed, sequence.seed, _LAMPS]).uniform(0.8, 3.0))
    return replace(drawn, airfield=replace(drawn.airfield, edge_stripe_inset_m=stripe_inset_m, lamps_out_m=lamps_out_m))


class Renderer:
    """Pictures of one sequence through one lens, frame by frame; the same for the same seed."""

    def __init__(self, sequence: Sequence, lens: Lens = NOSE_LENS) -> None:
        self.sequence = sequence
        self.lens = lens
        generator = np.random.default_rng(sequence.seed)
        self.flown: PoseSeries = fly(sequence.approach, generator)
        self.reported: PoseSeries = measured(self.flown, sequence.sensors, generator)
        self._patches = patches(sequence.airfield, generator)
        self._lamps = edge_lamps(sequence.airfield)
        self._rays = pixel_rays(lens)

    def frames(self) -> Iterator[NoseFrame]:
        """Yield every frame in order."""
        for index in range(self.flown.t_s.size):
            yield self.frame(index)

    def pose(self, index: int, flown: PoseSeries | None = None) -> NoseCameraPose:
        """Return the exact pose of a frame, or that of another account of the flight."""
        source = flown or self.flown
        return nose_pose(source.position_threshold_m[index], source.attitude(index))

    def frame(self, index: int) -> NoseFrame:
        """Render one frame."""
        truth = self.pose(index)
        return NoseFrame(
            index=index,
            t_s=float(self.flown.t_s[index]),
            image=self.picture(truth, index),
            truth=truth,
            reported=self.pose(index, self.reported),
        )

    def picture(self, pose: NoseCameraPose, noise_seed: int = 0) -> ImageArray:
        """Render what is seen from a pose, (h, w, 3) uint8 BGR."""
        field, light = self.sequence.airfield, self.sequence.light
        w, h = self.lens.image_size_px
        linear = np.empty((h, w, 3))
        base = np.array([field.surfaces.ground, field.surfaces.ground_other])
        rotation = np.ascontiguousarray(pose.threshold_from_camera)
        render_ground(
            self._rays, rotation, pose.camera_threshold_m, self._patches, base, light.illumination(),
            GroundTexture(field.field_m, field.grain), self.sequence.seed, linear,
        )  # fmt: skip
        if light.lamp_power > 0.0:
            self._light_lamps(linear, pose, light)
        linear = np.asarray(cv2.GaussianBlur(linear, (0, 0), light.blur_px), np.float64)
        generator = np.random.default_rng([self.sequence.seed, noise_seed])
        return _exposed(linear, light, generator)

    def _light_lamps(self, linear: FloatArray, pose: NoseCameraPose, light: Light) -> None:
        pixels = pixels_from_points(pose, intrinsic_matrix(self.lens), self._lamps[:, :3])
        ahead = np.isfinite(pixels).all(axis=1)
        distances = np.linalg.norm(self._lamps[:, :3] - pose.camera_threshold_m, axis=1)
        haze = np.exp(-distances / light.visibility_m)
        colours = self._lamps[:, 3:] * haze[:, None]
        add_lamps(linear, pixels[ahead], distances[ahead], colours[ahead], light.lamp_power, 0.8)


def pixel_rays(lens: Lens) -> FloatArray:
    """Return the normalised ray of each pixel, (h, w, 2)."""
    w, h = lens.image_size_px
    grid = np.stack(np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h, dtype=np.float64)), axis=-1)
    rays = cv2.undistortPoints(grid.reshape(-1, 1, 2), intrinsic_matrix(lens), lens.distortion)
    return np.ascontiguousarray(rays.reshape(h, w, 2), dtype=np.float64)


def _exposed(linear: FloatArray, light: Light, generator: np.random.Generator) -> ImageArray:
    """Return the camera's 8 bits, BGR: exposure, a soft shoulder, gamma, noise."""
    # in place: each array of a picture is 7 MB, and new ones take longer than what is computed into them
    grey = light.gain * linear
    shoulder = 0.25 * grey
    shoulder *= grey
    shoulder += 1.0
    grey /= np.sqrt(shoulder, out=shoulder)
    np.clip(grey, 0.0, 1.0, out=grey)
    grey **= _GAMMA
    grey *= 255.0
    sigma = np.divide(grey, 255.0, out=shoulder)
    np.sqrt(sigma, out=sigma)
    sigma *= light.shot_noise
    sigma += light.noise
    sigma *= generator.standard_normal(grey.shape)
    grey += sigma
    np.clip(np.rint(grey, out=grey), 0, 255, out=grey)
    return np.ascontiguousarray(grey.astype(np.uint8)[:, :, ::-1])
