"""Pictures of another size than a lens's: how the two are related is said."""

import pytest

from groundstation.rig.rig_limits import size_relation


@pytest.mark.parametrize(
    ("got", "lens", "words"),
    [
        (
            (640, 480),
            (1280, 960),
            "; focal_px of that size times 0.5, and each c of principal_point_px as (c + 0.5) × 0.5 − 0.5, are those",
        ),
        ((640, 480), (1280, 960), "are those of the pictures, unless cut"),
        ((1920, 1080), (1280, 720), "(c + 0.5) × 1.5 − 0.5, are those"),
        # rounded to whole pixels
        ((427, 240), (1280, 720), "focal_px of that size times 0.333594, and"),
        ((960, 1280), (1280, 960), "; width and height are exchanged: are the pictures turned by 90 deg?"),
        (
            (480, 640),
            (1280, 960),
            "; width and height are exchanged (and the size is that times 0.5): are the pictures",
        ),
        ((1280, 720), (1280, 960), "; another shape, so one of the two is a part of the sensor"),
    ],
)
def test_the_relation_is_named(got: tuple[int, int], lens: tuple[int, int], words: str) -> None:
    assert words in size_relation(got, lens)
