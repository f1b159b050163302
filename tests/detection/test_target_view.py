"""What is the target, what is a second object next to it, and what is in its place, decided by the predicted path."""

import numpy as np
import pytest

from groundstation.box import box_of_size
from groundstation.messages import Detection, Miss, MissReason
from groundstation.single_camera.pixel_motion import PixelMotion
from groundstation.single_camera.pixel_target import PixelTarget
from groundstation.single_camera.target_view import is_second_object


def target(place_px: tuple[float, float], length_px: float) -> PixelTarget:
    motion = PixelMotion(place_px, (0.0, 0.0), sigma_px=2.0, least_shake_px=0.5, most_shake_px=20.0)
    box = box_of_size(place_px[0] - length_px / 2, place_px[1] - 3.0, length_px, 6.0)
    return PixelTarget(
        motion=motion,
        size_px=(length_px, 6.0),
        begun_s=0.0,
        newest_s=1.0,
        seen_s=1.0,
        checked_s=1.0,
        box=box,
        proven=True,
        span_px=None,
    )


def seen(u_px: float, v_px: float, w_px: float = 10.0, h_px: float = 6.0) -> Detection:
    return Detection(
        u_px=u_px,
        v_px=v_px,
        covariance_px2=np.eye(2),
        noise_px2=0.1 * np.eye(2),
        centroid_px=np.array([u_px, v_px]),
        box=box_of_size(u_px - w_px / 2, v_px - h_px / 2, w_px, h_px),
        area_px=0.6 * w_px * h_px,
        contour_px=np.zeros((0, 2), np.float32),
        contrast_to_noise=20.0,
        channel="grey",
    )


@pytest.mark.parametrize(
    ("first", "other", "second_object"),
    [
        (seen(101.0, 50.0, 3.0, 4.0), seen(87.0, 45.0), True),  # a part of the target, and a bird next to it
        (seen(101.0, 50.0, 30.0, 20.0), seen(90.0, 46.0), False),  # the second is part of the first
        (seen(101.0, 50.0, 3.0, 4.0), seen(98.0, 51.0, 2.0, 2.0), False),  # both are in the target's place
        (seen(115.0, 50.0, 3.0, 4.0), seen(87.0, 45.0), False),  # neither is
        (Miss(reason=MissReason.NO_REGION), seen(87.0, 45.0), False),
    ],
)
def test_a_second_object_is_found_next_to_the_target(
    first: Detection | Miss, other: Detection, second_object: bool
) -> None:
    assert is_second_object(target((100.0, 50.0), 10.0), first, other) is second_object
