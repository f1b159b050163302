"""Candidates of a whole frame with the learned channel: an aircraft comes before what else stands out."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.kept_place import likeliest_places
from groundstation.detection.learned_channel import ChannelMaps, LearnedChannel
from groundstation.detection.learned_finder import LearnedFinder, distinct, grid_of
from groundstation.detection.proposal_finder import ProposalFinder
from groundstation.geometry.camera import Lens
from tests.detection.test_learned_detector import SIZE_PX, drawn, picture, sky

LEARNED = DetectionConfig(detector=DetectorKind.LEARNED)
# upper left of a dark disc, px, and its diameter
BALL_PX, BALL_SIZE_PX = (430, 120), 36


def test_an_aircraft_comes_before_what_stands_out_more(rng: np.random.Generator) -> None:
    image, nose = picture(drawn(13), (200, 200), 40.0, rng)
    x0, y0 = BALL_PX
    rows, columns = np.mgrid[0:BALL_SIZE_PX, 0:BALL_SIZE_PX] - 0.5 * (BALL_SIZE_PX - 1)
    image[y0 : y0 + BALL_SIZE_PX, x0 : x0 + BALL_SIZE_PX][np.hypot(rows, columns) < 0.5 * BALL_SIZE_PX] = 10
    classic = CandidateFinder(AcquisitionConfig(), SIZE_PX).find(image, 0.0)
    assert classic[0].u_px > x0
    found = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX).find(image, 0.0)
    # each proposal is there, but two of one aircraft are one candidate
    for c in classic:
        assert any(abs(f.u_px - c.u_px) < 0.6 * f.box.w + 2.0 and abs(f.v_px - c.v_px) < f.box.h + 2.0 for f in found)
    assert len([f for f in found if f.odds is not None and f.odds > 0.0]) == 1
    assert len(found) == len(classic) - 1
    best, other = found[0], next(c for c in found if c.u_px > x0)
    assert np.hypot(best.u_px - nose[0], best.v_px - nose[1]) < 3.0
    assert 0.7 * 40.0 < best.box.w < 1.3 * 40.0
    assert other.score < 0.3 * best.score
    # what the network does not know can still start a track
    assert other.score > 0.0


def test_a_box_at_the_border_stays_inside(rng: np.random.Generator) -> None:
    image, _ = picture(drawn(13), (0, 0), 60.0, rng)
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    for t_s in (0.0, 0.3):
        candidates = finder.find(image, t_s)
        assert candidates or t_s > 0.0
        for found in candidates:
            assert 0.0 <= found.box.x0 < found.box.x1 <= SIZE_PX[0]
            assert 0.0 <= found.box.y0 < found.box.y1 <= SIZE_PX[1]
    finder.reset()


def test_a_copy_beyond_the_border_is_no_candidate(rng: np.random.Generator) -> None:
    """Wings that the border cuts go on in the window, where it repeats the picture's last column."""
    image, _ = picture(drawn(13), (280, 200), 90.0, rng)
    for left in (300, 320, 340, 355):
        part = np.ascontiguousarray(image[:, left:])
        size = part.shape[1], part.shape[0]
        for found in LearnedFinder(AcquisitionConfig(), LEARNED, size).find(part, 0.0):
            assert 0.0 <= found.box.x0 < found.box.x1 <= size[0]
            assert 0.0 <= found.u_px <= size[0] - 1.0


def ground(image: np.ndarray, sprite_box: tuple[slice, slice], rng: np.random.Generator) -> np.ndarray:
    """Return a picture with 30 dark and bright discs all around a part of it: all of them stand out more."""
    spotted = image.copy()
    keep = image[sprite_box].copy()
    for _ in range(30):
        at = int(rng.uniform(20, SIZE_PX[0] - 20)), int(rng.uniform(20, SIZE_PX[1] - 20))
        cv2.circle(spotted, at, int(rng.uniform(6, 16)), [int(rng.choice((0, 255)))] * 3, -1)
    spotted[sprite_box] = keep
    return spotted


