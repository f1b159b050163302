"""Trees are before the hills, dark and green."""

import numpy as np

from groundstation.simulation.scenery import Scenery
from groundstation.simulation.scenery.scenery_kernels import column_at, radiance, row_at
from groundstation.simulation.scenery.tones import tables_of, tones_of


def colours(elevation: float) -> np.ndarray:
    eye, room = np.array([0.0, 0.0, 1.6]), np.empty((2, 3))
    scenery = Scenery(seed=5, runway_half_width_m=15.0, runway_from_y_m=-900.0, runway_to_y_m=0.0)
    tones, tables = tones_of(scenery), tables_of(scenery)
    found = np.zeros((400, 3))
    for row, azimuth in zip(found, np.linspace(-3.0, 3.0, 400), strict=True):
        column = column_at(tones, azimuth, 2e-4, eye)
        radiance(tones, tables, column, row_at(tones, elevation, eye), 2e-4, eye, row, room)
    return found


def test_some_directions_just_above_the_ground_show_trees_and_others_hills() -> None:
    low = colours(0.002)
    tree = (low[:, 1] > low[:, 0] + 8.0) & (low[:, 1] > low[:, 2] + 5.0) & (low.max(axis=1) < 135.0)
    hill = (low[:, 0] > 140.0) & (low[:, 0] > low[:, 2] + 10.0)
    assert 0.1 < tree.mean() < 0.9
    assert hill.mean() > 0.05
    # far above them there are none
    high = colours(0.3)
    assert not ((high[:, 1] > high[:, 0] + 8.0) & (high[:, 1] > high[:, 2] + 5.0)).any()
