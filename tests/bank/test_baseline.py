"""The baseline's start: the true box, never too flat for OpenCV's CSRT, and the true nose in it."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.bank.baseline import LEAST_BOX_PX, coverage_of, nose_pixel, start_box
from groundstation.bank.csrt_process import CsrtProcess
from groundstation.box import Box
from groundstation.errors import InputError
from groundstation.session import Truth
from groundstation.sources.true_silhouettes import TrueSilhouette


def test_the_tracker_starts_in_the_true_box() -> None:
    mask = np.zeros((20, 40), dtype=bool)
    mask[3:15, 5:35] = True
    assert start_box(TrueSilhouette(x=100, y=50, mask=mask)) == Box(105.0, 53.0, 135.0, 65.0)


def test_a_flat_silhouette_gives_a_box_of_the_least_height_about_its_middle() -> None:
    box = start_box(TrueSilhouette(x=10, y=20, mask=np.ones((2, 30), dtype=bool)))
    assert (box.x0, box.x1) == (10.0, 40.0)
    assert box.h == LEAST_BOX_PX
    assert 0.5 * (box.y0 + box.y1) == 21.0


def test_the_nose_is_that_of_the_frame_s_time() -> None:
    pixels = np.array([[10.0, 20.0], [11.0, 21.0], [12.0, 22.0]])
    exact = Truth(
        t_s=np.array([5.0, 5.1, 5.2]),
        position_runway_m=np.zeros((3, 3)),
        pixels_px={"left": pixels},
        visible={"left": np.array([True, True, False])},
    )
    found = nose_pixel(exact, "left", 5.11)
    assert found is not None
    np.testing.assert_array_equal(found, pixels[1])
    assert nose_pixel(exact, "left", 5.2) is None


def test_coverage_is_counted_as_the_program_s_own_is() -> None:
    """Expected: neither what was before its first estimate nor what two cameras see no more counts against it."""
    seen = np.zeros(100, dtype=bool)
    seen[20:80] = True
    assert coverage_of(np.arange(25, 95), seen) == 1.0
    assert coverage_of(np.arange(25, 95, 5), seen) == 11 / 55
    assert coverage_of(np.zeros(0, dtype=np.intp), seen) == 0.0
    assert coverage_of(np.arange(85, 95), seen) == 0.0
    assert coverage_of(np.arange(25, 95), np.zeros(100, dtype=bool)) is None


def test_a_tracker_that_ends_is_named(tmp_path: Path) -> None:
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(0o755)
    with CsrtProcess(program) as tracker, pytest.raises(InputError, match=str(program)):
        tracker.start(np.zeros((4, 4, 3), np.uint8), Box(0.0, 0.0, 2.0, 2.0))