def test_an_aircraft_that_the_proposal_network_proposes_is_found_at_once_and_kept(rng: np.random.Generator) -> None:
    """Expected: among 30 discs that stand out more, in the first frame, and in each one from then on."""
    plain, nose = picture(drawn(13), (280, 200), 44.0, rng)
    image = ground(plain, (slice(180, 240), slice(262, 342)), rng)
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    assert all(_is_found(finder.find(image, k / 30.0), nose) for k in range(8))


def test_an_aircraft_that_is_not_proposed_is_found_in_turns_and_then_kept(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: found within so many frames as the grid needs, and in each one from then on."""
    # of a kind that the proposal network does not know
    monkeypatch.setattr(ProposalFinder, "proposals", lambda *arguments: [])
    plain, nose = picture(drawn(13), (280, 200), 44.0, rng)
    box = (slice(180, 240), slice(262, 342))
    image = ground(plain, box, rng)
    classic = CandidateFinder(AcquisitionConfig(), SIZE_PX).find(image, 0.0)
    assert all(np.hypot(c.u_px - nose[0], c.v_px - nose[1]) > 40.0 for c in classic)
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    frames = math.ceil(len(grid_of(SIZE_PX)) / 4) + 10
    seen = [_is_found(finder.find(image, 0.1 * k), nose) for k in range(frames)]
    first = seen.index(True)
    assert all(seen[first:])


def test_a_place_that_another_camera_suggests_is_looked_at_at_once(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: found in the first frame, of about the width that was expected, where it is not without the place."""
    # the proposal network would find it by itself
    monkeypatch.setattr(ProposalFinder, "proposals", lambda *arguments: [])
    plain, nose = picture(drawn(13), (450, 330), 44.0, rng)
    image = ground(plain, (slice(310, 370), slice(432, 512)), rng)
    for width_px in (30.0, 44.0, 60.0):
        finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
        assert not _is_found(finder.find(image, 0.0), nose)
        finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
        assert _is_found(finder.find(image, 0.0, None, [(nose + [15.0, -8.0], width_px)]), nose)
    # it leaves windows for the grid
    frames = math.ceil(len(grid_of(SIZE_PX)) / 2) + 10
    nowhere = [(np.array([20.0, 20.0]), 44.0)] * 2
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    assert any(_is_found(finder.find(image, 0.1 * k, None, nowhere), nose) for k in range(frames))


def test_two_widths_at_a_place_are_two_candidates_of_which_one_is_kept_first() -> None:
    def one(u_px: float, width_px: float, odds: float) -> Candidate:
        box = Box(u_px - 0.5 * width_px, 90.0, u_px + 0.5 * width_px, 110.0)
        return Candidate(u_px=u_px, v_px=100.0, box=box, score=1.0, moving=False, motion_px_s=None, odds=odds)

    fuselage, whole, same, other = (
        one(100.0, 30.0, 4.0),
        one(104.0, 60.0, 3.0),
        one(103.0, 40.0, 3.5),
        one(300.0, 40.0, 1),
    )
    assert distinct([whole, same, fuselage, other]) == [fuselage, whole, other]
    assert likeliest_places([other, whole, fuselage]) == [fuselage, other, whole]
    # what the channel does not know is never a copy
    unknown = one(100.0, 30.0, -1.0)
    assert distinct([fuselage, unknown]) == [fuselage, unknown]


def _is_found(candidates: tuple[Candidate, ...], nose: np.ndarray) -> bool:
    return any(
        c.odds is not None and c.odds > 0.0 and np.hypot(c.u_px - nose[0], c.v_px - nose[1]) < 6.0 for c in candidates
    )


def test_it_is_kept_while_the_camera_turns(rng: np.random.Generator) -> None:
    """Expected: 60 px a frame, more than its own width, to where the rotation says, and not without it."""
    lens = Lens(
        image_size_px=SIZE_PX,
        focal_px=np.array([2000.0, 2000.0]),
        principal_point_px=np.array([320.0, 240.0]),
        distortion=np.zeros(5),
    )
    for knows in (True, False):
        finder = LearnedFinder(AcquisitionConfig(max_candidates=1), LEARNED, SIZE_PX, lens)
        kept = []
        for k in range(4):
            image, nose = picture(drawn(13), (100 + 60 * k, 200), 40.0, rng)
            angle = math.atan(60.0 / 2000.0) * k
            turned = np.array(
                [[math.cos(angle), 0.0, math.sin(angle)], [0.0, 1.0, 0.0], [-math.sin(angle), 0.0, math.cos(angle)]]
            )
            looked = finder.places_kept(turned if knows else None)
            finder.find(image, 0.1 * k, turned if knows else None)
            if k > 0:
                assert looked
                kept.append(any(np.hypot(*(place - nose)) < 25.0 for place in looked))
        assert kept == 3 * [knows]


def test_what_two_frames_do_not_show_is_looked_at_again(rng: np.random.Generator) -> None:
    image, nose = picture(drawn(13), (280, 200), 44.0, rng)
    empty = np.clip(sky(rng), 0.0, 255.0).round().astype(np.uint8)
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    assert _is_found(finder.find(image, 0.0), nose)
    waits = []
    for k in range(1, 4):
        finder.find(empty, 0.1 * k)
        waits.append(len(finder.places_kept()))
    assert waits == [1, 1, 0]


@pytest.mark.parametrize("seed", [13, 16, 17])
def test_an_aircraft_whose_wings_are_hidden_for_two_frames_is_found_at_once(
    seed: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: neither lost, nor looked at in a window that is made for its fuselage, where nothing else finds it."""
    image, nose = picture(drawn(seed), (280, 200), 60.0, rng)
    hidden = np.clip(sky(rng), 0.0, 255.0).round().astype(np.uint8)
    middle = slice(round(nose[0]) - 6, round(nose[0]) + 7)
    hidden[:, middle] = image[:, middle]
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    for k in range(2):
        assert _is_found(finder.find(image, 0.1 * k), nose)
    monkeypatch.setattr(CandidateFinder, "find", lambda *arguments: ())
    monkeypatch.setattr(ProposalFinder, "proposals", lambda *arguments: [])
    for k in range(2, 4):
        finder.find(hidden, 0.1 * k)
    found = finder.find(image, 0.4)
    assert _is_found(found, nose)
    assert max(c.box.w for c in found) > 0.6 * 60.0


@given(
    st.tuples(st.integers(320, 2000), st.integers(240, 1500)),
    st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
)
def test_the_grid_leaves_no_place_out(size_px: tuple[int, int], place: tuple[float, float]) -> None:
    """Expected: every place of every frame is within a target of a window's middle, at each of its widths."""
    at = np.array(place) * (np.array(size_px) - 1.0)
    looks = grid_of(size_px)
    for span in {look.span_px for look in looks}:
        near = min(float(np.hypot(*(look.centre_px - at))) for look in looks if look.span_px == span)
        assert near <= span
    assert {look.span_px for look in looks} >= {44.0, 88.0}


def test_a_frame_has_time_for_so_many_windows(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a picture shows, whatever others suggest, and however long ago the last one was: so `live` keeps up."""
    looks: list[int] = []
    maps = LearnedChannel.maps_with_aircraft

    def counted(channel: LearnedChannel, window: ImageArray) -> ChannelMaps | None:
        looks[-1] += 1
        return maps(channel, window)

    monkeypatch.setattr(LearnedChannel, "maps_with_aircraft", counted)
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    image = np.clip(rng.normal(128.0, 40.0, (SIZE_PX[1], SIZE_PX[0], 3)), 0.0, 255.0)
    image = cv2.GaussianBlur(image, (0, 0), 4.0)
    levels = np.clip(128.0 + 6.0 * (image - 128.0), 0.0, 255.0).astype(np.uint8)
    for k, seed in enumerate((13, 14, 16, 17, 18)):
        levels[60 * k : 60 * k + 60, 300:420] = picture(drawn(seed), (300, 60 * k), 50.0, rng)[0][
            60 * k : 60 * k + 60, 300:420
        ]
    places = [(np.array([320.0, 240.0]), 40.0)] * 2
    for t_s in (0.0, 0.03, 0.5):
        looks.append(0)
        finder.find(levels, t_s, None, places)
    assert max(looks) <= 20
    assert max(looks) > 10
