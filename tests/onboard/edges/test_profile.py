"""The profile across the edges: levels that are there, no pull by paint or lamps, lamps that are learned."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.coordinate_ascent import best_displacements
from groundstation.onboard.edges.edge_measurement import EdgeMeasurement
from groundstation.onboard.edges.gather_kernel import gather
from groundstation.onboard.edges.lines import crossings_at, line_map, project_lines
from groundstation.onboard.edges.markings import Change, Markings, initial_markings, unsettled_m2
from groundstation.onboard.edges.pose import intrinsic_matrix
from groundstation.onboard.edges.profile import edges_by_profile
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import OUTWARDS
from groundstation.onboard.edges.profile_kernel import ExcessPrior, line_likelihood, misfits, moments
from groundstation.onboard.edges.search_band import NoBand, RunwayGuess, band_rows
from groundstation.onboard.scenes.sequences import NOSE_LENS, SEQUENCES, NoseFrame, Renderer, varied
from tests.onboard.edges.seen import smooth_picture

KAPPA = intrinsic_matrix(NOSE_LENS)
HAZE, NIGHT = 1, 3


@cache
def seen(
    scene: int, seed: int, index: int, inset_m: float = 0.5, stripe_m: float = 0.45
) -> tuple[NoseFrame, FloatArray, FloatArray, FloatArray]:
    """Return a rendered frame of an airfield with painted side lines, its rows, true crossings, and px per m."""
    drawn = varied(SEQUENCES[scene], seed, inset_m)
    sequence = replace(drawn, airfield=replace(drawn.airfield, edge_stripe_m=stripe_m))
    frame = Renderer(sequence).frame(index)
    half = 0.5 * sequence.airfield.width_m
    guess = RunwayGuess(width_m=2.0 * half, length_m=sequence.airfield.length_m)
    rows = band_rows(frame.truth, KAPPA, NOSE_LENS.image_size_px, guess)
    assert not isinstance(rows, NoBand)
    crossings = project_lines(np.array([1.0, 0.0, -half, half]), line_map(frame.truth, KAPPA), rows)[0]
    return frame, rows, crossings, np.abs(crossings[2:] - crossings[:2]) / (2.0 * half)


def track_profiles(
    scene: int, off_px: FloatArray, pictures: int, config: ProfileConfig, inset_m: float = 0.5, stripe_m: float = 0.45
) -> tuple[list[EdgeMeasurement], FloatArray, FloatArray]:
    """Return the result of so many fits to one picture, started off by (4,) px outwards; truth (4,), px per m (2,)."""
    frame, rows, wanted, px_per_m = seen(scene, 61, 24, inset_m, stripe_m)
    guess, markings, prior, found = wanted + OUTWARDS * off_px, None, 9.0 * np.eye(4), list[EdgeMeasurement]()
    for _ in range(pictures):
        found.append(edges_by_profile(frame.image, guess, rows, px_per_m, guess, prior, markings, config, layouts=5))
        guess, markings = found[-1].crossings_px, found[-1].markings
    return found, wanted, px_per_m


def off_by(found: EdgeMeasurement, wanted: FloatArray) -> float:
    """Return the squared error over all that is stated, of 4."""
    assert found.unsettled_px2 is not None
    error = found.crossings_px - wanted
    return float(error @ np.linalg.solve(found.covariance_px2 + found.unsettled_px2, error))


def learned(found: EdgeMeasurement, config: ProfileConfig) -> tuple[float | None, float | None]:
    """Return where the outer side of the line and the lamps are taken to be, m."""
    assert found.markings is not None
    return config.lines_m[found.markings.places[0]], config.lamps_m[found.markings.places[1]]


@pytest.mark.parametrize("scene", [HAZE, NIGHT], ids=["haze", "night"])
@pytest.mark.parametrize("off_px", [-3.0, 3.0])
def test_neither_paint_nor_lamps_draw_an_edge_aside(scene: int, off_px: float) -> None:
    """On the paint's inner side both were 2 to 4 px off in haze, by night 1 to 5 px outwards, towards the lamps."""
    found, wanted, _ = track_profiles(scene, np.full(4, off_px), 4, ProfileConfig())
    error = OUTWARDS * (found[-1].crossings_px - wanted)
    assert np.abs(error).max() < 1.5, error
    assert float(error @ np.linalg.solve(found[-1].covariance_px2, error)) < 18.5


