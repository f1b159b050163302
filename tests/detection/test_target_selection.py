"""Which group is the target: what hangs together with something heavy is no likelier for its weight."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.detection.appearance import Appearance, initial_appearance
from groundstation.detection.config import DetectionConfig
from groundstation.detection.regions import Group, Regions, find_regions
from groundstation.detection.target_selection import TargetMemory, features_of, select_target
from groundstation.detection.working_image import WorkingImage, crop_working_image
from groundstation.messages import Miss, MissReason
from tests.detection.painted import look_at, whole

SIZE = (200, 100)
NOSE = (100.0, 40.0)
SPAN = 90.0
LARGEST_UNREDUCED = 100.0  # px of span, more than it and less than twice it
AIRCRAFT_CONTRAST, BIRD_CONTRAST = 15.0, 40.0


def working(boxes: list[tuple[slice, slice, float]], scale: int) -> tuple[WorkingImage, Regions]:
    """Return regions of rows, columns and contrast in a working picture, of an image ``scale`` times as large."""
    phi = np.full((SIZE[1], SIZE[0]), -1.0, np.float32)
    contrast = np.zeros_like(phi)
    for rows, columns, level in boxes:
        phi[rows, columns], contrast[rows, columns] = 1.0, level
    image = np.full((SIZE[1] * scale, SIZE[0] * scale, 3), 128, np.uint8)
    middle = 0.5 * (scale - 1)
    hint = look_at((NOSE[0] * scale + middle, NOSE[1] * scale + middle), SPAN * scale, sigma_px=2.0 * scale)
    look = crop_working_image(image, whole(image), hint, (SPAN * scale, 0.15), (3.0, LARGEST_UNREDUCED))
    assert look.scale == scale
    assert look.span == SPAN
    return look, find_regions(phi, contrast)


def scene(bird_height_px: int, scale: int) -> tuple[WorkingImage, Regions]:
    """Return a wing with a fuselage and, two rows below the left half of it, a bird that stands out more."""
    boxes = [
        (slice(38, 41), slice(55, 145), AIRCRAFT_CONTRAST),
        (slice(34, 47), slice(94, 107), AIRCRAFT_CONTRAST),
        (slice(43, 43 + bird_height_px), slice(60, 90), BIRD_CONTRAST),
    ]
    return working(boxes, scale)


def remembered(working_mass: float, scale: int = 1) -> TargetMemory:
    """Return the memory, in px of the full image, of a target of this mass in the working picture."""
    return TargetMemory(span_px=SPAN * scale, mass=working_mass * scale**2, appearance=initial_appearance(np.zeros(5)))


@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize("bird_height_px", [6, 10, 14])
def test_a_bird_beside_the_wing_does_not_join_the_aircraft(bird_height_px: int, scale: int) -> None:
    look, regions = scene(bird_height_px, scale)
    aircraft, bird = sorted(range(1, len(regions.table)), key=lambda k: regions.table[k, 5])
    assert regions.table[bird, 1] > regions.table[aircraft, 1]
    chosen = select_target(regions, look, remembered(float(regions.table[aircraft, 1]), scale), DetectionConfig())
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
    chosen = select_target(regions, look, remembered(float(regions.table[heavy, 1]), scale), DetectionConfig())
    assert isinstance(chosen, Group)
    assert heavy in chosen.labels


def test_mass_to_expect_grows_with_the_area() -> None:
    memory = remembered(1000.0)
    assert memory.mass_at(SPAN) == pytest.approx(1000.0)
    assert memory.mass_at(2.0 * SPAN) == pytest.approx(4000.0)


@pytest.mark.parametrize(
    ("forward", "joins"),
    # 60 px high together, of a span of 90 px that is known to 15 %: 0.35 of 1.25 of it end-on, twice that from the side
    [((0.0, 0.0), False), (None, False), ((30.0, 0.0), True), ((0.0, -30.0), True)],
)
def test_the_maximum_height_of_an_aircraft_depends_on_its_altitude(
    forward: tuple[float, float] | None, joins: bool
) -> None:
    wing = (slice(50, 54), slice(55, 145), AIRCRAFT_CONTRAST)
    mast = (slice(2, 49), slice(96, 104), AIRCRAFT_CONTRAST)
    other = (slice(53, 62), slice(94, 106), AIRCRAFT_CONTRAST)
    look, regions = working([wing, mast, other], 1)
    shift = None if forward is None else np.array(forward) / 30.0
    seen = replace(look, forward=shift, predicted=np.array([100.0, 52.0]))
    chosen = select_target(regions, seen, None, DetectionConfig())
    assert isinstance(chosen, Group)
    assert chosen.box == ((55, 2, 145, 62) if joins else (55, 50, 145, 62))


SLACK = 1.0 + 12.0 / SPAN * 0.5  # a silhouette of 90 px, no miss
TOLERANCES = (14.0, 6.0, 6.0, 0.25, 0.3)


def known(look: WorkingImage, regions: Regions, off: np.ndarray, frames: int = 5, misses: int = 0) -> TargetMemory:
    """Return the memory of a target whose features (5,) are those of the only group but for an offset."""
    group = select_target(regions, look, None, DetectionConfig())
    assert isinstance(group, Group)
    features = features_of(group, regions, look)
    learnt = Appearance(mean=features + off, variance=np.zeros(5), frames=frames)
    return TargetMemory(span_px=SPAN, mass=group.mass, appearance=learnt, misses=misses)


def alone() -> tuple[WorkingImage, Regions]:
    return working([(slice(38, 42), slice(55, 145), AIRCRAFT_CONTRAST)], 1)


@pytest.mark.parametrize("feature", range(5))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_region_unlike_the_target_is_refused(feature: int, sign: float) -> None:
    """Expected: 1.5 sigmas, as a root mean square over grey, two colours and two shapes, are the most."""
    look, regions = alone()
    off = np.zeros(5)
    off[feature] = sign * DetectionConfig().appearance_gate * 5.0**0.5 * TOLERANCES[feature] * SLACK
    assert isinstance(select_target(regions, look, known(look, regions, 0.97 * off), DetectionConfig()), Group)
    refused = select_target(regions, look, known(look, regions, 1.03 * off), DetectionConfig())
    assert isinstance(refused, Miss)
    assert (refused.reason, refused.detail) == (MissReason.NO_REGION, "the nearest region looks unlike the target")
    # only its appearance is against it
    assert isinstance(
        select_target(regions, look, known(look, regions, 1.03 * off), DetectionConfig(appearance_gate=1.6)), Group
    )
    # four frames are too few to know it by, and after misses it may have changed
    assert isinstance(
        select_target(regions, look, known(look, regions, 1.03 * off, frames=4), DetectionConfig()), Group
    )
    assert isinstance(
        select_target(regions, look, known(look, regions, 1.03 * off, misses=1), DetectionConfig()), Group
    )


def test_appearance_decides_between_two_in_about_the_same_place() -> None:
    """Expected: the one with the target's appearance, though the other is nearer and neither is beyond a gate."""
    wing = (slice(38, 42), slice(55, 145), AIRCRAFT_CONTRAST)
    other = (slice(55, 59), slice(55, 145), AIRCRAFT_CONTRAST)
    look, regions = working([wing, other], 1)
    look = replace(look, predicted=np.array([100.0, 45.0]))
    image = look.image.copy()
    image[50:] = 58
    look = replace(look, image=image)
    shape = select_target(*alone()[::-1], None, DetectionConfig())
    assert isinstance(shape, Group)
    for grey, rows in ((128.0, (38, 42)), (58.0, (55, 59))):
        like = np.array([grey, 0.0, 0.0, np.log(4.0 / 90.0), np.log(4.0 / 90.0)])
        memory = TargetMemory(
            span_px=SPAN, mass=shape.mass, appearance=Appearance(mean=like, variance=np.zeros(5), frames=9)
        )
        config = DetectionConfig(appearance_gate=3.0, gate_sigmas=8.0)
        chosen = select_target(regions, look, memory, config)
        assert isinstance(chosen, Group), chosen
        assert (chosen.box.y0, chosen.box.y1) == rows


