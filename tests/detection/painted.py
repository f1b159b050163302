"""Synthetic pictures of a small aircraft seen head-on, with the sub-pixel truth of its nose."""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection.detector import DetectionHint

FINE = 8


@dataclass(frozen=True, kw_only=True)
class Painting:
    """An aircraft to paint: nose in px, span in px, roll in rad, grey level against the background's."""

    nose_px: tuple[float, float]
    span_px: float = 60.0
    roll_rad: float = 0.0
    level: tuple[float, float, float] = (60.0, 60.0, 70.0)


def paint(background: FloatArray, aircraft: Painting, rng: np.random.Generator, noise: float = 1.5) -> ImageArray:
    """Blend the aircraft into a (h, w, 3) background, blur by the optics' 0.6 px, add noise, round."""
    h, w = background.shape[:2]
    cover = coverage((w, h), aircraft)[:, :, None]
    image = background * (1 - cover) + np.array(aircraft.level) * cover
    image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0.0, noise, background.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def coverage(size: tuple[int, int], aircraft: Painting) -> FloatArray:
    """Return the share of each pixel that the aircraft covers: fuselage, straight wing through its middle, fin."""
    w, h = size
    # no part of it is farther from its nose than half a span and half a chord
    reach = 0.51 * aircraft.span_px + 1.0
    (x0, x1), (y0, y1) = (
        (max(int(middle - reach), 0), min(int(middle + reach) + 1, end))
        for middle, end in zip(aircraft.nose_px, size, strict=True)
    )
    share = np.zeros((h, w))
    if x0 >= x1 or y0 >= y1:
        return share
    fine = (np.arange(x0 * FINE, x1 * FINE) + 0.5) / FINE - 0.5, (np.arange(y0 * FINE, y1 * FINE) + 0.5) / FINE - 0.5
    x, y = fine[0][None, :] - aircraft.nose_px[0], fine[1][:, None] - aircraft.nose_px[1]
    cos, sin = np.cos(aircraft.roll_rad), np.sin(aircraft.roll_rad)
    a, b = (cos * x + sin * y) / aircraft.span_px, (cos * y - sin * x) / aircraft.span_px
    inside = (a**2 + b**2 < 0.075**2) | ((np.abs(a) < 0.5) & (np.abs(b) < 0.02))
    inside |= (np.abs(a) < 0.012) & (b < 0) & (b > -0.16)
    share[y0:y1, x0:x1] = inside.reshape(y1 - y0, FINE, x1 - x0, FINE).mean(axis=(1, 3))
    return share


def sky(size: tuple[int, int]) -> FloatArray:
    """Return a sky whose brightness falls by 20 levels across the picture."""
    w, h = size
    ramp = np.linspace(0, 20, w)[None, :] + np.linspace(0, 8, h)[:, None]
    return np.stack([215 - 0.6 * ramp, 195 - ramp, 180 - ramp], axis=2)


def ground(size: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Return a runway with paint, posts and texture at a scale of pixels."""
    w, h = size
    texture = cv2.GaussianBlur(rng.normal(0, 12, (h, w)), (0, 0), 2.0)
    scene = np.repeat((110 + texture)[:, :, None], 3, axis=2)
    for x in range(10, w - 30, 70):
        scene[2 * h // 3 : 2 * h // 3 + 5, x : x + 30] = 200
    for x in range(25, w - 10, 55):
        scene[h // 5 : h // 5 + 9, x : x + 5] = (40, 120, 180)
    return scene


def whole(image: ImageArray) -> Box[int]:
    """Return the region of interest that is the whole picture."""
    return Box(0, 0, image.shape[1], image.shape[0])


def look_at(
    point: tuple[float, float], span_px: float | None = 60.0, sigma_px: float = 4.0, *, head_on: bool = True
) -> DetectionHint:
    """Return a hint that expects an aircraft at ``point``, flying straight towards the camera."""
    return DetectionHint(
        predicted_px=np.array(point),
        predicted_covariance_px2=sigma_px**2 * np.eye(2),
        expected_span_px=span_px,
        span_sigma_ratio=0.15,
        forward_px_per_m=np.zeros(2) if head_on else None,
        up_px_per_m=np.array([0.0, -30.0]),
        px_per_m=30.0,
    )
