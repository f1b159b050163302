"""`calibrate timing`: readings with a wrong sign, axis or unit are called that, and right ones are not."""

from collections.abc import Callable
from dataclasses import replace

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


def test_half_a_period_is_a_sign_or_clocks_apart(rng: np.random.Generator) -> None:
    """Both give the same data, so both are named; two rates tell them apart."""
    swing = Swing(pan_hz=1.0, tilt_deg=0.0)
    fault = reading_fault(*recorded(swing, Recorder(offset_s=0.45), rng))
    assert fault.startswith("pan reversed")
    assert fault.endswith("or clocks more than 0.3 s apart")
    readings, motion = recorded(Swing(tilt_deg=4.0), Recorder(offset_s=0.08), rng)
    readings[:, 1] *= -1.0
    fault = reading_fault(readings, motion)
    assert fault.startswith("pan reversed")
    assert "clocks" not in fault


def test_another_mount_is_named_with_a_sign(rng: np.random.Generator) -> None:
    """A camera upside down turns both signs; no mount turns degrees into radians."""
    readings, motion = recorded(Swing(), Recorder(), rng)
    hanging = replace(motion, turn_rad=-motion.turn_rad)
    assert "pan and tilt reversed (or another mount of the camera" in reading_fault(readings, hanging)
    readings[:, 1:] = np.radians(readings[:, 1:])
    assert "mount" not in reading_fault(readings, motion)


def test_pictures_that_do_not_move_accuse_nothing(rng: np.random.Generator) -> None:
    readings, motion = recorded(Swing(), Recorder(), rng)
    assert reading_fault(readings, replace(motion, turn_rad=np.zeros_like(motion.turn_rad))) == ""


def test_readings_over_the_end_of_a_turn(rng: np.random.Generator) -> None:
    """Pan from 359 to 1 deg is no jump; reversed, it is still called reversed."""
    readings, motion = recorded(Swing(), Recorder(), rng)
    readings[:, 1] = np.mod(readings[:, 1], 2.0 * np.pi)
    assert reading_fault(readings, motion) == ""
    readings[:, 1] = np.mod(-readings[:, 1], 2.0 * np.pi)
    assert reading_fault(readings, motion).startswith("pan reversed")
