"""Algorithm 1, the strip, what is painted, and the baselines, on painted pictures."""

import numpy as np

from groundstation.onboard.edges.baselines import graph_cut_edges, hough_edges
from groundstation.onboard.edges.detection import (
    DetectedPairs,
    EdgeDetectionConfig,
    NoPair,
    detect,
    lowest_minima,
    response,
)
from groundstation.onboard.edges.lines import line_map, project_lines, shifted
from groundstation.onboard.edges.marking_removal import bridge, lamp_mask, remove_markings
from groundstation.onboard.edges.search_band import across_direction, band_widths
from groundstation.onboard.edges.strip import StripConfig, find_edges, refine_edges
from tests.onboard.edges.seen import KAPPA, ROWS, RUNWAY, approach, painted_runway

POSE = approach()
E = line_map(POSE, KAPPA)
TRUTH, _ = project_lines(RUNWAY, E, ROWS)
ACROSS = across_direction(E)
WIDTHS = band_widths(TRUTH, project_lines(shifted(RUNWAY, 3.0), E, ROWS)[0], ROWS, 2.5, ACROSS)
PX_PER_M = (TRUTH[2:] - TRUTH[:2]) / 18.0


def test_the_response_is_that_of_the_intersected_masks() -> None:
    """Brute force: a pixel belongs to the mask if it lies in the region of every angle."""
    picture = painted_runway(POSE)
    rows, reach, half = np.array([270.0, 290.0]), 9.0, np.pi / 4
    fast = np.empty(640)
    response(picture, rows, reach, half, fast)
    for x in (200, 301, 333, 400):
        sides = []
        for sign in (1, -1):
            total, count = np.zeros(3), 0
            for row in range(270, 291):
                start = round(abs(row - 280.0) * np.tan(half))
                for j in range(start + 1, round(reach) - start + 1):
                    total += picture[row, x + sign * j]
                    count += 1
            sides.append(total / count / 255.0)
        assert abs(fast[x] + 0.5 * np.sum((sides[0] - sides[1]) ** 2)) < 1e-12


def test_minima_are_the_lowest_and_apart() -> None:
    profile = np.zeros(100)
    profile[[20, 23, 60, 90]] = [-5.0, -4.0, -3.0, -2.0]
    np.testing.assert_array_equal(lowest_minima(profile, 3, 6.0), [20.0, 60.0, 90.0])
    assert lowest_minima(np.zeros(50), 5, 3.0).size == 0


def test_algorithm_1_finds_the_runway_and_reports_when_no_pair_is_plausible() -> None:
    picture = painted_runway(POSE)
    found = detect(picture, ROWS, PX_PER_M, EdgeDetectionConfig(), lambda x: 1.0)
    assert isinstance(found, DetectedPairs)
    assert np.abs(found.crossings_px - TRUTH).max() < 3.0
    assert len(found.candidates) <= 5
    assert isinstance(detect(picture, ROWS, PX_PER_M, EdgeDetectionConfig(), lambda x: 0.0), NoPair)
    blank = np.full((480, 640, 3), 90, np.uint8)
    assert isinstance(detect(blank, ROWS, PX_PER_M, EdgeDetectionConfig(), lambda x: 1.0), NoPair)


def test_the_strip_finds_edges_from_afar_to_a_fraction_of_a_pixel() -> None:
    for seed in range(6):
        picture = painted_runway(POSE, noise=4.0, seed=seed)
        off = np.random.default_rng(seed).uniform(-9.0, 9.0, 2).repeat(2)
        found = find_edges(picture, TRUTH + off, ROWS, WIDTHS, ACROSS, 16.0 * np.eye(4), StripConfig())
        assert found is not None
        error = found.crossings_px - TRUTH
        assert np.abs(error).max() < 0.35
        assert error @ np.linalg.solve(found.covariance_px2, error) < 30.0


def test_edges_agree_about_a_runway_and_not_about_the_ground_beside_one() -> None:
    """From the runway's right edge on, the ground is inside at the left line and outside at the right one."""
    picture = painted_runway(POSE)
    both = refine_edges(picture, TRUTH, ROWS, WIDTHS, ACROSS, StripConfig())
    assert both is not None
    assert both.agreement > 0.9
    u = np.arange(640)[None, :, None]
    t = ((np.arange(480) - ROWS[0]) / (ROWS[1] - ROWS[0]))[:, None, None]
    half = np.where(u > 0.5 * ((TRUTH[0] + TRUTH[2]) * (1 - t) + (TRUTH[1] + TRUTH[3]) * t), 255 - picture, picture)
    other = refine_edges(half.astype(np.uint8), TRUTH, ROWS, WIDTHS, ACROSS, StripConfig())
    assert other is not None
    assert other.agreement < -0.9


def test_no_edge_is_found_in_plain_ground() -> None:
    plain = painted_runway(POSE, inside=(50, 110, 80))
    assert find_edges(plain, TRUTH, ROWS, WIDTHS, ACROSS, 16.0 * np.eye(4), StripConfig()) is None


def test_narrow_paint_goes_and_wide_regions_stay() -> None:
    picture = np.full((480, 640, 3), 100, np.uint8)
    picture[:, 300:400] = 160
    picture[:, 200:204] = 250
    cleaned = remove_markings(picture, ROWS, 5.0)
    assert np.all(cleaned[280, 190:210] == 100)
    assert np.array_equal(cleaned[280, 290:410], picture[280, 290:410])
    assert np.array_equal(cleaned[100], picture[100])
    assert remove_markings(picture, ROWS, 0.0) is picture


def test_lamps_by_night_are_bridged_from_side_to_side() -> None:
    picture = np.full((60, 200, 3), 30, np.uint8)
    picture[:, 100:] = 60
    picture[28:32, 98:102] = 255
    grey = picture[:, :, 0].copy()
    mask = lamp_mask(grey)
    assert mask[30, 100] == 1
    assert mask[30, 50] == 0
    assert mask[5, 100] == 0
    bridge(picture, mask)
    assert picture[30].max() <= 60
    assert np.all(np.diff(picture[30, :, 0].astype(int)) >= 0)


def test_the_baselines_find_a_plain_runway() -> None:
    """Bright on dark: the Hough transform sees grey levels only."""
    picture = painted_runway(POSE, inside=(170, 170, 170))
    for found in (hough_edges(picture, ROWS), graph_cut_edges(picture, ROWS, TRUTH + 2.0, WIDTHS)):
        assert found is not None
        assert np.abs(found - TRUTH).max() < 4.0
    assert hough_edges(np.full((480, 640, 3), 90, np.uint8), ROWS) is None
