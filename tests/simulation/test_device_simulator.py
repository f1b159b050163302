"""What the simulated range keeps of the truth."""

import numpy as np

from groundstation.simulation.nose_truth import NoseTruth


def test_the_truth_of_each_picture_is_kept_in_order() -> None:
    truth = NoseTruth()
    assert truth.rows().shape == (0, 3)
    truth.add(1.5, 10.0, 20.0)
    truth.add(1.6, float("nan"), float("nan"))
    np.testing.assert_array_equal(truth.rows(), [[1.5, 10.0, 20.0], [1.6, np.nan, np.nan]])
