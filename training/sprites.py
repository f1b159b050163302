"""Sprites: the aircraft and birds of train worlds, each drawn alone in its world's light.

A sprite is drawn once, as large as a window shows it at most, and laid over backgrounds many times, smaller, mirrored
and in other light: drawing it takes milliseconds, laying it down a fraction of one.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, MaskArray
from groundstation.geometry.camera import Lens
from groundstation.rig.rig import Station
from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.attitude import AircraftPose, runway_from_body
from groundstation.simulation.body_raster import BodyExposure, BodyRaster
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.scene_body import AircraftBody, Body, Skin
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.standard_cases import standard_rig
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_body import BirdBody
from groundstation.simulation.traffic.bird_shape import BirdShape
from groundstation.simulation.traffic.bird_spec import BirdSpec
from groundstation.simulation.world.world import World

# a sprite's largest side; windows show targets up to 1.6 times 48 px wide
SPRITE_PX = 96
_CANVAS_PX = 288
_RANGE_M = 200.0
_PERIOD_S = 10.0
# of the views of an aircraft: approach, climb-out, and any heading (circuits, go-arounds); as drawn flights have them
_VIEWS = (0.55, 0.2, 0.25)
_CRAB_DEG, _PITCH_DEG, _BANK_DEG, _STEEP_BANK_DEG = 9.0, (-6.0, 12.0), 8.0, 35.0
_ELEVATION_DEG = (0.3, 18.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sprite:
    """A body alone.

    Attributes
    ----------
    light : (h, w, 4) float32, levels B, G, R times cover, and cover, 0 to 1; antialiased, without blur.
    mask : (h, w) the pixels that it covers by half or more.
    nose_px : (2,) x, y of an aircraft's nose in it, seen or hidden; NaN for a bird.
    nose_hidden : whether the aircraft itself hides its nose.
    kinds : its airframe family; none for a bird.
    """

    light: Float32Array
    mask: MaskArray
    nose_px: FloatArray
    nose_hidden: bool
    kinds: tuple[str, ...] = ()

    @property
    def width_px(self) -> float:
        """Width of the silhouette, px."""
        columns = np.flatnonzero(self.mask.any(axis=0))
        return float(columns[-1] - columns[0] + 1) if columns.size else 0.0


class SpriteStudio:
    """Draws sprites with one camera; one thread at a time."""

    def __init__(self) -> None:
        station = standard_rig()["left"]
        middle = 0.5 * (_CANVAS_PX - 1)
        self._stand = np.asarray(station.ptu_position_m, np.float64)
        self._station = station
        self._middle = np.array([middle, middle])

    def aircraft(self, world: World, generator: np.random.Generator) -> Sprite | None:
        """Draw the aircraft of a world in a drawn attitude; None where too little of it is seen."""
        airframe = build_airframe(world.airframe)
        place, heading, pitch, bank = _drawn_view(generator)
        pose = AircraftPose(
            position_runway_m=place + self._stand,
            velocity_runway_m_s=np.zeros(3),
            runway_from_body=runway_from_body(heading, pitch, bank),
        )
        moment = float(generator.uniform(0.0, _PERIOD_S))
        body = AircraftBody(
            airframe=airframe, position=lambda _: pose.position_runway_m, pose=lambda _: pose, casts_shadow=False
        )
        sprite = self._drawn(body, world.scenery, moment, airframe.span_m)
        if sprite is None:
            return None
        return replace(sprite, nose_hidden=_turned_away(pose, self._stand), kinds=(world.airframe.family.value,))

    def bird(self, spec: BirdSpec, scenery: Scenery, generator: np.random.Generator) -> Sprite | None:
        """Draw a bird that flies anywhere in a drawn phase of its wing beat."""
        place, *_ = _drawn_view(generator)
        x, y, z = place + self._stand
        path = ArcPath(
            place_m=(float(x), float(y), float(z)),
            heading_rad=float(generator.uniform(-math.pi, math.pi)),
            turn_rate_rad_s=float(generator.normal(0.0, 0.2)),
        )
        body = BirdBody(shape=BirdShape(replace(spec, path=path)), path=path, phase=float(generator.uniform()))
        return self._drawn(body, scenery, 0.0, spec.span_m)

    def _drawn(self, body: Body, scenery: Scenery, t_s: float, span_m: float) -> Sprite | None:
        place = body.place(t_s)
        line = place - self._stand
        away = float(np.linalg.norm(line))
        # the whole body in a canvas about twice as wide as it
        focal = SPRITE_PX / span_m * away
        raster = BodyRaster(self._with_focal(focal), 0.0)
        pan, tilt = math.atan2(-line[0], line[1]), math.asin(line[2] / away)
        head = HeadMotion(pan_rad=pan, tilt_rad=tilt)
        pixel = raster.pixel(body, t_s, head)
        if pixel is None:
            return None
        seen = BodyExposure(
            t_s=t_s, head=head, exposure_s=1e-4, pixel_px=pixel, motion_px=np.zeros(2), rate_px_s=np.zeros(2)
        )
        skin = body.skin(t_s)
        chosen = raster.facing(skin, self._stand)
        shown = Skin(
            corners_runway_m=skin.corners_runway_m[chosen],
            normals_runway=skin.normals_runway[chosen],
            colours_bgr=skin.colours_bgr[chosen],
            opacity=skin.opacity[chosen],
        )
        window = raster.window(shown, scenery.light_on(shown.normals_runway) * shown.colours_bgr, seen)
        return None if window is None else _cropped(window.cover, pixel - np.array(window.corner))

    def _with_focal(self, focal_px: float) -> Station:
        lens = Lens(
            image_size_px=(_CANVAS_PX, _CANVAS_PX),
            focal_px=np.array([focal_px, focal_px]),
            principal_point_px=self._middle,
            distortion=np.zeros(5),
        )
        return replace(self._station, lens=lens, readout_s=0.0)


def _drawn_view(generator: np.random.Generator) -> tuple[FloatArray, FloatArray, float, float]:
    """Return a place (3,) m from the eye, a unit heading (2,), pitch and bank, rad."""
    elevation = math.radians(float(generator.uniform(*_ELEVATION_DEG)))
    azimuth = math.radians(float(generator.normal(0.0, 6.0)))
    flat = np.array([math.sin(azimuth), math.cos(azimuth)])
    place = _RANGE_M * np.array([*(math.cos(elevation) * flat), math.sin(elevation)])
    kind = int(generator.choice(3, p=_VIEWS))
    turned = math.radians(float(generator.normal(0.0, _CRAB_DEG)))
    if kind == 2:
        turned = float(generator.uniform(-math.pi, math.pi))
    base = math.pi if kind == 0 else 0.0
    heading = np.array([math.sin(base + turned), math.cos(base + turned)])
    pitch = math.radians(float(generator.uniform(*_PITCH_DEG)))
    bank = math.radians(float(generator.normal(0.0, _BANK_DEG if kind < 2 else 0.5 * _STEEP_BANK_DEG)))
    return place, heading, pitch, max(min(bank, math.radians(_STEEP_BANK_DEG)), -math.radians(_STEEP_BANK_DEG))


def _turned_away(pose: AircraftPose, eye: FloatArray) -> bool:
    """Return whether the aircraft shows its tail: its nose is then behind it."""
    return float(pose.runway_from_body[:, 0] @ (eye - pose.position_runway_m)) < 0.0


def _cropped(cover: Float32Array, nose: FloatArray) -> Sprite | None:
    """Return a sprite without empty rim, one pixel of it left, and at most `SPRITE_PX` wide and high."""
    rows, columns = np.nonzero(cover[:, :, 3] > 0.0)
    if rows.size == 0:
        return None
    y0, y1 = max(int(rows.min()) - 1, 0), int(rows.max()) + 2
    x0, x1 = max(int(columns.min()) - 1, 0), int(columns.max()) + 2
    light = np.ascontiguousarray(cover[y0:y1, x0:x1])
    point = nose - np.array([x0, y0])
    scale = SPRITE_PX / max(light.shape[:2])
    if scale < 1.0:
        light = np.asarray(cv2.resize(light, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.float32)
        point = (point + 0.5) * scale - 0.5
    mask = light[:, :, 3] >= 0.5
    if mask.sum() < 12:
        return None
    return Sprite(light=light, mask=mask, nose_px=point, nose_hidden=False)