@pytest.mark.parametrize(("width", "reason"), [(90, None), (150, MissReason.WRONG_SIZE), (40, MissReason.WRONG_SIZE)])
def test_what_is_much_wider_or_narrower_is_not_the_target(width: int, reason: MissReason | None) -> None:
    look, regions = working([(slice(38, 42), slice(100 - width // 2, 100 + width // 2), AIRCRAFT_CONTRAST)], 1)
    chosen = select_target(regions, look, None, DetectionConfig())
    assert (chosen.reason if isinstance(chosen, Miss) else None) is reason


def test_what_is_far_from_the_prediction_is_not_the_target() -> None:
    """Expected: gated by the distance in sigmas of the prediction, along and across its ellipse."""
    look, regions = alone()
    gate = DetectionConfig().gate_sigmas
    covariance = np.array([[100.0, 60.0], [60.0, 100.0]])
    off_centre = 1.0 + (0.15 * 90.0) ** 2
    values, axes = np.linalg.eigh(covariance + off_centre * np.eye(2))
    middle = np.array([99.5, 39.5])
    for value, axis in zip(values, axes.T, strict=True):
        for factor, found in ((0.97, True), (1.03, False)):
            moved = replace(look, covariance=covariance, predicted=middle + factor * gate * np.sqrt(value) * axis)
            chosen = select_target(regions, moved, None, DetectionConfig())
            assert isinstance(chosen, Group) is found, chosen
