"""A camera drawn at random, as laboratories and industry use them outdoors."""

import math

import numpy as np

from groundstation.picture import BayerPattern
from groundstation.simulation.drawn_cameras.camera_spec import MAX_PHASE_S, CameraSpec
from groundstation.simulation.optics import REFERENCE_EXPOSURE_S, ExposureStep
from groundstation.simulation.parameter_checks import require_positive
from groundstation.simulation.picture_writer import PictureFormat

# sides in px, readout of a rolling shutter of this size in s (rows times some 15 µs), and how often
_SENSORS = (
    ((640, 480), 0.008, 0.15),
    ((1024, 768), 0.012, 0.15),
    ((1280, 960), 0.015, 0.35),
    ((1440, 1080), 0.016, 0.15),
    ((1920, 1080), 0.017, 0.2),
)
# horizontal field of view: from a long tele lens to one that holds the whole approach
_LEAST_VIEW_RAD, _MOST_VIEW_RAD = math.radians(7.0), math.radians(18.0)
_LEAST_EXPOSURE_S, _MOST_EXPOSURE_S = 0.0005, 0.010
_STEP_EVERY_S = 6.0
_MAX_LOST_SHARE = 0.05
_MAX_PHASE_OF_PERIOD = 0.45


def draw_camera(generator: np.random.Generator, *, frame_hz: float = 10.0, duration_s: float = 30.0) -> CameraSpec:
    """Return a camera for a session of so many pairs per s and so many s."""
    require_positive("draw_camera: frame_hz", frame_hz)
    require_positive("draw_camera: duration_s", duration_s)
    g = generator
    size, rolling_s, _ = _SENSORS[int(g.choice(len(_SENSORS), p=[share for _, _, share in _SENSORS]))]
    view = _between(g, _LEAST_VIEW_RAD, _MOST_VIEW_RAD)
    focal = 0.5 * size[0] / math.tan(0.5 * view)
    colour, rolling = bool(g.uniform() < 0.75), bool(g.uniform() < 0.35)
    pattern = list(BayerPattern)[int(g.integers(len(BayerPattern)))]
    exposure = _between(g, _LEAST_EXPOSURE_S, _MOST_EXPOSURE_S)
    # the aperture and the gain bring a daylight picture near its right brightness
    gain = REFERENCE_EXPOSURE_S / exposure * float(g.uniform(0.8, 1.15))
    coding, quality = _coding(g)
    # distortion is stated of normalised coordinates: so much of a corner's radius
    corner = math.tan(0.5 * view) * math.hypot(1.0, size[1] / size[0])
    k1 = float(g.normal(0.0, 0.006)) / corner**2
    k2 = float(g.normal(0.0, 0.0015)) / corner**4
    tangential = g.normal(0.0, 0.0005, 2) / corner
    steps = _exposure_steps(g, duration_s) if g.uniform() < 0.5 else ()
    return CameraSpec(
        image_size_px=size,
        focal_px=focal,
        principal_offset_px=(float(g.normal(0.0, 0.01) * size[0]), float(g.normal(0.0, 0.01) * size[0])),
        distortion=(k1, k2, float(tangential[0]), float(tangential[1]), 0.0),
        colour=colour,
        pattern=pattern,
        exposure_s=exposure,
        gain=gain,
        # full wells of 4 000 to 20 000 electrons with the same exposure
        electrons_per_level=_between(g, 15.0, 80.0) * gain,
        read_noise_electrons=_between(g, 3.0, 25.0),
        blur_px=float(g.uniform(0.45, 0.9)),
        defocus_px=float(g.uniform(0.3, 2.5)) if g.uniform() < 0.3 else 0.0,
        vignetting=float(g.uniform(0.05, 0.45)) if g.uniform() < 0.7 else 0.0,
        flicker=float(g.uniform(0.01, 0.05)) if g.uniform() < 0.25 else 0.0,
        flicker_hz=_between(g, 0.5, 120.0),
        exposure_steps=steps,
        readout_s=rolling_s * float(g.uniform(0.7, 1.8)) if rolling else 0.0,
        phase_s=min(float(g.uniform(0.0, _MAX_PHASE_OF_PERIOD)) / frame_hz, MAX_PHASE_S) if g.uniform() < 0.5 else 0.0,
        lost_share=_between(g, 0.001, _MAX_LOST_SHARE) if g.uniform() < 0.5 else 0.0,
        coding=coding,
        quality=quality,
    )


def _between(g: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two, even in its logarithm."""
    return float(math.exp(g.uniform(math.log(low), math.log(high))))


def _coding(g: np.random.Generator) -> tuple[PictureFormat, int | None]:
    kind = g.uniform()
    crf, quality = int(g.integers(16, 32)), int(g.integers(60, 97))
    if kind < 0.55:
        return PictureFormat.H264, crf
    if kind < 0.9:
        return PictureFormat.JPEG, quality
    return PictureFormat.LOSSLESS, None


def _exposure_steps(g: np.random.Generator, duration_s: float) -> tuple[ExposureStep, ...]:
    """Return steps of up to a fifth of the brightness, as an automatic exposure makes them when the scene changes."""
    steps, t, level = [], float(g.exponential(_STEP_EVERY_S)), 0.0
    while t < duration_s:
        # it finds back to the right brightness
        level = 0.5 * level + float(g.normal(0.0, 0.12))
        steps.append(ExposureStep(t_s=t, factor=math.exp(level)))
        t += 0.2 + float(g.exponential(_STEP_EVERY_S))
    return tuple(steps)
