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
LARGEST_UNREDUCED = 100.0  # px of span, more than it and less than twice it
AIRCRAFT_CONTRAST, BIRD_CONTRAST = 15.0, 40.0


def working(boxes: list[tuple[slice, slice, float]], scale: int) -> tuple[Look, Regions]:
    """Return regions of rows, columns and contrast in a working picture, of an image ``scale`` times as large."""
    phi = np.full((SIZE[1], SIZE[0]), -1.0, np.float32)
    contrast = np.zeros_like(phi)
    for rows, columns, level in boxes:
        phi[rows, columns], contrast[rows, columns] = 1.0, level
    image = np.full((SIZE[1] * scale, SIZE[0] * scale, 3), 128, np.uint8)
    middle = 0.5 * (scale - 1)
    hint = look_at((NOSE[0] * scale + middle, NOSE[1] * scale + middle), SPAN * scale, sigma_px=2.0 * scale)
    look = start_look(image, whole(image), hint, (SPAN * scale, 0.15), (3.0, LARGEST_UNREDUCED))
    assert look.scale == scale
    assert look.span == SPAN
    return look, find_regions(phi, contrast)


def scene(bird_height_px: int, scale: int) -> tuple[Look, Regions]:
    """Return a wing with a fuselage and, two rows below the left half of it, a bird that stands out more."""
    boxes = [
        (slice(38, 41), slice(55, 145), AIRCRAFT_CONTRAST),
        (slice(34, 47), slice(94, 107), AIRCRAFT_CONTRAST),
        (slice(43, 43 + bird_height_px), slice(60, 90), BIRD_CONTRAST),
    ]
    return working(boxes, scale)


def remembered(working_mass: float, scale: int = 1) -> Memory:
    """Return the memory, in px of the full image, of a target of this mass in the working picture."""
    return Memory(span_px=SPAN * scale, mass=working_mass * scale**2, appearance=first_look(np.zeros(5)))


@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize("bird_height_px", [6, 10, 14])
def test_a_bird_beside_the_wing_does_not_join_the_aircraft(bird_height_px: int, scale: int) -> None:
    look, regions = scene(bird_height_px, scale)
    aircraft, bird = sorted(range(1, len(regions.table)), key=lambda k: regions.table[k, 5])
    assert regions.table[bird, 1] > regions.table[aircraft, 1]
    chosen = choose(regions, look, remembered(float(regions.table[aircraft, 1]), scale), DetectionConfig())
    assert isinstance(chosen, Group)
    assert chosen.labels == (aircraft,)


@pytest.mark.parametrize("scale", [1, 2])
def test_what_weighs_less_than_the_target_did_is_less_likely(scale: int) -> None:
    """Expected: the wing ten pixels off, not the thread of a quarter of its mass in the predicted place."""
    wing = (slice(28, 32), slice(55, 145), AIRCRAFT_CONTRAST)
    thread = (slice(40, 41), slice(55, 145), AIRCRAFT_CONTRAST)
    look, regions = working([wing, thread], scale)
    heavy, light = sorted(range(1, len(regions.table)), key=lambda k: -regions.table[k, 1])
    assert regions.table[heavy, 1] == 4.0 * regions.table[light, 1]
    chosen = choose(regions, look, remembered(float(regions.table[heavy, 1]), scale), DetectionConfig())
    assert isinstance(chosen, Group)
    assert heavy in chosen.labels


def test_mass_to_expect_grows_with_the_area() -> None:
    memory = remembered(1000.0)
    assert memory.mass_at(SPAN) == pytest.approx(1000.0)
    assert memory.mass_at(2.0 * SPAN) == pytest.approx(4000.0)
