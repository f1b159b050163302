"""The level set starts from the last silhouette, moved and scaled, or from an ellipse."""

import numpy as np
import pytest

from groundstation.detection.start_contour import PreviousSilhouette, start_contour
from groundstation.detection.working_image import WorkingImage, crop_working_image
from tests.detection.painted import look_at, sky, whole


def look(point: tuple[float, float], span_px: float | None, sigma_px: float) -> WorkingImage:
    image = sky((220, 120)).astype(np.uint8)
    return crop_working_image(image, whole(image), look_at(point, span_px, sigma_px), (span_px, 0.1), (2.0, 160.0))


def silhouette() -> PreviousSilhouette:
    mask = np.zeros((11, 41), np.uint8)
    mask[5, :] = 1
    mask[:, 20] = 1
    return PreviousSilhouette(mask=mask, point=np.array([20.0, 5.0]), width=41.0, scale=1.0)


def test_first_an_ellipse_of_the_expected_size() -> None:
    inside = start_contour(look((100.0, 60.0), 40.0, 3.0), None)
    assert inside.shape == (120, 220)
    assert inside.any(axis=0).sum() == 41
    assert inside.any(axis=1).sum() == 21
    assert inside[60, 100]


def test_then_the_last_silhouette_at_its_prediction() -> None:
    inside = start_contour(look((130.0, 50.0), 41.0, 0.2), silhouette())
    assert inside[50, 110:151].all()
    assert inside[45:56, 130].all()
    # widened by one pixel, no more
    assert inside.sum() < 4 * silhouette().mask.sum()


def test_it_grows_with_the_span_and_widens_with_the_doubt() -> None:
    sure = start_contour(look((110.0, 60.0), 52.0, 0.2), silhouette())
    assert sure.any(axis=0).sum() == pytest.approx(52 * 43 / 41, abs=2)
    unsure = start_contour(look((110.0, 60.0), 52.0, 6.0), silhouette())
    assert np.all(unsure[sure])
    assert unsure.any(axis=1).sum() >= sure.any(axis=1).sum() + 8


def test_a_prediction_beyond_the_window_gives_an_empty_contour() -> None:
    assert not start_contour(look((600.0, 60.0), 41.0, 1.0), silhouette()).any()
