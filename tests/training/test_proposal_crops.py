"""Crops of the proposal network: labels where things are, at the widths that a level shows."""

import math

import cv2
import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.proposal_finder import CELL_PX, MIDDLE_WIDTH_PX, WIDTHS_PX
from training.filmed_pictures import FilmedPicture, PictureRequest, load_pictures, make_pictures, save_pictures
from training.proposal_crops import CROP_PX, crops_of, is_learned

NONE = np.empty((0, 4))


def picture(aircraft: list[list[float]], birds: list[list[float]] | None = None) -> FilmedPicture:
    """A noisy picture with a dark box for each aircraft."""
    image = np.random.default_rng(2).integers(140, 160, (480, 640, 3), dtype=np.uint8)
    for x0, y0, x1, y1 in aircraft:
        image[int(y0) : int(y1), int(x0) : int(x1)] = 20
    return FilmedPicture(
        jpeg=cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 97])[1].tobytes(),
        aircraft=np.array(aircraft, np.float64).reshape(-1, 4),
        birds=NONE if birds is None else np.array(birds, np.float64),
        unclear=NONE,
        kinds=("glider",),
    )


def test_a_mark_is_where_the_aircraft_is_and_says_how_wide(rng: np.random.Generator) -> None:
    """Expected: at each mark the crop is dark, and the place and width that are learned are those of the dark box."""
    learned = 0
    for crop in crops_of(picture([[300.0, 200.0, 360.0, 224.0]]), 40, rng):
        assert crop.planes.shape == (3, CROP_PX, CROP_PX)
        for row, column in zip(*np.nonzero(crop.marks[0] == 1.0), strict=True):
            learned += 1
            width = MIDDLE_WIDTH_PX * 2.0 ** float(crop.places[0, row, column])
            assert WIDTHS_PX[0] <= width <= WIDTHS_PX[1]
            middle = (np.array([column, row]) + 0.5 + crop.places[1:, row, column]) * CELL_PX
            x, y = (int(value) for value in middle)
            assert crop.planes[0, y, x] < -0.5
            # as dark up to its ends, and not beyond
            ends = [int(middle[0] + side * width) for side in (-0.35, 0.35, -0.9, 0.9)]
            inside = [crop.planes[0, y, end] < -0.5 for end in ends if 0 <= end < CROP_PX]
            if len(inside) == len(ends):
                assert inside == [True, True, False, False]
    assert learned > 15


@pytest.mark.parametrize(
    ("width", "height", "x", "bird", "learned"),
    [
        (14.0, 5.0, 100.0, False, True),
        (8.0, 3.0, 100.0, False, True),
        # of no shape, or nearly as wide as what is learned: neither
        (14.0, 1.0, 100.0, False, None),
        (6.0, 3.0, 100.0, False, None),
        (35.0, 9.0, 100.0, False, None),
        # what another level of the pyramid shows is background
        (4.0, 2.0, 100.0, False, False),
        (60.0, 20.0, 100.0, False, False),
        # a middle beyond the picture
        (14.0, 5.0, 199.0, False, None),
        (60.0, 20.0, 199.0, False, None),
        (5.0, 2.0, 100.0, True, True),
        (3.0, 2.0, 100.0, True, None),
        (40.0, 2.0, 100.0, True, None),
    ],
)
def test_what_is_learned_of_which_width(
    width: float, height: float, x: float, bird: bool, learned: bool | None
) -> None:
    at = np.array([x, 80.0, x + width, 80.0 + height])
    assert is_learned(at, Box(0, 0, 200, 200), bird=bird) is learned


def test_birds_have_marks_of_their_own(rng: np.random.Generator) -> None:
    crops = crops_of(picture([], [[50.0, 60.0, 70.0, 70.0]]), 60, rng)
    assert sum(bool((crop.marks[1] == 1.0).any()) for crop in crops) > 5
    assert not any((crop.marks[0] > 0.0).any() or crop.near.any() for crop in crops)


def test_pictures_of_worlds_are_the_same_again_and_from_their_file(tmp_path_factory: pytest.TempPathFactory) -> None:
    request = PictureRequest(worlds=1, first=2, pictures=3)
    made = make_pictures(request)
    path = tmp_path_factory.mktemp("pictures") / "pictures.npz"
    save_pictures(made, path)
    assert made
    for first, again, read in zip(made, make_pictures(request), load_pictures(path), strict=True):
        assert first.jpeg == again.jpeg == read.jpeg
        assert first.kinds == read.kinds
        for name in ("aircraft", "birds", "unclear"):
            assert np.array_equal(getattr(first, name), getattr(read, name))
        h, w = first.image().shape[:2]
        for x0, y0, x1, y1 in [*first.aircraft, *first.birds, *first.unclear]:
            assert 0 <= x0 < x1 <= w
            assert 0 <= y0 < y1 <= h
    assert any(len(each.aircraft) + len(each.unclear) for each in made)
    assert not math.isnan(float(made[0].aircraft.sum()))