def test_the_position_of_lamps_is_estimated() -> None:
    config = ProfileConfig(lamps_m=(None, 3.0, 2.0, 1.0))
    found, wanted, _ = track_profiles(NIGHT, np.zeros(4), 12, config)
    assert learned(found[-1], config)[1] == 1.0
    assert np.abs(found[-1].crossings_px - wanted).max() < 1.5
    no_light = track_profiles(HAZE, np.zeros(4), 10, config)[0]
    assert learned(no_light[-1], config)[1] is None


@pytest.mark.parametrize("inset_m", [0.0, 0.5, 1.0])
def test_place_of_the_side_line_is_estimated_and_covered_by_the_covariance(inset_m: float) -> None:
    """Expected: at any inset of the side line its place is found, and the edges' covariance covers it until then."""
    config = ProfileConfig()
    found, wanted, px_per_m = track_profiles(HAZE, np.zeros(4), 12, config, inset_m)
    line_m = learned(found[-1], config)[0]
    assert line_m is not None
    assert abs(line_m + inset_m) < 0.3
    assert np.abs(found[-1].crossings_px - wanted).max() < 0.3 * px_per_m.max()
    assert max(off_by(one, wanted) for one in found) < 18.5


def test_lamps_that_were_taken_for_paint_are_known_again() -> None:
    """By night, no paint: both edges 1.7 m too far out, with the lamps' light for paint half a metre inside them.

    Remembered as paint it was never doubted (both edges off by 7 px for 60 frames, beyond chi-square 99.9 % in 93 %).
    """
    config, prior = ProfileConfig(), 0.25 * np.eye(4)
    frame, rows, wanted, px_per_m = seen(NIGHT, 61, 24, 0.5, 0.0)
    guess, markings, errors = (
        wanted + OUTWARDS * 1.7 * np.tile(px_per_m, 2),
        initial_markings(config, dark=False),
        list[float](),
    )
    for _ in range(8):
        found = edges_by_profile(frame.image, guess, rows, px_per_m, guess, prior, markings, config, layouts=5)
        assert found.markings is not None
        guess, markings = found.crossings_px, found.markings
        errors.append(float(np.abs(guess - wanted).max()))
    assert errors[0] > 3.0
    assert learned(found, config) == (None, 1.0)
    assert errors[-1] < 1.5


def test_what_layouts_leave_open_is_stated() -> None:
    """One other layout, as likely: half of the square of what it moves the lines by; a hopeless one adds nothing.

    The one that is held was counted twice, and a third was stated.
    """
    config = ProfileConfig(lines_m=(None,), lamps_m=(None, 1.0))
    markings = initial_markings(config, dark=False)
    moved = np.array([[[0.0] * 4, [0.4, 0.8, 0.4, 0.8]]])
    even = replace(markings, moved_m=moved)
    np.testing.assert_allclose(unsettled_m2(even, config), np.outer(moved[0, 1], moved[0, 1]) / 2.0)
    hopeless = replace(even, gains=np.array([[0.0, -1000.0]]))
    np.testing.assert_allclose(unsettled_m2(hopeless, config), 0.0, atol=1e-12)


def test_strayed_lines_return_against_the_prior() -> None:
    frame, rows, wanted, px_per_m = seen(HAZE, 61, 24)
    config, prior = ProfileConfig(), 0.04 * np.eye(4)
    # on the runway, two metres inside the left edge, and sure of it
    held = wanted - 2.0 * np.repeat(px_per_m[None], 2, axis=0).ravel() * np.array([-1.0, -1.0, 0.0, 0.0])
    markings: Markings | None = None
    back = 0
    for _ in range(12):
        found = edges_by_profile(frame.image, held, rows, px_per_m, held, prior, markings, config, layouts=5)
        markings = found.markings
        if found.change is Change.LINES:
            back += 1
            assert np.abs(found.crossings_px - wanted).max() < 1.5
            break
    assert back == 1


