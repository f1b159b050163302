"""The slow part of an encoder's error, learnt from pictures: removed where it is, harmless where there is none."""

import numpy as np
import pytest

from groundstation.estimation.encoder_offset import OffsetEstimator
from groundstation.messages import FrameAngles, PtuSample
from tests.estimation.test_encoders import feed, read

SIGMA_RAD = float(np.radians(0.02))


def picture(pan_rad: float, tilt_rad: float = 0.0) -> FrameAngles:
    return FrameAngles(t_s=0.0, station="left", pan_rad=pan_rad, tilt_rad=tilt_rad, sigma_rad=1e-6)


def test_a_constant_error_is_found_and_forgotten_as_the_head_turns_away() -> None:
    estimator = OffsetEstimator(SIGMA_RAD)
    assert estimator.offset.near(0.0, 0.0) == (0.0, 0.0)
    for _ in range(20):
        estimator.take(SIGMA_RAD, -SIGMA_RAD, 1.0, picture(0.0))
    pan, tilt = np.array(estimator.offset.near(0.0, 0.0)) / SIGMA_RAD
    assert 0.95 < pan < 1.0
    assert tilt == pytest.approx(-pan)
    far = np.array(estimator.offset.near(np.radians(10.0), 0.0)) / SIGMA_RAD
    assert 0.0 < far[0] < 0.01
    assert far[1] == pytest.approx(tilt), "an axis's error is its own"
    # across the end of the range
    assert estimator.offset.near(2.0 * np.pi, 0.0) == pytest.approx(estimator.offset.near(0.0, 0.0))


@pytest.mark.parametrize(("turned_deg", "most"), [(0.0, 1.05), (0.5, 1.1), (30.0, 1.13)])
def test_noise_alone_is_hardly_made_larger(turned_deg: float, most: float) -> None:
    """Expected: rms of what is left over that of the encoder; at worst √(1 + 1/4), where each picture is the first."""
    random, estimator, left = np.random.default_rng(6), OffsetEstimator(SIGMA_RAD), []
    pan = 0.0
    for noise, between in random.normal(0.0, SIGMA_RAD, (4000, 2)).tolist():
        pan += float(np.radians(turned_deg))
        estimator.take(pan + noise, 0.0, 1.0, picture(pan))
        left.append(between - estimator.offset.near(pan, 0.0)[0])
    assert np.sqrt(np.mean(np.square(left))) < most * SIGMA_RAD


def test_an_error_that_returns_with_the_gear_is_followed() -> None:
    """Expected: of 0.02° with a period of 12°, seen every 0.3°, less than half is left."""
    estimator, left = OffsetEstimator(SIGMA_RAD), []
    for k in range(400):
        pan = np.radians(0.3 * k)
        off = np.sqrt(2.0) * SIGMA_RAD * np.sin(30.0 * pan)
        left.append(off - estimator.offset.near(pan, 0.0)[0])
        estimator.take(float(pan + off), 0.0, 1.0, picture(float(pan)))
    assert np.sqrt(np.mean(np.square(left))) < 0.5 * SIGMA_RAD


def test_an_exact_encoder_has_no_offset() -> None:
    estimator = OffsetEstimator(0.0)
    estimator.take(1e-3, 0.0, 1.0, picture(0.0))
    assert estimator.offset.near(0.0, 0.0) == (0.0, 0.0)


def test_readings_are_fused_without_what_a_picture_found() -> None:
    """Expected: the filter stays at the picture's angle under readings that are 0.05° off, and a rewind forgets it."""
    ekf, encoders = feed()
    off = 0.05
    for k in range(20):
        read(ekf, encoders, 0.02 * k, 1.0 + off)
    before = encoders.snapshot()
    encoders.read(
        PtuSample(
            t_s=0.4,
            station="left",
            pan_rad=float(np.radians(1.0)),
            tilt_rad=0.0,
            sigma_rad=1e-6,
            encoder_off_rad=(float(np.radians(off)), 0.0),
        )
    )
    for k in range(21, 60):
        read(ekf, encoders, 0.02 * k, 1.0 + off)
    assert np.degrees(ekf.angles("left")[0]) == pytest.approx(1.0, abs=0.005)
    encoders.restore(before)
    for k in range(60, 100):
        read(ekf, encoders, 0.02 * k, 1.0 + off)
    assert np.degrees(ekf.angles("left")[0]) == pytest.approx(1.0 + off, abs=0.005)
