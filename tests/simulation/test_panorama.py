"""A panorama is the same however its blocks come to be drawn, and a picture draws what it shows and little else."""

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scenery import draw_scenery, surroundings_of
from groundstation.simulation.scenery.panorama import DrawnPanorama
from tests.simulation.small_site import QUIET, small_station, straight

EYE_M = np.array([-20.0, -40.0, 2.0])
SEEDS = (3, 4, 8)


def panorama(seed: int, density: float = 60.0) -> DrawnPanorama:
    scenery = draw_scenery(np.random.default_rng(seed))
    assert scenery.objects
    return DrawnPanorama(scenery, EYE_M, False, density, (-3.6, 3.6), (-1.2, 1.2))


@pytest.mark.parametrize("seed", SEEDS)
def test_blocks_drawn_one_by_one_in_any_order_give_the_whole(seed: int) -> None:
    whole, other = panorama(seed).draw_all(), panorama(seed)
    rows, columns = other.blocks
    places = [(i, j) for i in range(rows) for j in range(columns)]
    for k in np.random.default_rng(seed).permutation(len(places)):
        one = np.zeros((rows, columns), dtype=bool)
        one[places[k]] = True
        other.draw(one)
    for name in ("image", "depth", "flat"):
        assert np.array_equal(getattr(whole, name), getattr(other.pixels, name)), name
    assert (whole.depth < 65535).any()


# pan, tilt, their rates: in the fine part, across its border, at the zenith, and smeared by the head's motion
LOOKS = ((0.0, 0.05, 0.0, 0.0), (0.43, 0.1, 0.2, 0.1), (2.0, 1.3, 0.0, 0.0), (0.1, 0.0, 2.5, 1.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_picture_is_the_same_as_from_surroundings_that_are_all_drawn(seed: int) -> None:
    scenery = draw_scenery(np.random.default_rng(seed))
    station = small_station()
    eye: FloatArray = station.geometry().camera_pose(0.0, 0.0).position_runway_m
    focal = float(station.lens.focal_px.max())
    world = RenderedScene(trajectory=straight((0.0, 150.0, 10.0), (0.0, -20.0, 0.0)), scenery=scenery)
    some, all_of_it = (surroundings_of(scenery, eye, focal, grey=False) for _ in range(2))
    all_of_it.draw_all()
    one, other = (RenderedCamera(world, station, QUIET, around=around) for around in (some, all_of_it))
    for look in LOOKS:
        first, second = one.film(0.5, *look), other.film(0.5, *look)
        assert np.array_equal(first.picture.whole(), second.picture.whole())
        assert first.snr == second.snr
        assert first.truth.visible_share == second.truth.visible_share
    one.draw_surroundings()
    for drawn, whole in zip(some.panoramas, all_of_it.panoramas, strict=True):
        assert np.array_equal(drawn.image, whole.image)


def test_a_picture_draws_what_it_shows() -> None:
    scenery = draw_scenery(np.random.default_rng(SEEDS[0]))
    station = small_station()
    eye: FloatArray = station.geometry().camera_pose(0.0, 0.0).position_runway_m
    around = surroundings_of(scenery, eye, float(station.lens.focal_px.max()), grey=False)
    for pixels in around.panoramas:
        pixels.depth[:] = 1
        pixels.image[:] = 0
    world = RenderedScene(trajectory=straight((0.0, 150.0, 10.0), (0.0, -20.0, 0.0)), scenery=scenery)
    RenderedCamera(world, station, QUIET, around=around).picture(0.5, 0.0, -0.04)
    fine, coarse = around.panoramas
    assert 0.02 < fine.image.any(axis=2).mean() < 0.6  # 5° × 8° and the blocks at their borders, of 50° × 17°
    assert not coarse.image.any()
