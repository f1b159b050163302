"""Details of an airframe that a world file states: how thick the legs are, and the booms' own colour."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.airframes.draw import draw_airframe
from groundstation.simulation.airframes.kinds import AirframeFamily, TailKind
from groundstation.simulation.airframes.part_specs import TailSpec
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world_sets import WorldSet, seed_of

BOOMED = AirframeSpec(family=AirframeFamily.TWIN_BOOM, tail=TailSpec(kind=TailKind.TWIN_FIN, end_per_span=0.75))
DARK = (20.0, 30.0, 40.0)


def test_legs_are_as_thick_as_asked_for() -> None:
    thin, thick = (
        build_airframe(replace(BOOMED, gear=replace(BOOMED.gear, leg_per_span=radius))) for radius in (0.002, 0.02)
    )
    assert thin.rest_height_m == thick.rest_height_m
    areas = [
        float(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum())
        for c in (thin.corners_body_m, thick.corners_body_m)
    ]
    assert areas[1] > areas[0] + 0.01


def test_booms_have_their_own_colour() -> None:
    plain = build_airframe(BOOMED)
    painted = build_airframe(replace(BOOMED, livery=replace(BOOMED.livery, boom_bgr=DARK)))
    changed = np.any(plain.colours_bgr != painted.colours_bgr, axis=1)
    assert changed.any()
    assert np.all(painted.colours_bgr[changed] == DARK)
    # two booms, on either side of the middle
    sides = painted.corners_body_m[changed].mean(axis=1)[:, 1]
    assert (sides > 0.1).sum() == (sides < -0.1).sum() == changed.sum() / 2


@pytest.mark.parametrize("family", list(AirframeFamily))
def test_every_draw_of_a_family_is_an_airframe(family: AirframeFamily) -> None:
    """Expected: none is refused, as a flying wing with a fuselage of 0.146 spans was."""
    for seed in range(300):
        airframe = draw_airframe(np.random.default_rng([seed, 7]), [family])
        assert airframe.family is family
        assert airframe.hull.length_per_span > 0.1


def test_a_flying_wing_with_a_short_fuselage() -> None:
    world = draw_world(seed_of(WorldSet.TRAIN, 2039))
    assert world.airframe.hull.length_per_span < 0.15
