"""Which stars: solved alone, matched by a model, heads from solved pictures; wrong solutions are found out."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.stars.head_start import StarFitError, head_start
from calibration.stars.identified_stars import by_station
from calibration.stars.sky import SkyOverSite
from calibration.stars.star_images import StarImages
from calibration.stars.star_solver import CatalogueStars, SolvedPicture, match_stars
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector
from tests.calibration.stars.nights import night, pictures, solver


def images(pixel_px: np.ndarray, flux: np.ndarray) -> StarImages:
    n = len(flux)
    return StarImages(pixel_px=pixel_px, sigma_px=np.full(n, 0.1), flux=flux, spread_px=0.9, noise=3.0)


def catalogue(magnitude: np.ndarray) -> CatalogueStars:
    n = len(magnitude)
    return CatalogueStars(number=np.arange(n), ra_rad=np.zeros(n), dec_rad=np.zeros(n), magnitude=magnitude)


def test_dots_that_are_no_stars_are_not_solved(rng: np.random.Generator) -> None:
    """Expected: of 150 pictures of random dots, none."""
    for _ in range(150):
        count = int(rng.integers(6, 60))
        dots = images(rng.uniform((0, 0), (1279, 959), (count, 2)), np.sort(rng.uniform(50, 3000, count))[::-1])
        assert isinstance(solver().solve(dots), str)


def test_few_stars_are_told() -> None:
    assert solver().solve(images(np.zeros((1, 2)), np.ones(1))) == "1 star, at least 6 are needed"


def test_stars_are_matched_one_to_one_by_place_and_brightness(rng: np.random.Generator) -> None:
    n = 30
    u, v = np.meshgrid(np.arange(6) * 200.0 + 50, np.arange(5) * 180.0 + 50)
    expected = np.column_stack([u.ravel(), v.ravel()])
    magnitude = rng.uniform(3.0, 7.0, n)
    shown = expected + rng.normal(0.0, 0.3, (n, 2))
    flux = 10.0 ** (-0.4 * (magnitude - 10.0))
    # an aircraft at a faint star's place, and one star that is not in the catalogue
    faint = int(np.argmax(magnitude))
    flux[faint] *= 100.0
    seen = images(np.vstack([shown, [[1000.0, 800.0]]]), np.append(flux, 50.0))
    image, star = match_stars(seen, catalogue(magnitude), expected, 3.0)
    np.testing.assert_array_equal(image, star)
    assert set(image.tolist()) == set(range(n)) - {faint}


def test_a_star_that_another_blends_with_is_left_out() -> None:
    expected = np.array([[100.0, 100.0], [104.0, 100.0], [400.0, 300.0]])
    seen = images(np.array([[101.5, 100.0], [400.0, 300.0]]), np.array([150.0, 100.0]))
    image, star = match_stars(seen, catalogue(np.array([5.0, 5.5, 5.4])), expected, 3.0)
    assert image.tolist() == [1]
    assert star.tolist() == [2]


def attitudes(seed: int) -> tuple[list, list[np.ndarray]]:
    """Return the pictures of the left head, and true attitudes."""
    drawn = night(seed)
    geometry = drawn.true_rig["left"].geometry()
    taken = drawn.pictures["left"]
    return list(pictures(seed)["left"]), [
        geometry.camera_pose(*p.angles_rad.tolist()).runway_from_camera for p in taken
    ]


def test_a_heads_orientation_comes_from_its_pictures_and_wrong_ones_are_found_out(rng: np.random.Generator) -> None:
    own, true = attitudes(1)
    wrong = [2, 5, 6]
    for k in wrong:
        true[k] = rotation_from_vector(rng.uniform(-2.0, 2.0, 3)) @ true[k]
    start = head_start(night(1).rig["left"], own, true)
    assert np.flatnonzero(~start.agrees).tolist() == wrong
    truth = night(1).true_rig["left"]
    for name in ("runway_from_base_wxyz", "head_from_camera_wxyz"):
        turned = matrix_from_wxyz(getattr(start.station, name)) @ matrix_from_wxyz(getattr(truth, name)).T
        assert np.degrees(np.arccos(min(1.0, 0.5 * (np.trace(turned) - 1.0)))) < 1.5, name


@pytest.mark.parametrize("axis", [0, 1])
def test_angles_with_a_wrong_sign_are_refused(axis: int) -> None:
    own, true = attitudes(1)
    flip = np.where(np.arange(2) == axis, -1.0, 1.0)
    turned = [replace(p, reading_rad=p.reading_rad * flip) for p in own]
    with pytest.raises(StarFitError, match=r"signs of docs/conventions\.md"):
        head_start(night(1).rig["left"], turned, true)


def test_two_pictures_are_too_few() -> None:
    own, true = attitudes(1)
    with pytest.raises(StarFitError, match="got 2 pictures whose stars were recognised"):
        head_start(night(1).rig["left"], own[:2], true[:2])


def test_a_picture_elsewhere_has_no_star_by_chance() -> None:
    """Expected: the stars of one picture are not found where another one looks."""
    drawn = night(1)
    sky, own = SkyOverSite(drawn.site), pictures(1)["left"]
    station = drawn.true_rig["left"]
    for k, picture in enumerate(own):
        elsewhere = replace(picture, reading_rad=own[(k + 4) % len(own)].reading_rad)
        assert by_station(elsewhere, station, solver(), sky, 5.0, None) is None


def test_all_stars_of_a_picture_are_found_by_the_true_station() -> None:
    drawn = night(2)
    sky = SkyOverSite(drawn.site)
    counts = []
    for picture in pictures(2)["left"]:
        found = by_station(picture, drawn.true_rig["left"], solver(), sky, 5.0, None)
        solved = solver().solve(picture.seen)
        if isinstance(solved, SolvedPicture):
            assert found is not None
            common = set(found.stars.number.tolist()) & set(solved.stars.number.tolist())
            assert len(common) > 0.7 * len(solved.stars)
        if found is not None:
            assert len(set(found.stars.number.tolist())) == len(found.image) == len(set(found.image.tolist()))
            counts.append(len(found.image))
    assert np.median(counts) > 15
