"""The smoothed track's figures, next to the filter's on the same epochs."""

import numpy as np
import pytest

from groundstation.evaluation.metrics import Comparison
from groundstation.evaluation.summary import smoothed_table


def comparison(known: list[bool], error_m: list[float]) -> Comparison:
    n = len(known)
    return Comparison(
        t_s=np.arange(n, dtype=float),
        reference_m=np.zeros((n, 3)),
        usable=np.ones(n, dtype=bool),
        ekf_error_m=np.outer(error_m, np.ones(3)),
        ekf_known=np.array(known),
        triangulation_error_m=np.zeros((n, 3)),
        triangulation_known=np.zeros(n, dtype=bool),
        covariance_m2=np.tile(np.eye(3), (n, 1, 1)),
    )


def test_the_filter_is_evaluated_on_the_common_epochs() -> None:
    filtered = comparison([True, True, False, True], [3.0, 4.0, 0.0, 100.0])
    smoothed = comparison([True, True, True, False], [1.0, 2.0, 2.0, 0.0])
    table = smoothed_table(filtered, smoothed)
    assert table["ekf_rmse_m"] == pytest.approx([np.sqrt((9.0 + 16.0) / 2)] * 3)
    assert table["rmse_m"] == pytest.approx([np.sqrt(3.0)] * 3)
    assert table["epochs"] == 3
