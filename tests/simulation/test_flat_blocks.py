"""Which blocks of a panorama are bilinear in their corners."""

import numpy as np
import pytest

from groundstation.simulation.render_kernels import TILE, flat_blocks


@pytest.mark.parametrize(("off", "flat"), [(0, True), (2, True), (3, False)])
def test_a_block_may_be_off_by_just_so_much(off: int, flat: bool) -> None:
    panorama = np.zeros((2 * TILE, 2 * TILE, 3), np.uint8)
    panorama[TILE + 4, TILE + 6, 1] = off
    out = np.zeros((2, 2), dtype=bool)
    flat_blocks(panorama, 2.0, out)
    assert out.tolist() == [[True, True], [True, flat]]
