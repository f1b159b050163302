"""Made-up films of a small aircraft before sky and hills, seen by a camera that may pan and shake."""

import math
from dataclasses import dataclass, field
from functools import cache

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.box import Box, box_of_size

SIZE = (480, 360)
RATE_HZ = 30.0
Place = tuple[float, float]
_NUMBERS = 1 << 23


@cache
def _drawn() -> Float32Array:
    return np.random.default_rng(1).standard_normal(_NUMBERS, np.float32)


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Float32Array:
    """Return normal numbers, float32, independent of each other.

    They are a part of one long draw, from a drawn place on: no pixel of two pictures has the same, and to draw half a
    million for each picture takes longer than what is tested.
    """
    count = math.prod(shape)
    place = int(rng.integers(0, _NUMBERS - count))
    return _drawn()[place : place + count].reshape(shape)


def panorama(rng: np.random.Generator, size: tuple[int, int] = (1400, 700), horizon: int = 430) -> ImageArray:
    """Return a wide sky over textured hills."""
    w, h = size
    y = np.linspace(0.0, 1.0, h)[:, None]
    sky = 150.0 + 50.0 * y + np.linspace(0.0, 10.0, w)[None, :]
    texture = sum(cv2.GaussianBlur(np.float32(14.0 * s) * normal(rng, (h, w)), (0, 0), float(s)) for s in (2, 5))
    hills = 80.0 + np.asarray(texture)
    edge = horizon + 12.0 * np.sin(np.arange(w) / 60.0)
    scene = np.where(np.arange(h)[:, None] > edge[None, :], hills, sky)
    return np.repeat(np.clip(scene, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


@dataclass(kw_only=True)
class Film:
    """A camera with a view of part of a panorama, and an aircraft given in the panorama's px.

    ``look(k)`` is the upper-left corner of the view, ``fly(k)`` the aircraft's middle, or None where it is hidden.
    """

    scene: ImageArray
    rng: np.random.Generator
    span_px: float = 26.0
    level: float = -70.0
    noise: float = 1.0
    corner: Place = (300.0, 150.0)
    pan_px: Place = (0.0, 0.0)
    start: Place = (420.0, 300.0)
    speed_px: Place = (2.0, 0.3)
    hidden: range = field(default_factory=lambda: range(0))
    jumps: dict[int, Place] = field(default_factory=dict)

    def __post_init__(self) -> None:
        blue, green, red = (self.scene[:, :, k] for k in range(3))
        assert np.array_equal(blue, green)
        assert np.array_equal(green, red)
        self._grey = self.scene[:, :, 0].copy()

    def view(self, k: int) -> Place:
        """Return the upper-left corner of frame ``k`` in the panorama."""
        jump = np.sum([v for n, v in self.jumps.items() if n <= k] or [(0.0, 0.0)], axis=0)
        return self.corner[0] + k * self.pan_px[0] + jump[0], self.corner[1] + k * self.pan_px[1] + jump[1]

    def place(self, k: int) -> FloatArray:
        """Return the middle of the aircraft (2,) in frame ``k``."""
        x, y = self.view(k)
        return np.array([self.start[0] + k * self.speed_px[0] - x, self.start[1] + k * self.speed_px[1] - y])

    def box(self, k: int) -> Box[float]:
        """Return a loose box around the aircraft in frame ``k``."""
        u, v = self.place(k)
        return box_of_size(
            float(u - 0.65 * self.span_px), float(v - 0.4 * self.span_px), 1.3 * self.span_px, 0.8 * self.span_px
        )

    def frame(self, k: int) -> ImageArray:
        """Return frame ``k``, (h, w, 3)."""
        x, y = self.view(k)
        shifted = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y]])
        # one channel: all are equal until there is noise in them
        grey = cv2.warpAffine(self._grey, shifted, SIZE, flags=cv2.INTER_LINEAR).astype(np.float32)
        if k not in self.hidden:
            grey += self.level * self._silhouette(k)
        picture = np.float32(self.noise) * normal(self.rng, (*grey.shape, 3))
        picture += cv2.GaussianBlur(grey, (0, 0), 0.7)[:, :, None]
        # rounds to even and limits to a byte
        return np.asarray(cv2.convertScaleAbs(np.maximum(picture, 0.0, out=picture)))

    def _silhouette(self, k: int) -> Float32Array:
        """Return wing, body and fin of the aircraft, (h, w) from 0 to 1, float32."""
        shape = np.zeros((SIZE[1], SIZE[0]), dtype=np.float32)
        u, v = self.place(k)
        for x0, y0, x1, y1 in ((-0.5, -0.03, 0.5, 0.04), (-0.07, -0.1, 0.07, 0.12), (-0.02, -0.25, 0.02, 0.0)):
            corner = (round((u + x0 * self.span_px) * 16), round((v + y0 * self.span_px) * 16))
            opposite = (round((u + x1 * self.span_px) * 16), round((v + y1 * self.span_px) * 16))
            cv2.rectangle(shape, corner, opposite, 1.0, cv2.FILLED, cv2.LINE_AA, 4)
        return shape
