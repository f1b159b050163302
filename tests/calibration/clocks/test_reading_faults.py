"""`calibrate timing`: readings with a wrong sign, axis or unit are called that, and right ones are not."""

from collections.abc import Callable

import numpy as np
import pytest

from calibration.clocks.ptu_clock_fit import TimingFitError, solve_timing
from calibration.clocks.reading_faults import reading_fault
from tests.calibration.clocks.swings import Recorder, Swing, recorded
from tests.complaints import complaint

SIGMA_RAD = np.radians(0.01)


@pytest.mark.parametrize("swing", [Swing(), Swing(tilt_deg=0.0), Swing(pan_deg=1.0, tilt_deg=4.0)])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: a * [-1, 1], "pan reversed"),
        (lambda a: -a, "reversed"),
        (lambda a: a[:, ::-1], "pan and tilt exchanged"),
        (np.radians, "readings in radians"),
        (lambda a: 60.0 * a, "readings in minutes of arc"),
    ],
)
def test_wrong_readings_are_called_what_they_are(
    rng: np.random.Generator, swing: Swing, change: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    readings, motion = recorded(swing, Recorder(offset_s=0.08), rng)
    readings[:, 1:] = change(readings[:, 1:])
    message = complaint(TimingFitError, lambda: solve_timing("left", readings, motion, SIGMA_RAD))
    assert message.startswith("station left: got readings that contradict the pictures as they stand, and agree")
    assert words in message


@pytest.mark.parametrize(
    "swing", [Swing(), Swing(pan_deg=0.3, tilt_deg=0.0), Swing(pan_hz=2.0, tilt_hz=2.0), Swing(tilt_deg=4.0)]
)
@pytest.mark.parametrize("offset_s", [-0.25, 0.0, 0.25])
def test_right_readings_are_not_accused(rng: np.random.Generator, swing: Swing, offset_s: float) -> None:
    """Of quick swings, too, of which half a period is within the clocks' difference."""
    assert reading_fault(*recorded(swing, Recorder(offset_s=offset_s), rng)) == ""


def test_a_scale_is_no_unit(rng: np.random.Generator) -> None:
    """Gradians and a wrong focal length are for the report of the fit."""
    readings, motion = recorded(Swing(), Recorder(), rng)
    readings[:, 1:] /= 0.9
    assert reading_fault(readings, motion) == ""
