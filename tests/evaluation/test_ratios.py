"""Ratios of a summary, and the words about estimated parameters."""

from groundstation.evaluation.accuracy_table import _calibration_lines
from groundstation.evaluation.summary import _ratio


def test_without_a_divisor_there_is_no_ratio() -> None:
    assert _ratio([2.0, None, 3.0], [4.0, 1.0, None]) == [0.5, None, None]
    assert _ratio([2.0, 0.0], [0.0, 5.0]) == [None, 0.0]
    assert _ratio(None, [1.0]) is None
    assert _ratio([1.0], None) is None


def test_parameters_estimated_from_the_reference_are_reported_with_their_end() -> None:
    error = {"name": "left.camera_clock.offset", "estimated": True, "value": 0.01, "sigma": 0.001, "prior_sigma": 0.02}
    taught = _calibration_lines({"errors": [error], "learnt_until_s": 12.5, "use": "reference"})
    assert taught[0] == "learnt from DGPS until 12.50 s (with which it is not compared):"
    by_itself = _calibration_lines({"errors": [error], "learnt_until_s": None, "use": "estimate"})
    assert by_itself[0] == "learnt:"
    carried = _calibration_lines({"errors": [error], "learnt_until_s": None, "use": "reference"})
    assert carried == ["carried with their uncertainty, not estimated: left.camera_clock.offset"]
