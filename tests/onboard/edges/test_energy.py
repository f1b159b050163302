"""The energies: gradients against differences, the paper's as corrected, and a descent that ends at an edge."""

import numpy as np
import pytest

from groundstation.onboard.edges.energy import non_variant, spatially_variant, spatially_variant_as_printed
from groundstation.onboard.edges.gradient_descent import DescentConfig, Energy, clutter, descend, far_sides
from groundstation.onboard.edges.lines import line_map, project_lines
from tests.onboard.edges.seen import KAPPA, ROWS, RUNWAY, approach, numeric, painted_runway, smooth_picture

COUNTS = (31, 7)
X = np.array([250.3, 190.7, 380.1, 455.6])
WIDTHS = np.array([[6.0, 14.0], [5.0, 13.0]])


@pytest.mark.parametrize("across", [(0.0, 0.0), (0.998, 0.0632)], ids=["normals", "across the runway"])
def test_the_gradient_of_the_spatially_variant_energy_is_that_of_differences(across) -> None:
    along = np.array(across)
    for seed in range(5):
        picture, grad = smooth_picture(seed), np.empty(4)
        x = X + np.random.default_rng(seed).uniform(-20.0, 20.0, 4)
        spatially_variant(picture, x, ROWS, WIDTHS, along, COUNTS, grad)
        scratch = np.empty(4)
        twin = numeric(lambda z, p=picture, s=scratch: spatially_variant(p, z, ROWS, WIDTHS, along, COUNTS, s), x, 1e-5)
        np.testing.assert_allclose(grad, twin[0], rtol=1e-3, atol=1e-5)


def test_the_gradient_of_the_non_variant_energy_is_that_of_differences() -> None:
    far = far_sides(X, ROWS, WIDTHS)
    for seed in range(5):
        picture, grad, scratch = smooth_picture(seed), np.empty(4), np.empty(4)
        x = X + np.random.default_rng(seed).uniform(-3.0, 3.0, 4)
        non_variant(picture, x, ROWS, far, grad)
        twin = numeric(lambda z, p=picture, s=scratch: non_variant(p, z, ROWS, far, s), x, 1e-6)
        np.testing.assert_allclose(grad, twin[0], rtol=2e-3, atol=1e-6)


def test_both_forms_of_the_spatially_variant_gradient_belong_to_one_energy() -> None:
    grad = np.empty(4)
    energies = [
        spatially_variant(smooth_picture(1), X, ROWS, WIDTHS, np.zeros(2), COUNTS, grad),
        spatially_variant_as_printed(smooth_picture(1), X, ROWS, WIDTHS, COUNTS, grad),
    ]
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)


@pytest.mark.parametrize("energy", list(Energy))
def test_every_gradient_points_uphill_away_from_a_plain_edge(energy: Energy) -> None:
    """As printed, Eqs. 7 and 9 have the other sign: lines that lie inside would move further in at the lower row."""
    pose = approach()
    picture = painted_runway(pose, noise=0.0)
    x, _ = project_lines(RUNWAY, line_map(pose, KAPPA), ROWS)
    for inwards in (2.0, -2.0):
        start = x + inwards * np.array([1.0, 1.0, -1.0, -1.0])
        found = descend(picture, start, ROWS, WIDTHS, DescentConfig(energy=energy, gamma=0.0)).crossings_px
        assert np.all(np.abs(found - x) < 0.6 * np.abs(start - x)), (energy, inwards, found - x)


def test_a_descent_never_rises_keeps_the_trapezoid_and_is_held_back_by_gamma() -> None:
    pose = approach()
    picture = painted_runway(pose)
    x, _ = project_lines(RUNWAY, line_map(pose, KAPPA), ROWS)
    start = x + np.array([5.0, -4.0, -5.0, 4.0])
    moved = []
    for gamma in (0.0, 0.01, 10.0):
        down = descend(picture, start, ROWS, WIDTHS, DescentConfig(gamma=gamma, adaptive_gamma=False))
        assert down.energy <= down.start_energy
        assert np.all(down.crossings_px[2:] > down.crossings_px[:2])
        moved.append(np.linalg.norm(down.crossings_px - start))
    assert moved[0] > 4.0
    assert moved[2] < 0.2
    assert moved[0] >= moved[1] - 0.5 >= moved[2] - 0.5


def test_clutter_makes_gamma_grow() -> None:
    pose = approach()
    x, _ = project_lines(RUNWAY, line_map(pose, KAPPA), ROWS)
    shares = [clutter(painted_runway(pose, noise=n), x, ROWS, WIDTHS, COUNTS) for n in (1.0, 30.0)]
    assert 0.0 < shares[0] < shares[1]
    config = DescentConfig(gamma=1e-3)
    gammas = [descend(painted_runway(pose, noise=n), x, ROWS, WIDTHS, config).gamma for n in (1.0, 30.0)]
    assert 1e-3 < gammas[0] < gammas[1]


def test_bands_that_leave_the_picture_do_not_count() -> None:
    grad = np.empty(4)
    outside = np.array([-300.0, -400.0, 900.0, 990.0])
    assert spatially_variant(smooth_picture(1), outside, ROWS, WIDTHS, np.zeros(2), COUNTS, grad) == 0.0
    assert np.all(grad == 0.0)
