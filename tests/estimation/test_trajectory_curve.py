"""The predictors: exact where they should be, stable where the literal reading is not."""

import numpy as np
import pytest

from groundstation.estimation.config import Predictor
from groundstation.estimation.trajectory_curve import (
    Knot,
    TrajectoryPredictor,
    curve,
    curve_inherited_tangent,
    hermite,
    line,
)


def knots(path, times) -> list[Knot]:
    return [Knot(t_s=t, position_m=np.asarray(path(t), dtype=float)) for t in times]


def straight(t: float):
    return [1.0 + 2.0 * t, 300.0 - 25.0 * t, 10.0 - t]


@pytest.mark.parametrize("times", [(0.0, 0.1, 0.2), (0.0, 0.05, 0.2), (0.0, 0.3, 0.35)])
@pytest.mark.parametrize("predict", [line, curve, curve_inherited_tangent])
def test_a_straight_steady_flight_is_predicted_exactly(predict, times) -> None:
    np.testing.assert_allclose(predict(knots(straight, times), 0.45), straight(0.45), atol=1e-6)


def test_too_few_knots_give_no_prediction() -> None:
    assert line(knots(straight, [0.0]), 1.0) is None
    assert curve(knots(straight, [0.0, 0.1]), 1.0) is None


def test_the_curve_keeps_the_speed_of_the_last_step() -> None:
    """On a circle the predicted point lies one step's arc further on the segment, not further out."""

    def circle(t: float):
        return [100 * np.cos(t), 100 * np.sin(t), 0.0]

    last = knots(circle, [0.0, 0.1, 0.2])
    step = float(np.linalg.norm(curve(last, 0.3) - last[-1].position_m))
    assert step == pytest.approx(float(np.linalg.norm(last[-1].position_m - last[-2].position_m)), rel=2e-3)


def test_inherited_tangents_ring_and_ours_do_not() -> None:
    """One displaced knot: the literal reading still rings 30 steps later, the stable one has forgotten it."""
    times = np.arange(40) * 0.1
    moved = knots(straight, times)
    moved[5] = Knot(t_s=moved[5].t_s, position_m=moved[5].position_m + [0.5, 0.0, 0.0])
    error = {f: np.linalg.norm(f(moved, 4.0) - straight(4.0)) for f in (curve, curve_inherited_tangent)}
    assert error[curve] < 1e-9
    assert error[curve_inherited_tangent] > 0.5


def test_the_hermite_path_passes_through_both_ends_with_their_velocities() -> None:
    a, b = Knot(t_s=1.0, position_m=np.array([0.0, 10, 2])), Knot(t_s=1.2, position_m=np.array([0.5, 5, 2]))
    va, vb = np.array([1.0, -20, 0]), np.array([3.0, -28, 1])
    np.testing.assert_allclose(hermite(a, va, b, vb, 1.0), a.position_m)
    np.testing.assert_allclose(hermite(a, va, b, vb, 1.2), b.position_m)
    h = 1e-6
    np.testing.assert_allclose((hermite(a, va, b, vb, 1.0 + h) - a.position_m) / h, va, atol=1e-3)
    np.testing.assert_allclose((b.position_m - hermite(a, va, b, vb, 1.2 - h)) / h, vb, atol=1e-3)


def test_the_hermite_path_is_not_followed_past_its_end() -> None:
    a, b = Knot(t_s=0.0, position_m=np.zeros(3)), Knot(t_s=0.1, position_m=np.ones(3))
    np.testing.assert_allclose(hermite(a, np.zeros(3), b, 50 * np.ones(3), 0.5), b.position_m)


def test_the_default_predictor_is_the_filters_prediction() -> None:
    predictor = TrajectoryPredictor(Predictor.HERMITE)
    for knot in knots(straight, [0.0, 0.1, 0.2]):
        predictor.add(knot)
    own = Knot(t_s=0.3, position_m=np.array([9.0, 8.0, 7.0]))
    np.testing.assert_array_equal(predictor.predict(own), own.position_m)


@pytest.mark.parametrize("kind", [Predictor.LINE, Predictor.CURVE, Predictor.INHERITED_CURVE])
def test_other_predictors_fall_back_until_they_have_knots(kind: Predictor) -> None:
    predictor = TrajectoryPredictor(kind)
    own = Knot(t_s=0.3, position_m=np.array([9.0, 8.0, 7.0]))
    np.testing.assert_array_equal(predictor.predict(own), own.position_m)
    for knot in knots(straight, [0.0, 0.1, 0.2, 0.2]):
        predictor.add(knot)
    np.testing.assert_allclose(predictor.predict(own), straight(0.3), atol=1e-6)
    predictor.reset()
    np.testing.assert_array_equal(predictor.predict(own), own.position_m)
