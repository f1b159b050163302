"""Birds and flocks drawn at random."""

import math
from dataclasses import replace

import numpy as np

from groundstation.simulation.attitude import GRAVITY_M_S2
from groundstation.simulation.scenery.surfaces import Colour
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_spec import BirdSpec, FlockSpec
from groundstation.simulation.traffic.sight_lines import SightLines

SPAN_M, SPEED_M_S = (0.3, 1.8), (6.0, 20.0)
# of birds and flocks, those that cross the line of sight to the aircraft …
ENCOUNTERS = 0.5
# … to within so much; of them, those nearer than the aircraft
ENCOUNTER_RAD = math.radians(1.0)
_BEFORE = 0.6
# the others pass within so much of it: in the pictures of some stations, or just outside
_AROUND_RAD = math.radians(8.0)
_NEAREST_M, _FARTHEST_M, _LOWEST_M = 25.0, 700.0, 1.5
# starling (0.38 m, 10 Hz), crow (0.9 m, 4.3 Hz), herring gull (1.34 m, 3 Hz): the beat is proportional to 1 / span
_BEATS_M_PER_S = 3.9
_MAX_BANK_RAD = math.radians(35.0)
_TRIES = 40
_MEMBERS = (4, 18)

# back, belly, wing tips
_PLUMAGES: tuple[tuple[Colour, Colour, Colour], ...] = (
    ((26.0, 25.0, 26.0), (32.0, 31.0, 32.0), (20.0, 20.0, 20.0)),  # crow
    ((44.0, 40.0, 40.0), (150.0, 156.0, 162.0), (30.0, 28.0, 28.0)),  # swallow, magpie
    ((130.0, 122.0, 116.0), (150.0, 144.0, 140.0), (70.0, 66.0, 64.0)),  # pigeon
    ((48.0, 72.0, 96.0), (128.0, 160.0, 182.0), (34.0, 46.0, 58.0)),  # buzzard
    ((186.0, 182.0, 178.0), (238.0, 238.0, 238.0), (40.0, 40.0, 40.0)),  # gull
    ((236.0, 236.0, 238.0), (240.0, 240.0, 240.0), (44.0, 42.0, 42.0)),  # stork
    ((236.0, 238.0, 238.0), (236.0, 238.0, 238.0), (228.0, 230.0, 230.0)),  # egret
)


def draw_bird(generator: np.random.Generator, lines: SightLines) -> BirdSpec:
    """Draw a bird that crosses the line of sight, or passes near it."""
    span = math.exp(float(generator.uniform(*np.log(SPAN_M))))
    back, belly, tip = _PLUMAGES[int(generator.integers(len(_PLUMAGES)))]
    shade = float(generator.uniform(0.85, 1.1))
    # large birds glide more; the smallest hardly
    rests = float(generator.uniform(0.0, 1.0)) < 0.35 + 0.25 * span
    return BirdSpec(
        span_m=span,
        length_per_span=float(generator.uniform(0.38, 0.62)),
        chord_per_span=float(generator.uniform(0.14, 0.25)),
        flap_hz=_BEATS_M_PER_S / span * float(generator.uniform(0.85, 1.2)),
        flap_rad=math.radians(float(generator.uniform(22.0, 50.0))),
        glide_rad=math.radians(float(generator.uniform(-2.0, 14.0))),
        cycle_s=float(generator.uniform(0.8, 2.0 + 3.0 * span)),
        flapping_share=float(generator.uniform(0.1, 0.8)) if rests else 1.0,
        phase=float(generator.uniform(0.0, 1.0)),
        back_bgr=_shaded(back, shade),
        belly_bgr=_shaded(belly, shade),
        tip_bgr=_shaded(tip, shade),
        path=_path(generator, lines),
    )


def draw_flock(generator: np.random.Generator, lines: SightLines) -> FlockSpec:
    """Draw a flock: a cloud, or a line or wedge one behind the other."""
    bird = draw_bird(generator, lines)
    count = int(generator.integers(_MEMBERS[0], _MEMBERS[1] + 1))
    gap = bird.span_m * float(generator.uniform(1.6, 5.0))
    if float(generator.uniform()) < 0.35:
        # a wedge: its two arms slope backwards from the first bird
        ranks = np.arange(count)
        arm = np.where(ranks % 2 == 0, 1.0, -1.0) * ((ranks + 1) // 2)
        offsets = np.column_stack([-0.9 * gap * np.abs(arm), 0.8 * gap * arm, np.zeros(count)])
        offsets += generator.normal(0.0, 0.12 * gap, (count, 3))
    else:
        wide = gap * count ** (1.0 / 3.0)
        offsets = generator.normal(0.0, 1.0, (count, 3)) * (0.9 * wide, 0.9 * wide, 0.35 * wide)
    # none of them in the ground
    path = bird.path
    lowest = _height_at_ends(path, lines.duration_s) + float(offsets[:, 2].min())
    x, y, z = path.place_m
    raised = replace(path, place_m=(x, y, z + max(_LOWEST_M - lowest, 0.0) + 0.5))
    return FlockSpec(
        bird=replace(bird, path=raised),
        offsets_m=tuple((float(a), float(b), float(c)) for a, b, c in offsets),
        phases=tuple(float(v) for v in generator.uniform(0.0, 1.0, count)),
        sway_m=0.15 * gap * float(generator.uniform(0.3, 1.0)),
        sway_s=float(generator.uniform(2.5, 7.0)),
    )


def _shaded(colour: Colour, shade: float) -> Colour:
    b, g, r = (min(shade * part, 255.0) for part in colour)
    return b, g, r


def _height_at_ends(path: ArcPath, duration_s: float) -> float:
    return float(path.position(np.array([0.0, duration_s]))[:, 2].min())


def _path(generator: np.random.Generator, lines: SightLines) -> ArcPath:
    """Draw a path through a point near the aircraft's line of sight, clear of ground and stations."""
    times = np.linspace(0.0, lines.duration_s, 41)
    for _ in range(_TRIES):
        meets = float(generator.uniform()) < ENCOUNTERS
        sight = lines.draw(ENCOUNTER_RAD if meets else _AROUND_RAD)
        if float(generator.uniform()) < _BEFORE:
            near, far = _NEAREST_M, max(0.92 * sight.target_m, 1.5 * _NEAREST_M)
        else:
            near = 1.08 * sight.target_m
            far = max(_FARTHEST_M, 1.5 * near)
        away = math.exp(float(generator.uniform(math.log(near), math.log(far))))
        place = sight.at(away)
        speed = float(generator.uniform(*SPEED_M_S))
        most = GRAVITY_M_S2 * math.tan(_MAX_BANK_RAD) / speed
        circles = float(generator.uniform()) < 0.25
        path = ArcPath(
            place_m=(float(place[0]), float(place[1]), float(place[2])),
            at_s=sight.t_s,
            heading_rad=float(generator.uniform(-math.pi, math.pi)),
            speed_m_s=speed,
            climb_m_s=float(np.clip(generator.normal(0.0, 0.4), -1.0, 1.0)),
            turn_rate_rad_s=float(generator.uniform(-most, most)) * (1.0 if circles else 0.1),
        )
        if path.position(times)[:, 2].min() >= _LOWEST_M and lines.least_distance_m(path.position(times)) >= 6.0:
            return path
    # high above, level and away from all
    x, y, _ = lines.eyes_m[0].tolist()
    speed = float(generator.uniform(*SPEED_M_S))
    return ArcPath(
        place_m=(x, y + 200.0, 40.0), at_s=0.5 * lines.duration_s, heading_rad=0.5 * math.pi, speed_m_s=speed
    )
