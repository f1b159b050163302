"""A composite as plain numbers: frames of a clip, camera and light, and what flies there."""

from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.bank.composites.clip_sets import require_clip_of
from groundstation.bank.composites.segment_view import SegmentView
from groundstation.geometry.camera import Lens
from groundstation.rig.rig import Station
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.parameter_checks import require, require_within
from groundstation.simulation.standard_cases import standard_station
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_spec import BirdSpec
from groundstation.simulation.world.world_sets import set_of

RATE_HZ = 30.0
# height of the camera above the ground; drawn bodies have no shadow there
EYE_HEIGHT_M = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CompositeCamera:
    """The virtual camera of a clip, with its optical axis along +y of the runway frame.

    Attributes
    ----------
    focal_px : of its lens.
    tilt_rad : of its axis in the segment's first frame, upwards.
    exposure_s : how long a frame gathers light.
    """

    focal_px: float
    tilt_rad: float
    exposure_s: float

    def station(self, size_px: tuple[int, int]) -> Station:
        """Return it as a station with pictures of (w, h) px."""
        station = standard_station("clip", 0.0)
        lens = Lens(
            image_size_px=size_px,
            focal_px=np.full(2, self.focal_px),
            principal_point_px=0.5 * (np.array(size_px) - 1.0),
            distortion=np.zeros(5),
        )
        return replace(station, ptu_position_m=np.array([0.0, 0.0, EYE_HEIGHT_M]), lens=lens, readout_s=0.0)

    def heads(self, shifts_px: FloatArray) -> tuple[HeadMotion, ...]:
        """Return orientation and rates of the camera in each frame, from the scene's shift (n, 2) px."""
        angles = np.arctan(shifts_px / self.focal_px)
        rates = np.gradient(angles, 1.0 / RATE_HZ, axis=0) if len(angles) > 1 else np.zeros_like(angles)
        # the scene moves right when the camera turns left, and down when it turns up
        return tuple(
            HeadMotion(
                pan_rad=float(a[0]),
                tilt_rad=self.tilt_rad + float(a[1]),
                pan_rate_rad_s=float(r[0]),
                tilt_rate_rad_s=float(r[1]),
            )
            for a, r in zip(angles, rates, strict=True)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CompositeSun:
    """Parameters of the light on the drawn bodies that cannot be measured in the clip.

    Attributes
    ----------
    azimuth_rad : of the sun, from +y towards +x.
    elevation_rad : of the sun.
    strength : light on a white skin that faces it, in multiples of a clear sky's; an overcast one has none.
    ambient : mean light of the whole sky in multiples of what the clip shows of it.
    visibility_m : distance at which haze leaves 2 % of a contrast.
    """

    azimuth_rad: float
    elevation_rad: float
    strength: float
    ambient: float
    visibility_m: float

    @property
    def direction_runway(self) -> FloatArray:
        """The unit vector (3,) towards the sun."""
        level = np.cos(self.elevation_rad)
        return np.array(
            [level * np.sin(self.azimuth_rad), level * np.cos(self.azimuth_rad), np.sin(self.elevation_rad)]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CompositeSpec:
    """One drawn sequence over a clip; its seed's set is the clip's.

    Attributes
    ----------
    seed : of the draw, and of the noise.
    clip : name of the clip.
    first, last : its frames, both included; time is 0 in the first.
    camera, sun : how it is seen.
    airframe, path : the aircraft, and the path of its nose, runway frame.
    birds : that fly with it.
    """

    seed: int
    clip: str
    first: int
    last: int
    camera: CompositeCamera
    sun: CompositeSun
    airframe: AirframeSpec
    path: ArcPath
    birds: tuple[BirdSpec, ...] = ()

    def __post_init__(self) -> None:
        require_clip_of(set_of(self.seed), self.clip)
        fits = 0 <= self.first <= self.last
        require(fits, "CompositeSpec: first, last", got=f"{self.first}, {self.last}", wanted="0 or later, and in order")
        require_within(self.camera, {"focal_px": (50.0, 50_000.0), "exposure_s": (1e-5, 1.0 / RATE_HZ)})


def horizon_tilt_rad(view: SegmentView, focal_px: float) -> float | None:
    """Return the tilt at which the horizon is where a clip's sky ends; None where it shows no ground."""
    if view.horizon_row is None:
        return None
    middle = 0.5 * (view.size_px[1] - 1.0)
    return float(np.arctan((view.horizon_row - middle) / focal_px))
