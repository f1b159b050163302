"""Ground that looks like a painted line: the edge may lie on either side of what was taken for one."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.onboard.edges import hidden_paint
from groundstation.onboard.edges.line_tracking import side_lines_of
from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.markings import initial_markings
from groundstation.onboard.edges.profile import edges_by_profile
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.search_band import RunwayGuess
from tests.onboard.edges.seen import KAPPA, ROWS, RUNWAY, approach, painted_runway

CONFIG = ProfileConfig()
Colour = tuple[int, int, int]


def open_m2(
    outside: Colour, *, line: bool, usual: ProfileConfig = CONFIG, inside: Colour = (120, 120, 124)
) -> FloatArray:
    """Return what a hidden line adds to the second moment of the edges, (4,) m²."""
    pose = approach()
    image = painted_runway(pose, inside=inside, outside=outside)
    crossings, _ = project_lines(RUNWAY, line_map(pose, KAPPA), ROWS)
    px_per_m = (crossings[2:] - crossings[:2]) / 18.0
    markings = initial_markings(usual, dark=False)
    markings = markings if line else replace(markings, places=(1, 0))
    found = [
        edges_by_profile(
            image, crossings, ROWS, px_per_m, crossings, 4.0 * np.eye(4), markings, config, layouts=0
        ).unsettled_px2
        for config in (usual, replace(usual, merged_share=0.0))
    ]
    assert found[0] is not None
    assert found[1] is not None
    return np.asarray(np.diag(found[0] - found[1]) / np.tile(px_per_m, 2) ** 2)


def test_a_line_that_looks_like_the_ground_may_be_none() -> None:
    """Bare edges before dry ground were taken for a line with the edge a metre outside it, at a sigma of 0.7 px."""
    place, width = -0.5, CONFIG.line_width_m
    bright = open_m2((190, 190, 190), line=True)
    np.testing.assert_allclose(bright, CONFIG.merged_share * (width - place) ** 2)
    # and where none is held there may be one
    np.testing.assert_allclose(open_m2((190, 190, 190), line=False), CONFIG.merged_share * 0.9**2)


def test_a_wide_runways_line_hides_as_much_more_of_it() -> None:
    """Lines of runways of 30 m and more are twice as wide: hidden on pale ground, edges were 1.1 to 1.7 m inside."""
    wide = side_lines_of(CONFIG, RunwayGuess(width_m=44.0))
    bright = open_m2((190, 190, 190), line=False, usual=wide)
    np.testing.assert_allclose(bright, CONFIG.merged_share * (0.9 + CONFIG.merged_m) ** 2)


@pytest.mark.parametrize(("inside", "outside"), [((120, 120, 124), (212, 212, 216)), ((66, 66, 68), (117, 117, 119))])
def test_where_no_paint_is_resolved_neutral_ground_hides_it_for_sure(
    monkeypatch: pytest.MonkeyPatch, inside: Colour, outside: Colour
) -> None:
    """The same snow at 55 % of the exposure was no longer white, and the edges four times as sure."""
    monkeypatch.setattr(hidden_paint, "_RESOLVED_PX_PER_M", 99.0)
    hidden = (CONFIG.line_width_m + CONFIG.merged_m) ** 2
    np.testing.assert_allclose(open_m2(outside, line=False, inside=inside), hidden)


@pytest.mark.parametrize("line", [False, True])
def test_ground_darker_than_the_pavement_hides_no_line(*, line: bool) -> None:
    np.testing.assert_allclose(open_m2((60, 90, 60), line=line), 0.0, atol=1e-12)