def test_levels_and_displacement_of_a_profile_are_found() -> None:
    bins, trials, at = 31, 11, 7
    z = np.arange(bins) - bins // 2 - (at - trials // 2)
    blur, bar = 1.2, (-4.0, -2.0)
    under = np.vectorize(lambda value: 0.5 * (1.0 + math.erf(value / math.sqrt(2.0))))
    step, line = under(z / blur), under((z - bar[0]) / blur) - under((z - bar[1]) / blur)
    levels = np.array([[0.3, 0.31, 0.32], [0.5, 0.4, 0.35], [0.2, 0.25, 0.3]])
    colours = (1.0 - step)[:, None] * levels[0] + step[:, None] * levels[1] + line[:, None] * levels[2]
    weight = np.random.default_rng(0).uniform(0.5, 3.0, (1, bins))
    # the line as it is, none, and one elsewhere
    bars, usual = np.array([[[bar]], [[(0.0, 0.0)]], [[(2.0, 4.0)]]]), np.zeros((1, 1, 3))
    misfit, found = np.empty((3, 1, trials)), np.empty((3, 1, trials, 3, 3))
    misfits(
        weight[..., None] * colours[None],
        weight,
        np.array([blur]),
        bars,
        ExcessPrior(usual, np.zeros(1)),
        misfit,
        found,
    )
    assert misfit[0, 0].argmin() == at
    assert misfit[0, 0, at] < 1e-5
    assert np.delete(misfit[0, 0], at).min() > 1e-3
    np.testing.assert_allclose(found[0, 0, at], levels, atol=1e-3)
    np.testing.assert_array_equal(found[1, 0, :, 2], 0.0)
    assert misfit[1:].min() > 1e-2
    # held stiffly to what is usual, the line is that
    misfits(
        weight[..., None] * colours[None],
        weight,
        np.array([blur]),
        bars,
        ExcessPrior(usual, np.full(1, 1e9)),
        misfit,
        found,
    )
    np.testing.assert_allclose(found[0, 0, :, 2], 0.0, atol=1e-4)
    assert misfit[0, 0, at] > 1e-2


def test_every_pixel_of_a_window_is_counted_once_and_none_twice() -> None:
    x, rows, steps = np.array([250.3, 190.7, 380.1, 455.6]), np.array([262.0, 300.0]), np.array([0.5, 0.9])
    total, weight = np.zeros((2, 8, 41, 3)), np.zeros((2, 8, 41))
    gather(np.full((480, 640, 3), 51, np.uint8), x, rows, steps, total, weight, np.zeros((2, 0, 0)))
    np.testing.assert_allclose(total, 0.2 * np.repeat(weight[..., None], 3, axis=3), atol=1e-12)
    count = 0
    for row in range(262, 301):
        t = (row - 262.0) / 38.0
        edge, reach = x[0] * (1.0 - t) + x[1] * t, 20.0 * (steps[0] * (1.0 - t) + steps[1] * t)
        count += math.floor(edge + reach) - math.ceil(edge - reach) + 1
    assert weight[0].sum() == pytest.approx(count)
    picture = smooth_picture(2)
    total[:] = weight[:] = 0.0
    gather(picture, x, rows, steps, total, weight, np.zeros((2, 0, 0)))
    # the middle bin lies on the line
    t = 0.5 / 8.0 * np.array([-1.0, 0.0, 1.0]).mean() + 0.5 / 8.0
    row = 262.0 + 38.0 * t
    edge = crossings_at(x, rows, np.array([row, row]))[0]
    seen_there = picture[round(row), round(edge)] / 255.0
    np.testing.assert_allclose(total[0, 0, 20] / weight[0, 0, 20], seen_there, atol=0.05)


