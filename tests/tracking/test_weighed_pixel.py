"""A pixel with several hypotheses: the prediction decides between them, and its word has a limit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.box import box_of_size
from groundstation.messages import Detection, PointHypothesis
from groundstation.tracking.frame_update import FrameUpdate
from groundstation.tracking.weighed_pixel import weighed

NOSE, TAIL = np.array([300.0, 200.0]), np.array([380.0, 205.0])
PICTURE_PX = (640, 480)


def detection(p_nose: float, sigma_px: float = 3.0) -> Detection:
    hypotheses = tuple(
        PointHypothesis(pixel=at, covariance_px2=np.eye(2) * sigma_px**2, probability=p)
        for at, p in ((NOSE, p_nose), (TAIL, 1.0 - p_nose))
    )
    return Detection(
        u_px=float(NOSE[0]),
        v_px=float(NOSE[1]),
        covariance_px2=np.eye(2) * 100.0,
        noise_px2=np.eye(2) * 30.0,
        centroid_px=np.array([340.0, 203.0]),
        box=box_of_size(290.0, 190.0, 100.0, 30.0),
        area_px=900.0,
        contour_px=np.empty((0, 2), np.float32),
        contrast_to_noise=4.0,
        channel="learned",
        hypotheses=hypotheses,
    )


@pytest.mark.parametrize(("expected", "other"), [(NOSE, TAIL), (TAIL, NOSE)])
def test_the_prediction_decides_between_ends_that_are_as_likely(expected: np.ndarray, other: np.ndarray) -> None:
    """And the other end stays in the covariance: the prediction may come from wrong pixels itself."""
    found = weighed(detection(0.5), expected + [2.0, -1.0], np.eye(2) * 16.0, PICTURE_PX)
    np.testing.assert_allclose([found.u_px, found.v_px], expected)
    off = other - expected
    assert 2.0 < off @ np.linalg.solve(found.covariance_px2, off) < 9.0
    assert np.trace(found.noise_px2) / np.trace(found.covariance_px2) == pytest.approx(0.3)


def test_a_sure_prediction_outweighs_no_sure_detector() -> None:
    """A filter that has followed the tail predicts it: a nose that is seen in 99 of 100 stays likelier."""
    found = weighed(detection(0.99), TAIL, np.eye(2) * 0.01, PICTURE_PX)
    np.testing.assert_allclose([found.u_px, found.v_px], NOSE)
    assert found.hypotheses[0].probability == pytest.approx(0.99 / (0.99 + 0.01 * np.e))


def test_a_prediction_that_knows_nothing_changes_nothing() -> None:
    found = weighed(detection(0.7), np.array([340.0, 203.0]), np.eye(2) * 1e6, PICTURE_PX)
    assert found.hypotheses[0].probability == pytest.approx(0.7, abs=0.01)


def test_a_point_outside_the_picture_is_none_that_it_shows() -> None:
    """Expected: in 1000044 the direction of flight had the nose of a cut aircraft at u = -306 px."""
    by_itself = detection(0.5)
    outside = weighed(by_itself, TAIL, np.eye(2), (360, 480))
    np.testing.assert_allclose([outside.u_px, outside.v_px], NOSE)
    # the likelier end, 80 px away, is in the covariance
    p_tail = 1.0 / (1.0 + np.exp(-1.0))
    assert outside.covariance_px2[0, 0] == pytest.approx(9.0 + p_tail * 80.0**2)
    assert np.trace(outside.noise_px2) / np.trace(outside.covariance_px2) == pytest.approx(0.3)
    inside = weighed(by_itself, NOSE, np.eye(2), (360, 480))
    np.testing.assert_allclose([inside.u_px, inside.v_px], NOSE)


def test_a_pixel_without_other_hypotheses_stays() -> None:
    only = replace(detection(0.5), hypotheses=())
    assert weighed(only, TAIL, np.eye(2), PICTURE_PX) is only


def test_cameras_agree_by_what_each_shows_and_not_by_the_filter() -> None:
    """A filter that is wrong must not move the pixels by which cameras outvote it."""
    update, views = FrameUpdate.__new__(FrameUpdate), []
    geometry = SimpleNamespace(image_size_px=(640, 480))
    update._cameras = {"left": SimpleNamespace(geometry=geometry, station=SimpleNamespace(readout_s=0.0))}
    update._health = SimpleNamespace(uses=lambda station: False)
    update._ekf = SimpleNamespace(pointing_sigma_rad=lambda station: 0.0)
    update._epochs = SimpleNamespace(add=views.append)
    by_itself = detection(0.5)
    found = weighed(by_itself, TAIL, np.eye(2), PICTURE_PX)
    seen = SimpleNamespace(by_itself=by_itself, predicted_px=None, covariance_px2=None)
    record = SimpleNamespace(station="left", t_s=1.0, epoch=3)
    update._fuse_detection(record, found, seen, SimpleNamespace(pan_rad=0.0, tilt_rad=0.0, sigma_rad=0.0))
    np.testing.assert_allclose([found.u_px, found.v_px], TAIL)
    np.testing.assert_allclose(views[0].view.pixel, NOSE)
    np.testing.assert_allclose(views[0].view.covariance_px2, by_itself.covariance_px2)
