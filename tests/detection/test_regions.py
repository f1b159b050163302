"""Regions are those that OpenCV finds, measured as plain sums; groups hold what lies close together."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.detection.regions import find_regions, groups_around

CLOSED = (False, False, False, False)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.tuples(st.integers(1, 40), st.integers(1, 60)),
    share=st.floats(0.0, 1.0),
    smooth=st.booleans(),
)
def test_regions_are_opencvs_and_their_table_is_sums(
    seed: int, size: tuple[int, int], share: float, smooth: bool
) -> None:
    rng = np.random.default_rng(seed)
    phi = rng.random(size).astype(np.float32)
    if smooth:
        phi = np.asarray(cv2.GaussianBlur(phi, (5, 5), 1.2), np.float32)
    phi = np.asarray(phi - np.quantile(phi, 1.0 - share), np.float32)
    contrast = rng.gamma(2.0, 2.0, size).astype(np.float32)
    count, theirs = cv2.connectedComponents((phi > 0).astype(np.uint8), connectivity=8)
    ours = find_regions(phi, contrast)
    assert ours.table.shape == (count, 10)
    assert np.array_equal(ours.labels > 0, theirs > 0)
    # a one-to-one correspondence of the regions
    assert (
        len({(int(a), int(b)) for a, b in zip(ours.labels.ravel(), theirs.ravel(), strict=True)} - {(0, 0)})
        == count - 1
    )
    for k in range(1, count):
        rows, columns = np.nonzero(ours.labels == k)
        own = contrast[rows, columns].astype(np.float64)
        rim = rows.min() == 0 or columns.min() == 0 or rows.max() == size[0] - 1 or columns.max() == size[1] - 1
        expected = [len(rows), own.sum(), own @ columns, own @ rows, columns.min(), rows.min()]
        expected += [columns.max() + 1, rows.max() + 1, own.max(), float(rim)]
        assert ours.table[k] == pytest.approx(expected)


def painted(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """Return φ (40, 100) with boxes x0, y0, x1, y1 inside."""
    phi = np.full((40, 100), -1.0, np.float32)
    for x0, y0, x1, y1 in boxes:
        phi[y0:y1, x0:x1] = 1.0
    return phi


def test_a_severed_wing_joins_its_body_and_each_part_is_also_a_group() -> None:
    regions = find_regions(
        painted((20, 18, 40, 22), (42, 18, 60, 22), (80, 2, 84, 6)), np.full((40, 100), 5.0, np.float32)
    )
    groups = groups_around(regions, (40.0, 20.0), 12.0, 40.0, 0.5, 2.0, CLOSED)
    assert [g.box for g in groups] == [(20, 18, 60, 22), (20, 18, 40, 22), (42, 18, 60, 22)]
    both = groups[0]
    assert both.area == 4 * 38
    assert both.mass == pytest.approx(5.0 * both.area)
    assert both.contrast == pytest.approx(5.0)
    assert both.centre == pytest.approx([(20 * 29.5 + 18 * 50.5) / 38, 19.5])
    # the third region, in the corner, is another object
    assert both.labels == (regions.labels[20, 30], regions.labels[20, 50])
    assert not both.rim


def test_faint_regions_and_those_beyond_an_open_edge_are_not_groups() -> None:
    phi = painted((0, 10, 12, 14), (30, 10, 40, 14))
    contrast = np.full((40, 100), 5.0, np.float32)
    regions = find_regions(phi, contrast)
    near, reach = (20.0, 12.0), 60.0
    assert len(groups_around(regions, near, reach, None, 0.5, 2.0, CLOSED)) == 2
    [inner] = groups_around(regions, near, reach, None, 0.5, 2.0, (True, False, False, False))
    assert inner.box == (30, 10, 40, 14)
    assert groups_around(regions, near, reach, None, 0.5, 6.0, CLOSED) == []


def test_the_span_limits_the_size_of_a_group() -> None:
    regions = find_regions(painted((20, 18, 40, 22), (42, 18, 60, 22)), np.full((40, 100), 5.0, np.float32))
    for span, widest in ((None, 40), (20.0, 20), (math.inf, 40)):
        groups = groups_around(regions, (40.0, 20.0), 12.0, span, 0.5, 2.0, CLOSED)
        assert max(g.width for g in groups) == widest


@pytest.mark.parametrize(
    ("span", "tallest", "joins"),
    [
        # 18 px high together; a group of a known span grows to 1.25 spans, of an unknown one to three widths
        (40.0, 0.37, True),
        (40.0, 0.35, False),
        (None, 0.151, True),
        (None, 0.149, False),
        (20.0, 0.9, False),
    ],
)
def test_the_height_is_bounded_as_a_share_of_the_width(span: float | None, tallest: float, joins: bool) -> None:
    """Expected: what stands above a wing belongs to it only where both together are no higher than that."""
    wing, above = (20, 18, 60, 22), (35, 4, 45, 16)
    regions = find_regions(painted(wing, above), np.full((40, 100), 5.0, np.float32))
    groups = groups_around(regions, (40.0, 20.0), 30.0, span, tallest, 2.0, CLOSED)
    boxes = {g.box for g in groups}
    assert ((20, 4, 60, 22) in boxes) is joins
    assert {wing, above} <= boxes


@pytest.mark.parametrize(("gap", "joins"), [(2, True), (4, True), (5, False)])
def test_only_near_regions_join(gap: int, joins: bool) -> None:
    """Expected: within 0.12 spans, here 4.8 px; a speck within 2 px only."""
    wing, other = (10, 18, 30, 22), (30 + gap, 18, 45, 22)
    regions = find_regions(painted(wing, other), np.full((40, 100), 5.0, np.float32))
    boxes = {g.box for g in groups_around(regions, (20.0, 20.0), 30.0, 40.0, 0.5, 2.0, CLOSED)}
    assert ((10, 18, 45, 22) in boxes) is joins
    speck = find_regions(painted(wing, (30 + gap, 19, 32 + gap, 21)), np.full((40, 100), 5.0, np.float32))
    boxes = {g.box for g in groups_around(speck, (20.0, 20.0), 30.0, 40.0, 0.5, 2.0, CLOSED)}
    assert ((10, 18, 32 + gap, 22) in boxes) is (gap <= 2)


def test_seeds_lie_within_reach() -> None:
    """Expected: by the distance of the nearest pixel, of either axis and diagonally."""
    regions = find_regions(painted((40, 20, 50, 24)), np.full((40, 100), 5.0, np.float32))
    for near, away in (((30.0, 22.0), 10.0), ((59.0, 22.0), 10.0), ((45.0, 10.0), 10.0), ((45.0, 33.0), 10.0)):
        assert groups_around(regions, near, away, None, 0.5, 2.0, CLOSED)
        assert not groups_around(regions, near, away - 0.01, None, 0.5, 2.0, CLOSED)
    assert groups_around(regions, (37.0, 16.0), 5.0, None, 0.5, 2.0, CLOSED)
    assert not groups_around(regions, (37.0, 16.0), 4.99, None, 0.5, 2.0, CLOSED)
