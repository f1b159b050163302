"""The fit of a station's bearings from a guessed pose: its derivatives."""

import numpy as np
import pytest

from calibration.landmarks.survey_start import BearingFit, SeenBearings
from calibration.orientation import PoseGuess
from groundstation.geometry.rotation import rotation_from_vector


@pytest.mark.parametrize("known", [True, False])
def test_every_derivative_has_its_numeric_twin(rng: np.random.Generator, known: bool) -> None:
    """Of near points and of a direction, about a pose that is turned and shifted."""
    bearings = rng.normal(size=(6, 3))
    far = np.array([False] * 5 + [True])
    seen = SeenBearings(
        bearings=bearings / np.linalg.norm(bearings, axis=1, keepdims=True),
        landmark=np.arange(6),
        points_m=rng.normal(scale=60.0, size=(6, 3)) * np.where(far, 1e8, 1.0)[:, None],
        far=far,
    )
    turn, position = rotation_from_vector(rng.normal(size=3)), rng.normal(scale=3.0, size=3)
    fit = BearingFit(
        seen=seen, guess=PoseGuess(runway_from_base=turn, position_m=position, median_rad=0.0), known=known
    )
    at = rng.normal(scale=0.3, size=3 if known else 6)
    slope, step = fit.slope(at), 1e-5
    assert slope.shape == (18, len(at))
    for k in range(len(at)):
        d = np.zeros(len(at))
        d[k] = step
        numeric = (fit.off(at + d) - fit.off(at - d)) / (2 * step)
        assert np.abs(numeric).max() > 1e-3
        np.testing.assert_allclose(slope[:, k], numeric, atol=1e-8)
