"""A picture's levels: rounded, black stays black, white is the most; and how fine the surroundings are drawn."""

import math

import numpy as np
import pytest

from groundstation.simulation.render_kernels import expose
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.scenery.surroundings import (
    _COARSER,
    _FINE_SHARE,
    _MAX_COARSE_DENSITY,
    surroundings_of,
)


def test_levels_without_noise_are_rounded_and_clipped() -> None:
    light = np.array([[0, 64, 96, 95, 64 * 300]], np.uint16)
    out = np.empty((1, 5), np.uint8)
    expose(light, 1.0, 0.0, 0.0, np.zeros(8, np.float32), np.zeros(1, np.int64), out)
    assert out.tolist() == [[0, 1, 2, 1, 255]]


def test_noise_has_the_stated_variance_and_never_wraps() -> None:
    normals = np.random.default_rng(4).normal(size=40_000).astype(np.float32)
    out = np.empty((1, 40_000), np.uint8)
    for level in (0, 100, 255):
        light = np.full((1, 40_000), 64 * level, np.uint16)
        expose(light, 1.0, 0.05, 4.0, normals, np.zeros(1, np.int64), out)
        if level == 100:
            assert out.var() == pytest.approx(0.05 * 100 + 4.0 + 1.0 / 12.0, rel=0.03)
        assert abs(out.astype(int) - level).max() < 25


@pytest.mark.parametrize("focal_px", [50.0, 500.0, 7000.0])
def test_what_is_around_is_drawn_coarser_and_never_too_fine(focal_px: float) -> None:
    fine, coarse = (p.place[2] for p in surroundings_of(Scenery(), np.zeros(3), focal_px, grey=False).panoramas)
    assert fine <= _FINE_SHARE * focal_px
    assert coarse == pytest.approx(min(fine / _COARSER, _MAX_COARSE_DENSITY))
    assert math.isfinite(coarse)
