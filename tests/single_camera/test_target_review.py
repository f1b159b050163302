"""A tracker re-examines what it holds: a sign at the border after a cut is left for the aircraft in the sky."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from groundstation.arrays import ImageArray
from groundstation.box import Box, box_of_size
from groundstation.detection.candidate_finder import Candidate
from groundstation.detection.target_confirmation import ConfirmedTarget
from groundstation.messages import Detection
from groundstation.single_camera.pixel_tracker import PixelTracker
from groundstation.single_camera.target_review import TargetReview
from tests.detection.flying import normal

W, H, RATE_HZ = 640, 360, 25.0
CUT, FRAMES = 40, 120
SIGN = Box(250, 300, 370, H)


def aircraft(picture: ImageArray, x: float, y: float, span: float, grey: int) -> None:
    """Draw an aircraft seen from behind."""

    def part(points: list[tuple[float, float]]) -> None:
        corners = np.round(np.array(points) * span + (x, y)).astype(np.int32)
        cv2.fillPoly(picture, [corners], (grey, grey, grey), cv2.LINE_AA)

    part([(-0.5, -0.03), (0.5, -0.03), (0.5, 0.03), (-0.5, 0.03)])
    part([(-0.02, -0.2), (0.02, -0.2), (0.02, 0.0), (-0.02, 0.0)])
    size = max(int(0.06 * span), 2), max(int(0.08 * span), 2)
    cv2.ellipse(picture, (int(x), int(y)), size, 0, 0, 360, (grey, grey, grey), -1, cv2.LINE_AA)


def scene(rng: np.random.Generator) -> Iterator[tuple[ImageArray, tuple[float, float]]]:
    """Frames and the aircraft's place: a large aircraft low over the ground; cut; a small one above a red shop sign."""
    sky = np.repeat(np.linspace(225, 170, H)[:, None], W, axis=1)
    for k in range(FRAMES):
        picture = np.stack([sky, 0.93 * sky, 0.85 * sky], axis=-1).astype(np.uint8)
        if k < CUT:
            picture[355:] = (60, 90, 70)
            place, span, grey = (120.0 + 3.0 * k, 310.0 - 0.5 * k), 120.0, 110
        else:
            picture[300:] = (95, 105, 100)
            left = SIGN.x0 + round(4.0 * np.sin(k / 15.0))
            cv2.rectangle(picture, (left, 310), (left + 120, H + 20), (30, 25, 215), -1)
            cv2.putText(picture, "SHOP", (left + 20, 335), cv2.FONT_HERSHEY_SIMPLEX, 1.2, (240, 240, 240), 3)
            place, span, grey = (180.0 + 2.2 * (k - CUT), 110.0 - 0.3 * (k - CUT)), 30.0, 155
        aircraft(picture, *place, span, grey)
        noise = np.float32(3.0) * normal(rng, picture.shape)
        seen = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 0.8) + noise
        yield np.clip(seen, 0, 255).astype(np.uint8), place


@pytest.mark.parametrize("given", [False, True])
def test_a_sign_at_the_border_is_left_for_the_aircraft(rng: np.random.Generator, given: bool) -> None:
    """Expected: within 2.2 s of the cut the aircraft is tracked, and to the end; the sign only before that."""
    tracker = PixelTracker((W, H))
    held = []
    for k, (picture, place) in enumerate(scene(rng)):
        if k == 0 and given:
            track = tracker.start(picture, 0.0, box_of_size(60.0, 285.0, 120.0, 40.0))
        else:
            track = tracker.step(picture, k / RATE_HZ)
        point = track.result.centroid_px if isinstance(track.result, Detection) else None
        held.append("" if point is None else "aircraft" if np.hypot(*(point - place)) < 60.0 else "sign")
    assert held[CUT - 10 : CUT].count("aircraft") >= 8
    after = held[CUT + round(2.2 * RATE_HZ) :]
    assert after.count("aircraft") >= 0.95 * len(after)
    assert "sign" not in after


def sky_with(rng: np.random.Generator, places: list[tuple[float, float]], *, square: bool = True) -> ImageArray:
    """A sky with a red square at the lower border and aircraft at places."""
    picture = np.full((H, W, 3), (210, 195, 180), np.uint8)
    if square:
        cv2.rectangle(picture, (280, 330), (320, H + 20), (30, 25, 215), -1)
    for place in places:
        aircraft(picture, *place, 40.0, 60)
    return np.clip(picture + np.float32(2.0) * normal(rng, picture.shape), 0, 255).astype(np.uint8)


SQUARE = Box(280.0, 330.0, 320.0, float(H))


def reviewed(
    rng: np.random.Generator, review: TargetReview, place: list[tuple[float, float]], frames: int
) -> int | None:
    """The frame in which the square is to be replaced; None if never."""
    for k in range(frames):
        moved = [(x + 1.5 * k, y) for x, y in place]
        if review.rival(sky_with(rng, moved), k / RATE_HZ, SQUARE) is not None:
            return k
    return None


def test_what_is_no_aircraft_is_replaced_by_one(rng: np.random.Generator) -> None:
    found = reviewed(rng, TargetReview((W, H)), [(200.0, 100.0)], 60)
    assert found is not None
    assert found > 0.8 * RATE_HZ


def test_nothing_is_replaced_where_nothing_better_is(rng: np.random.Generator) -> None:
    assert reviewed(rng, TargetReview((W, H)), [], 60) is None


def test_a_given_target_that_was_never_recognised_is_kept(rng: np.random.Generator) -> None:
    """Expected: the user wants it, whatever it is."""
    review = TargetReview((W, H))
    review.reset(given=True)
    assert reviewed(rng, review, [(200.0, 100.0)], 60) is None


def test_sights_far_apart_in_time_replace_nothing(rng: np.random.Generator) -> None:
    """Expected: a rival has to be seen in frames running."""
    review = TargetReview((W, H))
    for k in range(90):
        places = [(100.0 + 4.0 * k, 100.0)] if k % 12 == 0 else []
        assert review.rival(sky_with(rng, places), k / RATE_HZ, SQUARE) is None


def test_a_refused_candidate_does_not_make_a_given_target_a_found_one(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: what is given stays given until another target is taken."""
    tracker = PixelTracker((W, H))
    resets: list[bool] = []
    monkeypatch.setattr(tracker._review, "reset", lambda *, given: resets.append(given))
    tracker.start(sky_with(rng, [(200.0, 100.0)]), 0.0, box_of_size(180.0, 85.0, 40.0, 25.0))
    assert resets[-1] is True
    empty = sky_with(rng, [], square=False)
    candidate = Candidate(
        u_px=500.0, v_px=50.0, box=box_of_size(480.0, 40.0, 40.0, 20.0), score=9.0, moving=True, motion_px_s=None
    )
    found = ConfirmedTarget(candidate=candidate, velocity_px_s=(0.0, 0.0))
    assert tracker._take(empty, 0.1, found) is None
    assert resets[-1] is True


def test_an_aircraft_is_not_left_for_another(rng: np.random.Generator) -> None:
    review = TargetReview((W, H))
    for k in range(60):
        x = 200.0 + 1.5 * k
        picture = sky_with(rng, [(x, 100.0), (x + 100.0, 200.0)], square=False)
        assert review.rival(picture, k / RATE_HZ, box_of_size(x - 20.0, 90.0, 40.0, 14.0)) is None
