"""Proposals of a whole picture: an aircraft is among the first, wherever it is and however wide."""

import copy
import itertools

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.arrays import ImageArray
from groundstation.detection.proposal_finder import ProposalFinder, network_input, parts_of
from groundstation.errors import InputError
from groundstation.files.channel_weights import proposal_weights
from tests.detection.test_learned_detector import SIZE_PX, drawn, picture


def finder(size_px: tuple[int, int] = SIZE_PX) -> ProposalFinder:
    return ProposalFinder(proposal_weights(), size_px)


@pytest.mark.parametrize("width_px", [14.0, 20.0, 40.0, 80.0])
@pytest.mark.parametrize("corner", [(60, 60), (300, 200), (480, 330)])
def test_an_aircraft_is_among_the_first(width_px: float, corner: tuple[int, int], rng: np.random.Generator) -> None:
    image, nose = picture(drawn(13), corner, width_px, rng)
    found = finder()
    first = found.proposals(image, range(found.count), 4)
    assert any(
        np.hypot(*(p.centre_px - nose)) < max(0.6 * width_px, 6.0) and 0.4 < p.width_px / width_px < 2.5 for p in first
    )
    assert all(a.odds >= b.odds for a, b in itertools.pairwise(first))


def test_the_parts_give_what_the_whole_does(rng: np.random.Generator) -> None:
    """Expected: the best proposal of all parts is the best one of the parts one by one, and their number is bounded."""
    image, _ = picture(drawn(13), (300, 200), 30.0, rng)
    found = finder()
    whole = found.proposals(image, range(found.count), 5)
    parts = [p for k in range(found.count) for p in found.proposals(image, range(k, k + 1), 5)]
    assert len(whole) <= 5
    best = max(parts, key=lambda p: p.odds)
    assert np.allclose(best.centre_px, whole[0].centre_px)
    assert best.odds == whole[0].odds


@given(st.integers(64, 3000), st.integers(64, 2200))
def test_every_row_of_every_level_belongs_to_one_part(w: int, h: int) -> None:
    parts = [part for group in parts_of((w, h)) for part in group]
    reductions = sorted({part.reduction for part in parts})
    assert reductions[0] == 1
    assert all(b == 2 * a for a, b in itertools.pairwise(reductions))
    for reduction in reductions:
        rows = sorted((p.from_row, p.to_row) for p in parts if p.reduction == reduction)
        assert rows[0][0] == 0
        assert rows[-1][1] * reduction >= h - reduction
        assert all(a[1] == b[0] for a, b in itertools.pairwise(rows))


def test_exposure_and_even_haze_do_not_matter(rng: np.random.Generator) -> None:
    image, _ = picture(drawn(13), (300, 200), 30.0, rng)
    brighter = np.clip(image.astype(np.float32) * 0.5 + 60.0, 0, 255).astype(np.uint8)
    first, second = network_input(image), network_input(brighter)
    # relative to the spread around, but for what a level is rounded to
    busy = np.abs(first[0]) > 2.0
    assert np.median(np.abs(first[0] - second[0])[busy] / np.abs(first[0])[busy]) < 0.25


def test_a_grey_picture_has_no_colour(rng: np.random.Generator) -> None:
    grey = np.repeat(rng.integers(0, 255, (64, 96, 1), dtype=np.uint8), 3, axis=2)
    assert np.array_equal(network_input(grey)[2], np.zeros((64, 96), np.float32))


def test_pictures_of_all_sizes_and_none_of_the_weights(rng: np.random.Generator) -> None:
    for size in ((64, 64), (101, 67), (641, 479)):
        image = np.ascontiguousarray(cv2.resize(_noise(rng), size))
        found = finder(size)
        for p in found.proposals(image, range(found.count), 12):
            assert -0.5 <= p.centre_px[0] <= size[0]
            assert -0.5 <= p.centre_px[1] <= size[1]
    again = copy.deepcopy(finder((64, 64)))
    assert again.count == finder((64, 64)).count
    with pytest.raises(InputError, match="weights of the proposal network"):
        ProposalFinder(b"none", (64, 64))


def _noise(rng: np.random.Generator) -> ImageArray:
    return rng.integers(0, 255, (200, 300, 3), dtype=np.uint8)
