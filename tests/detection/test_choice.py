"""Which group is the target: what hangs together with something heavy is no likelier for its weight."""

import numpy as np
import pytest

from groundstation.detection.appearance import first_look
from groundstation.detection.choice import Memory, choose
from groundstation.detection.config import DetectionConfig
from groundstation.detection.look import Look, start_look
from groundstation.detection.regions import Group, Regions, find_regions
from tests.detection.painted import look_at, whole

SIZE = (200, 100)
NOSE = (100.0, 40.0)
SPAN = 90.0
AIRCRAFT_CONTRAST, BIRD_CONTRAST = 15.0, 40.0


def scene(bird_height_px: int) -> tuple[Look, Regions]:
    """Return a wing with a fuselage and, two rows below the left half of it, a bird that stands out more."""
    phi = np.full((SIZE[1], SIZE[0]), -1.0, np.float32)
    contrast = np.zeros_like(phi)
    for rows, columns, level in (
        (slice(38, 41), slice(55, 145), AIRCRAFT_CONTRAST),
        (slice(34, 47), slice(94, 107), AIRCRAFT_CONTRAST),
        (slice(43, 43 + bird_height_px), slice(60, 90), BIRD_CONTRAST),
    ):
        phi[rows, columns], contrast[rows, columns] = 1.0, level
    image = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    hint = look_at(NOSE, SPAN, sigma_px=2.0)
    return start_look(image, whole(image), hint, (SPAN, 0.15), (3.0, 400.0)), find_regions(phi, contrast)


def remembered(mass: float) -> Memory:
    return Memory(span_px=SPAN, mass=mass, appearance=first_look(np.zeros(5)))


@pytest.mark.parametrize("bird_height_px", [6, 10, 14])
def test_a_bird_beside_the_wing_does_not_join_the_aircraft(bird_height_px: int) -> None:
    look, regions = scene(bird_height_px)
    aircraft, bird = sorted(range(1, len(regions.table)), key=lambda k: regions.table[k, 5])
    assert regions.table[bird, 1] > regions.table[aircraft, 1]
    chosen = choose(regions, look, remembered(float(regions.table[aircraft, 1])), DetectionConfig())
    assert isinstance(chosen, Group)
    assert chosen.labels == (aircraft,)


def test_mass_to_expect_grows_with_the_area() -> None:
    memory = remembered(1000.0)
    assert memory.mass_at(SPAN) == pytest.approx(1000.0)
    assert memory.mass_at(2.0 * SPAN) == pytest.approx(4000.0)
