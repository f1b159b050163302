"""What the simulated range keeps of the truth."""

import numpy as np

from groundstation.simulation.nose_truth import NoseTruth


def test_the_truth_of_each_picture_is_kept_in_order() -> None:
    truth = NoseTruth()
    assert truth.rows().shape == (0, 3)
    truth.add(0, 1.5, 10.0, 20.0)
    truth.add(1, 1.6, float("nan"), float("nan"))
    np.testing.assert_array_equal(truth.rows(), [[1.5, 10.0, 20.0], [1.6, np.nan, np.nan]])
    assert truth.missing == 0


def test_pictures_that_did_not_come_are_counted() -> None:
    """Expected: from the first picture that came; a picture that comes again is none that is missing."""
    truth = NoseTruth()
    for number in (5, 6, 9, 9, 10, 20):
        truth.add(number, 0.1 * number, 1.0, 2.0)
    assert truth.missing == 2 + 9
