"""Mid-exposure from each convention of a device's stamp, and from an arrival alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.sources.cameras.camera import CameraTiming, GrabbedFrame, StampPoint
from groundstation.sources.cameras.stamping import Stamper

PAYLOAD, TRANSFER_S = 1_250_000, 0.010


def exposed(stamper: Stamper, start_s: float, exposure_s: float, stamp: StampPoint) -> float:
    """Return what is stamped of a frame whose exposure starts at ``start_s``; the device is 500 s ahead."""
    at_s = {
        StampPoint.START: start_s,
        StampPoint.MIDDLE: start_s + exposure_s / 2,
        StampPoint.END: start_s + exposure_s,
    }
    grab = GrabbedFrame(
        frame_id=1, device_ns=round((500.0 + at_s[stamp]) * 1e9), pixels=None, pattern=None, payload_bytes=PAYLOAD
    )
    return stamper.stamp(grab, start_s + exposure_s + TRANSFER_S, exposure_s, None, None).t_s


@pytest.mark.parametrize("stamp", list(StampPoint))
@given(exposures_ms=st.lists(st.floats(0.1, 20.0), min_size=2, max_size=40))
def test_an_exposure_that_changes_is_no_clock_that_changes(stamp: StampPoint, exposures_ms: list[float]) -> None:
    stamper = Stamper(CameraTiming(stamp=stamp))
    for i, exposure_ms in enumerate(exposures_ms):
        t_s = exposed(stamper, 0.04 * i, exposure_ms * 1e-3, stamp)
        assert t_s == pytest.approx(0.04 * i + exposure_ms * 0.5e-3, abs=1e-6)


def test_a_wrong_convention_gives_an_error_of_the_exposures_variation() -> None:
    """So a constant exposure hides it: the envelope is tied to the arrivals."""
    steady, varied = Stamper(CameraTiming(stamp=StampPoint.END)), Stamper(CameraTiming(stamp=StampPoint.END))
    errors = [exposed(steady, 0.04 * i, 0.010, StampPoint.START) - (0.04 * i + 0.005) for i in range(50)]
    assert np.abs(errors).max() < 1e-6
    times = [(0.04 * i, 0.010 if i % 2 else 0.002) for i in range(50)]
    errors = [exposed(varied, s, e, StampPoint.START) - (s + e / 2) for s, e in times]
    assert np.abs(errors[2:]).max() == pytest.approx(0.008, abs=1e-4)


def test_without_a_device_clock_the_arrival_less_the_transfer() -> None:
    stamper = Stamper(CameraTiming(exposure_s=0.02))
    grab = GrabbedFrame(frame_id=None, device_ns=None, pixels=None, pattern=None, payload_bytes=PAYLOAD)
    stamp = stamper.stamp(grab, 100.0, None, 0.03, 0.02)
    assert (stamp.t_s, stamp.sigma_s) == (pytest.approx(100.0 - 0.03 - 0.01), 0.02)
    stamp = Stamper(CameraTiming(transfer_s=0.05, transfer_sigma_s=0.001)).stamp(grab, 100.0, 0.01, 0.03, 0.02)
    assert (stamp.t_s, stamp.sigma_s) == (pytest.approx(100.0 - 0.05 - 0.005), 0.001)
    reckoned = Stamper(CameraTiming(link_mbit_s=100.0)).stamp(grab, 100.0, 0.0, None, None)
    assert (reckoned.t_s, reckoned.sigma_s) == (pytest.approx(99.9), pytest.approx(0.05))
    assert stamper.clock is None
