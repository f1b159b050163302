"""Composites drawn at random: a clip's segment, an aircraft that flies through its picture, birds, and the sun."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.bank.composites.clip_segments import ClipSegment
from groundstation.bank.composites.composite_sight import CompositeSight
from groundstation.bank.composites.composite_spec import (
    EYE_HEIGHT_M,
    RATE_HZ,
    CompositeCamera,
    CompositeSpec,
    CompositeSun,
    horizon_tilt_rad,
)
from groundstation.bank.composites.segment_view import CompositeClips, SegmentView
from groundstation.errors import ScenarioError
from groundstation.simulation.airframes.draw import draw_airframe
from groundstation.simulation.airframes.kinds import FAMILIES
from groundstation.simulation.attitude import GRAVITY_M_S2
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_spec import BirdSpec
from groundstation.simulation.traffic.draw_birds import draw_bird
from groundstation.simulation.traffic.sight_lines import SightLines
from groundstation.simulation.world.draw_world import WITHHELD_FAMILIES
from groundstation.simulation.world.world_sets import set_of

_CLIP, _AIRFRAME, _PATH, _SUN, _BIRDS = range(451, 456)
# frames that show the middle of the aircraft, one after the other, at least and at most
LEAST_FRAMES, MOST_FRAMES = 45, 150
# width of the aircraft in the middle of its time in view: least, px, and most, in widths of the picture
_LEAST_WIDTH_PX, _MOST_WIDTH = 11.0, 0.25
# where it is then, as a share of the picture's size
_INNER = (0.06, 0.94)
# where a clip shows ground, so many are then around the horizon, so far below it in heights of the picture
_LOW, _AROUND_HORIZON = 0.5, (-0.1, 0.2)
_FOCAL_WIDTHS = (2.0, 5.5)
_TILT_DEG, _EXPOSURE_S = (8.0, 35.0), (0.0005, 0.006)
# of aircraft that come, that go, and that cross
_SHARES = (0.55, 0.2, 0.25)
_ASIDE_DEG = 40.0
# at a span of 2 m; speed is proportional to the root of the span
_SPEED_M_S, _AT_SPAN_M = (10.0, 20.0), 2.0
_CLIMB, _MAX_BANK_RAD, _STRAIGHT = 0.06, math.radians(30.0), 0.5
_PATHS, _STRETCHES = 400, 12
_WITH_BIRDS, _MOST_BIRDS = 0.4, 3


def draw_composite(seed: int, clips: CompositeClips) -> CompositeSpec:
    """Draw the composite of a seed over a clip of the seed's set.

    Raises `ScenarioError` for a seed of no set or of *test*, and where no clip has room for an aircraft.
    """
    world_set = set_of(seed)
    segments = clips.segments(world_set)
    order = np.random.default_rng([seed, _CLIP])
    for number in range(_STRETCHES):
        segment, view = clips.measured(segments[int(order.integers(len(segments)))])
        found = _CompositeDraw(seed, number, segment, view).composite()
        if found is not None:
            return found
    raise ScenarioError(f"composite {seed}", got="no path without the real aircraft", wanted="clips with more room")


class _CompositeDraw:
    """One composite's draw over one segment."""

    def __init__(self, seed: int, number: int, segment: ClipSegment, view: SegmentView) -> None:
        self._seed, self._number = seed, number
        self._segment, self._view = segment, view

    def composite(self) -> CompositeSpec | None:
        """Return a composite; None where no path was found."""
        families = [family for family in FAMILIES if family not in WITHHELD_FAMILIES]
        airframe = draw_airframe(self._stream(_AIRFRAME), families)
        generator = self._stream(_PATH)
        camera = self._camera(generator)
        found = self._path(generator, CompositeSight(camera, self._view, airframe))
        if found is None:
            return None
        path, first, last = found
        return CompositeSpec(
            seed=self._seed,
            clip=self._segment.clip,
            first=self._segment.first + first,
            last=self._segment.first + last,
            camera=camera,
            sun=_sun(self._stream(_SUN)),
            airframe=airframe,
            path=path,
            birds=_birds(self._stream(_BIRDS), path, (last - first + 1) / RATE_HZ),
        )

    def _stream(self, number: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, number, self._number])

    def _camera(self, generator: np.random.Generator) -> CompositeCamera:
        focal = self._view.size_px[0] * float(generator.uniform(*_FOCAL_WIDTHS))
        upwards = math.radians(float(generator.uniform(*_TILT_DEG)))
        exposure = math.exp(float(generator.uniform(*np.log(_EXPOSURE_S))))
        horizon = horizon_tilt_rad(self._view, focal)
        tilt = upwards if horizon is None else horizon
        return CompositeCamera(focal_px=focal, tilt_rad=tilt, exposure_s=exposure)

    def _path(self, generator: np.random.Generator, sight: CompositeSight) -> tuple[ArcPath, int, int] | None:
        """Return a path with a long enough aircraft in the picture, and the frames, from 0, that contain it."""
        count = len(self._segment.boxes)
        if count < LEAST_FRAMES:
            return None
        for _ in range(_PATHS):
            middle = int(generator.integers(count))
            path = _drawn(generator, sight, middle)
            run = _run_around(sight.free(path, self._segment.boxes), middle)
            if run is None or run[1] - run[0] + 1 < LEAST_FRAMES:
                continue
            first, last = run
            first = max(first, min(middle - MOST_FRAMES // 2, last - MOST_FRAMES + 1))
            last = min(last, first + MOST_FRAMES - 1)
            return replace(path, at_s=path.at_s - first / RATE_HZ), first, last
        return None


def _drawn(generator: np.random.Generator, sight: CompositeSight, middle: int) -> ArcPath:
    """Return a path through a pixel of the frame ``middle``; time is 0 in the segment's first frame."""
    span_m, size = sight.airframe.span_m, sight.size_px
    width = math.exp(float(generator.uniform(math.log(_LEAST_WIDTH_PX), math.log(_MOST_WIDTH * size[0]))))
    pixel = generator.uniform(*_INNER, 2) * np.array(size)
    if sight.horizon_row is not None and generator.random() < _LOW:
        pixel[1] = sight.horizon_row + float(generator.uniform(*_AROUND_HORIZON)) * size[1]
    place = sight.point(middle, pixel, sight.camera.focal_px * span_m / width)
    speed = float(generator.uniform(*_SPEED_M_S)) * math.sqrt(span_m / _AT_SPAN_M)
    kind = int(generator.choice(3, p=_SHARES))
    # from +y, which leads away from the camera
    course = (math.pi, 0.0, 0.5 * math.pi * (1.0 if generator.random() < 0.5 else -1.0))[kind]
    aside = math.radians(_ASIDE_DEG) * float(generator.uniform(-1.0, 1.0))
    bank = 0.0 if generator.random() < _STRAIGHT else _MAX_BANK_RAD * float(generator.uniform(-1.0, 1.0))
    return ArcPath(
        place_m=(float(place[0]), float(place[1]), float(place[2])),
        at_s=middle / RATE_HZ,
        heading_rad=course + aside + math.atan2(place[0], place[1]),
        speed_m_s=speed,
        climb_m_s=speed * _CLIMB * float(generator.normal()),
        turn_rate_rad_s=GRAVITY_M_S2 * math.tan(bank) / speed,
    )


def _run_around(free: MaskArray, middle: int) -> tuple[int, int] | None:
    """Return the first and last of the set elements in a row that ``middle`` is one of; None where it is not set."""
    if not free[middle]:
        return None
    taken = np.flatnonzero(~free)
    before, after = taken[taken < middle], taken[taken > middle]
    return int(before[-1]) + 1 if before.size else 0, int(after[0]) - 1 if after.size else len(free) - 1


def _sun(generator: np.random.Generator) -> CompositeSun:
    return CompositeSun(
        azimuth_rad=float(generator.uniform(-math.pi, math.pi)),
        elevation_rad=math.radians(float(generator.uniform(10.0, 50.0))),
        strength=float(generator.uniform(1.2, 3.2)),
        ambient=float(generator.uniform(0.8, 1.3)),
        visibility_m=float(generator.uniform(8_000.0, 40_000.0)),
    )


def _birds(generator: np.random.Generator, path: ArcPath, duration_s: float) -> tuple[BirdSpec, ...]:
    """Return no birds, or a few that cross the line of sight or pass near it."""
    count = int(generator.integers(1, _MOST_BIRDS + 1)) if generator.random() < _WITH_BIRDS else 0
    eyes: Sequence[FloatArray] = [np.array([0.0, 0.0, EYE_HEIGHT_M])]
    lines = SightLines(generator, path, eyes, duration_s)
    return tuple(draw_bird(generator, lines) for _ in range(count))
