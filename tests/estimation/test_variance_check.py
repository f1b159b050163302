"""Covariances that are none: their root or logarithm is a numerical failure of the filter, not a wrong value."""

import math
from pathlib import Path

import numpy as np
import pytest

from groundstation.estimation.variance_check import require_definite, sigma_of
from groundstation.tracking.existence_probability import ExistenceProbability
from groundstation.tracking.weighed_pixel import weighed
from tests.live.test_filter_reset import Recorded, flown_and_replayed, held_to
from tests.tracking.test_weighed_pixel import NOSE, PICTURE_PX, detection

INDEFINITE = np.array([[4.0, 9.0], [9.0, 4.0]])


def test_a_variance_that_is_negative_or_no_number() -> None:
    assert sigma_of(9.0, "height") == 3.0
    assert sigma_of(0.0, "height") == 0.0
    for variance in (-1e-3, math.nan):
        with pytest.raises(np.linalg.LinAlgError, match=f"^height: got a variance of {variance:.4g}, wanted >= 0$"):
            sigma_of(variance, "height")


@pytest.mark.parametrize("covariance", [INDEFINITE, -np.eye(2), np.zeros((2, 2)), np.full((2, 2), np.nan)])
def test_a_covariance_that_is_not_definite(covariance: np.ndarray) -> None:
    require_definite(np.eye(2), "pixel")
    with pytest.raises(
        np.linalg.LinAlgError, match=r"pixel: got variances of .* px², wanted a positive definite matrix"
    ):
        require_definite(covariance, "pixel")


def test_the_existence_of_a_target_under_an_indefinite_covariance() -> None:
    """Expected: no `ValueError: math domain error`, which operation takes for a fault of the program."""
    existence = ExistenceProbability(1.0)
    with pytest.raises(np.linalg.LinAlgError, match="innovation of left: got variances of 4 and 4 px²"):
        existence.hit("left", 1.0, np.array([1.0, 0.5]), INDEFINITE)


def test_hypotheses_under_an_indefinite_covariance() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="predicted pixel: got variances of"):
        weighed(detection(0.5), NOSE, INDEFINITE * 1e3, PICTURE_PX)


def test_operation_is_reset_by_an_indefinite_covariance(tmp_path: Path) -> None:
    """Expected: the filter is reset and finds the target again, and the replay, whose covariance is right, too."""

    def prepare(flown: Recorded) -> None:
        ekf, failed = flown._core.pipeline._ekf, list[float]()
        of_pixel = ekf.pixel_covariance

        def covariance(prediction: object) -> np.ndarray:
            if ekf.time_s is not None and ekf.time_s > 1.5 and not failed:
                failed.append(ekf.time_s)
                return INDEFINITE
            return of_pixel(prediction)  # type: ignore[arg-type]

        ekf.pixel_covariance = covariance  # type: ignore[method-assign]

    flown, result, folder = flown_and_replayed(tmp_path, prepare)
    held_to(flown, result, folder, 1)