def test_no_pixel_beyond_the_other_line_is_an_edges_own() -> None:
    """Of a narrow strip the far side came into both profiles, and both edges were put within it."""
    x, rows, steps = np.array([300.0, 290.0, 306.0, 320.0]), np.array([262.0, 300.0]), np.array([0.5, 0.5])
    picture = np.zeros((480, 640, 3), np.uint8)
    for row in range(262, 301):
        left, right = crossings_at(x, rows, np.array([row, row]))[[0, 2]]
        picture[row, math.ceil(left) : math.floor(right) + 1] = 51
    total, weight = np.zeros((2, 8, 61, 3)), np.zeros((2, 8, 61))
    gather(picture, x, rows, steps, total, weight, np.zeros((2, 0, 0)))
    within = np.arange(61) < 30
    np.testing.assert_allclose(total[:, :, within], 0.2 * np.repeat(weight[:, :, within, None], 3, axis=3), atol=1e-12)
    assert (weight[:, 0, :11] == 0.0).all()  # at most 9 px apart in the first rows, 18 bins
    assert (weight[:, -1, 5:].sum(axis=1) > 0.0).all()


def test_mean_and_covariance_are_those_of_the_likelihood() -> None:
    """Blocks of normal likelihoods about a line: least squares gives the same, to the resolution of a grid."""
    trials, steps, line, sigma = 41, np.array([0.5, 1.0]), np.array([1.3, -2.2]), 2.0
    t = (np.arange(8) + 0.5) / 8.0
    step = steps[0] * (1.0 - t) + steps[1] * t
    places = (np.arange(trials) - trials // 2) * step[:, None]
    curves = np.exp(-0.5 * ((places - (line[0] * (1.0 - t) + line[1] * t)[:, None]) / sigma) ** 2)
    grid, mean, covariance, best = np.empty((trials, trials)), np.empty(2), np.empty((2, 2)), np.zeros(4)
    line_likelihood(curves, steps, 0.0, grid)
    moments(grid, steps, mean, covariance)
    design = np.stack([1.0 - t, t], axis=1)
    np.testing.assert_allclose(mean, line, atol=0.05)
    np.testing.assert_allclose(covariance, sigma**2 * np.linalg.inv(design.T @ design), rtol=0.05)
    worth = best_displacements(np.stack([grid, grid]), -np.inf, steps, np.zeros(4), np.zeros((4, 4)), best)
    at = np.unravel_index(grid.argmax(), grid.shape)
    np.testing.assert_allclose(best, np.tile(steps * (np.array(at) - trials // 2), 2))
    assert worth == pytest.approx(2.0 * grid.max())
    # a prior that is sure of elsewhere is heeded
    best_displacements(np.stack([grid, grid]), -np.inf, steps, np.full(4, 3.0), 1e6 * np.eye(4), best)
    np.testing.assert_allclose(best, 3.0)


def test_no_light_is_remembered_that_was_not_measured() -> None:
    """Lamps 3 m out are beyond the fine window near by: its estimate of their light was −1.5 to 1.7, and was kept."""
    sequence = varied(SEQUENCES[NIGHT], 61, 0.5, 3.0)
    frame = Renderer(replace(sequence, approach=replace(sequence.approach, start_y_m=60.0))).frame(12)
    half = 0.5 * sequence.airfield.width_m
    guess = RunwayGuess(width_m=2.0 * half, length_m=sequence.airfield.length_m)
    rows = band_rows(frame.truth, KAPPA, NOSE_LENS.image_size_px, guess)
    assert not isinstance(rows, NoBand)
    wanted = project_lines(np.array([1.0, 0.0, -half, half]), line_map(frame.truth, KAPPA), rows)[0]
    px_per_m = np.abs(wanted[2:] - wanted[:2]) / (2.0 * half)
    config, markings = ProfileConfig(lines_m=(-0.5,), lamps_m=(None, 3.0)), None
    for _ in range(3):
        found = edges_by_profile(
            frame.image, wanted, rows, px_per_m, wanted, np.eye(4), markings, config, layouts=0
        )  # fmt: skip
        markings = found.markings
        assert markings is not None
        light = markings.excess[1].mean(axis=1)
        assert light.min() >= 0.0
        assert 0.02 < light.max() < 0.3
