"""Another aircraft drawn at random: a light one that flies far behind."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from groundstation.simulation.airframes.draw import draw_airframe
from groundstation.simulation.airframes.kinds import AirframeFamily
from groundstation.simulation.attitude import GRAVITY_M_S2
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.sight_lines import SightLines
from groundstation.simulation.traffic.traffic_spec import OtherAircraftSpec

DISTANCE_M, SPEED_M_S, SPAN_M = (800.0, 3000.0), (20.0, 60.0), (7.0, 15.0)
LOWEST_M = 50.0
# those that cross the line of sight to the aircraft to within so much; the others pass within three times as much
ENCOUNTERS = 0.6
ENCOUNTER_RAD = math.radians(2.0)
_FAMILIES = (AirframeFamily.HIGH_WING, AirframeFamily.LOW_WING, AirframeFamily.T_TAIL, AirframeFamily.GLIDER)
_MAX_BANK_RAD = math.radians(25.0)
_TRIES = 60


def draw_other_aircraft(
    generator: np.random.Generator, lines: SightLines, families: Sequence[AirframeFamily]
) -> tuple[OtherAircraftSpec, ...]:
    """Draw an aircraft of an allowed family; none where no family is a light aircraft's or no path is free."""
    allowed = [family for family in _FAMILIES if family in families]
    path = _path(generator, lines)
    if not allowed or path is None:
        return ()
    airframe = draw_airframe(generator, allowed)
    span = math.exp(float(generator.uniform(*np.log(SPAN_M))))
    return (OtherAircraftSpec(airframe=replace(airframe, span_m=span), path=path),)


def _path(generator: np.random.Generator, lines: SightLines) -> ArcPath | None:
    """Draw a path that stays within the distances from all stations; None after many tries."""
    times = np.linspace(0.0, lines.duration_s, 41)
    for _ in range(_TRIES):
        meets = float(generator.uniform()) < ENCOUNTERS
        sight = lines.draw(ENCOUNTER_RAD if meets else 3.0 * ENCOUNTER_RAD)
        away = math.exp(float(generator.uniform(*np.log(DISTANCE_M))))
        place = sight.at(away)
        speed = float(generator.uniform(*SPEED_M_S))
        turning = float(generator.uniform()) < 0.3
        most = GRAVITY_M_S2 * math.tan(_MAX_BANK_RAD) / speed
        path = ArcPath(
            place_m=(float(place[0]), float(place[1]), float(place[2])),
            at_s=sight.t_s,
            heading_rad=float(generator.uniform(-math.pi, math.pi)),
            speed_m_s=speed,
            climb_m_s=float(np.clip(generator.normal(0.0, 0.02), -0.06, 0.06)) * speed,
            turn_rate_rad_s=float(generator.uniform(-most, most)) if turning else 0.0,
        )
        points = path.position(times)
        away_all = np.array([np.linalg.norm(points - eye, axis=1) for eye in lines.eyes_m])
        inside = DISTANCE_M[0] <= away_all.min() and away_all.max() <= DISTANCE_M[1]
        if inside and points[:, 2].min() >= LOWEST_M:
            return path
    return None
