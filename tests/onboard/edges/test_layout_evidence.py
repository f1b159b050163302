"""What tells a painted line from lamps: outliers that are everyone's, dots and lines, the announced width."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.onboard.edges.layout_evidence import limited, varying, weighed_layouts
from groundstation.onboard.edges.layout_kernel import bar_information, mark_trend, refine_displacement
from groundstation.onboard.edges.line_shape import shaped
from groundstation.onboard.edges.markings import initial_markings
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import (
    EdgeProfiles,
    Layout,
    ProfileFit,
    ProfileView,
    edge_profiles,
    refined_displacement,
)
from groundstation.onboard.edges.seen_marks import seen_marks

CONFIG = ProfileConfig()
LINES, ROWS, PX_PER_M = np.array([260.0, 200.0, 300.0, 360.0]), np.array([250.0, 310.0]), np.array([2.0, 8.0])
LOOSE = np.diag(np.full(4, 1.0 / 16.0))
PAINT, LAMPS = Layout(line_m=(-0.95, -0.5), lamps_m=None), Layout(line_m=None, lamps_m=1.5)
NONE = Layout(line_m=None, lamps_m=None)


def seen(
    *, paint: float = 0.0, lamps: float = 0.0, noise: float = 8.0, blur_px: float = 0.6, rise: float = 0.0
) -> EdgeProfiles:
    """Return the profiles of a runway 20 m wide with a line half a metre inside, or lamps every 30 m outside.

    The ground may ``rise`` in brightness outwards, grey levels a metre, to 8 m from the edge.
    """
    rng, image = np.random.default_rng(5), np.zeros((480, 640, 3))
    fine = (np.arange(640 * 8) + 0.5) / 8.0 - 0.5
    for row in range(240, 320):
        t = (row - ROWS[0]) / (ROWS[1] - ROWS[0])
        m = PX_PER_M[0] * (1.0 - t) + PX_PER_M[1] * t
        left, right = (LINES[k] * (1.0 - t) + LINES[k + 1] * t for k in (0, 2))
        outside = np.maximum(left - fine, fine - right) / m
        grey = np.where(outside > 0.0, 150.0 if rise else 110.0, 125.0) + rise * np.clip(outside, 0.0, 8.0)
        grey += paint * ((outside > -0.95) & (outside < -0.5))
        # a lamp every sixth row
        grey += lamps * (row % 6 < 2) * ((outside > 1.25) & (outside < 1.75))
        image[row] = (
            grey.reshape(640, 8).mean(axis=1)[:, None]
            + np.array([12.0, 0.0, -5.0]) * (outside.reshape(640, 8).mean(axis=1) < 0.0).astype(float)[:, None]
        )
    image += noise * rng.standard_normal(image.shape)
    pixels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    steps = np.maximum(1.0, 0.24 * PX_PER_M)
    sizes = (CONFIG.blocks, 47)
    view = ProfileView(along_m=(5.0, 0.5))
    return edge_profiles(pixels, LINES, ROWS, PX_PER_M, steps, sizes, blur_px, 2.0, view)


def evidence(profiles: EdgeProfiles, layouts: list[Layout]) -> list[float]:
    fits = weighed_layouts(profiles, layouts, np.zeros(4), LOOSE, CONFIG)
    return [refined_displacement(fit, np.zeros(4), LOOSE).evidence for fit in fits]


def test_a_line_is_a_line_and_lamps_are_dots() -> None:
    """Paint was taken for a row of lamps, both edges two metres farther in, with the status tracking."""
    painted, lit, plain = (seen(**marks) for marks in ({"paint": 80.0}, {"lamps": 80.0}, {}))
    line, lamps, none = evidence(painted, [PAINT, LAMPS, NONE])
    assert line > max(lamps, none) + 10.0
    line, lamps, none = evidence(lit, [PAINT, LAMPS, NONE])
    assert lamps > max(line, none) + 10.0
    line, lamps, none = evidence(plain, [PAINT, LAMPS, NONE])
    assert none > max(line, lamps)


@pytest.mark.parametrize("rise", [2.0, 4.0, 8.0])
def test_ground_that_gets_brighter_outwards_is_no_line_on_a_wider_runway(rise: float) -> None:
    """With level ground alone a line was 11 to 52 nats ahead of the bare edge there is, and edges up to 1.2 px off.

    Both edges of two drawn approaches were held a metre too far out, tracking, 5 to 11 stated sigmas off.
    """
    profiles = seen(rise=rise)
    layouts = [NONE, *(Layout(line_m=(out_m - 0.45, out_m), lamps_m=None) for out_m in (0.0, -0.5, -1.0))]
    fits = weighed_layouts(profiles, layouts, np.zeros(4), LOOSE, CONFIG)
    none, *lines = (refined_displacement(fit, np.zeros(4), LOOSE) for fit in fits)
    assert none.evidence > max(line.evidence for line in lines) + 4.0
    assert np.abs(none.moved_px).max() < 0.3


def test_light_is_not_darker_than_the_ground_nor_paint_than_the_pavement() -> None:
    """Dark ground outside an edge was taken for lamps, 30 nats ahead, and the edges went 3 m out, tracking."""
    for dark, layout in (({"lamps": -60.0}, LAMPS), ({"paint": -40.0}, PAINT)):
        marked, none = evidence(seen(**dark), [layout, NONE])
        assert marked < none + 1.0
    bright, none = evidence(seen(lamps=60.0), [LAMPS, NONE])
    assert bright > none + 10.0


def test_an_outlier_is_one_whatever_the_layout() -> None:
    """A layout had its own best of each block of rows for a reference, wherever that put the edge."""
    fits = weighed_layouts(seen(paint=80.0), [PAINT, LAMPS], np.zeros(4), LOOSE, CONFIG)
    least = [fit.judged.least for fit in fits if fit.judged is not None]
    np.testing.assert_array_equal(least[0], least[1])
    assert fits[0].grids.max() > fits[1].grids.max()


def test_how_a_mark_varies_along_the_edge_tells_dots_from_lines() -> None:
    for ratio, dots in ((0.1, False), (3.0, True)):
        own, square, usual = 0.01 + ratio * 0.04, 0.04, 0.01
        as_lamps, as_line = (
            varying(30.0 * own, 30.0 * usual, 30.0 * square, 30.0, lamps=lamps) for lamps in (True, False)
        )
        assert (as_lamps > as_line + 3.0) == dots
        assert (as_line > as_lamps + 3.0) == (not dots)
    # where noise is stronger than the mark it says next to nothing
    hidden = [varying(30.0 * 1.01, 30.0, 30.0 * 0.01, 30.0, lamps=lamps) for lamps in (True, False)]
    assert abs(hidden[0] - hidden[1]) < 0.5


def test_a_picture_is_worth_a_limited_amount() -> None:
    assert limited(3.0, CONFIG) == pytest.approx(3.0, abs=0.02)
    assert limited(1e6, CONFIG) == pytest.approx(CONFIG.picture_limit)
    assert limited(-1e6, CONFIG) == pytest.approx(-CONFIG.picture_limit)


def test_a_bar_is_known_as_well_as_its_own_bins_allow() -> None:
    """By itself: the sum of its squared shape over the bins; next to the edge less, as pavement explains a part."""
    weight, bars = np.full((1, 41), 2.0), np.array([[[[-12.0, -8.0]]], [[[-3.0, -1.0]]], [[[0.0, 0.0]]]])
    known = np.empty((3, 1, 1, 5))
    bar_information(weight, np.array([0.6]), bars, 5, known)
    assert 4.0 < known[0, 0, 0, 2] < 8.0
    assert 0.0 < known[1, 0, 0, 2] < known[0, 0, 0, 2]
    np.testing.assert_array_equal(known[2], 0.0)


def test_the_trend_of_a_mark_is_that_of_both_edges_but_for_outliers() -> None:
    t = np.linspace(-1.0, 1.0, 8)
    excess = np.tile((0.4 + 0.05 * t)[None, :, None], (2, 1, 3))
    out = np.empty((8, 3))
    assert mark_trend(excess, np.ones((2, 8)), out) < 0.01
    np.testing.assert_allclose(out, excess[0], atol=0.015)
    excess[0, 3] = 2.0
    mark_trend(excess, np.ones((2, 8)), out)
    assert np.abs(out - excess[1]).max() < 0.1


def test_lines_are_found_between_the_trials() -> None:
    """Quadratic misfits with their least between two trials, a different one of each line."""
    at, trials = np.array([0.4, -1.3]), np.arange(25) - 12.0
    misfit = 1.0 + 0.1 * (trials[None, None, :] - at[:, None, None]) ** 2 * np.ones((2, 8, 1))
    moved, least, power = np.array([0.0, 0.0, -1.0, -1.0]), np.ones((2, 8)), np.full((2, 8), 20.0)
    refine_displacement(misfit, least, power, 1e-4, np.ones(2), np.zeros(4), 1e-6 * np.eye(4), moved)
    # in steps of a quarter; of a line both ends are as good a step aside of each other
    np.testing.assert_allclose(moved.reshape(2, 2).mean(axis=1), at, atol=0.13)


def test_a_sharper_picture_and_a_wider_line_are_found() -> None:
    markings = initial_markings(CONFIG, dark=False)
    for k in range(24):
        profiles = seen(paint=80.0, noise=3.0, blur_px=markings.blur_px or CONFIG.blur_px)
        markings = shaped(replace(markings, frames=k), profiles, np.zeros(4), PX_PER_M, CONFIG)
    # each pixel a box alone: sigma 0.29 px
    assert 0.0 < markings.blur_px < 0.6
    assert 0.35 < (markings.line_width_m or CONFIG.line_width_m) < 0.6
    assert abs(markings.line_off_m) < 0.15


def test_line_and_lamps_are_reported_by_name() -> None:
    config = ProfileConfig(lines_m=(-0.5, None, -1.0), lamps_m=(None, 2.0))
    markings = initial_markings(config, dark=False)
    alone = seen_marks(markings, config)
    assert (alone.line.probability, alone.line.outwards_m) == (1.0, -0.5)
    assert alone.lamps.probability == 0.0
    markings.times[:] = 1.0
    markings.gains[:] = -1000.0
    markings.gains[2, 0] = 0.0
    even = seen_marks(markings, config)
    assert even.line.outwards_m == pytest.approx(-0.75)
    assert even.line.sigma_m > 0.25
    markings.gains[2, 0] = -1000.0
    markings.gains[1, 1] = config.layout_alike_stated * np.log(3.0)
    lit = seen_marks(markings, config)
    assert lit.line.probability == pytest.approx(0.25)
    assert lit.lamps.probability == pytest.approx(0.75)
    assert lit.lamps.outwards_m == 2.0


def test_a_fit_without_judged_misfits_stays_on_its_grid() -> None:
    fit = ProfileFit(grids=np.zeros((2, 5, 5)), base=1.0, levels=np.zeros((2, 4, 5, 4, 3)), misfit=np.ones((2, 4, 5)),
              freedom=np.ones((2, 4)), steps=np.ones(2))  # fmt: skip
    assert refined_displacement(fit, np.zeros(4), np.eye(4)).evidence == 1.0
