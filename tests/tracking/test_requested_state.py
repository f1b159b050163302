"""The target at a requested time: ahead of the filter, behind it, and without a target."""

from types import SimpleNamespace

import pytest

from groundstation.tracking.pipeline import Pipeline


@pytest.mark.parametrize(
    ("has_target", "time_s", "t_s", "expected"),
    [
        (True, 5.0, 5.2, "ahead"),
        (True, 5.0, 5.0, "ahead"),
        (True, 5.0, 4.9, "behind"),
        (False, 5.0, 5.2, None),
        (True, None, 5.2, None),
        (False, None, 5.2, None),
    ],
)
def test_method_of_a_requested_state(has_target: bool, time_s: float | None, t_s: float, expected: str | None) -> None:
    pipeline = Pipeline.__new__(Pipeline)
    pipeline._ekf = SimpleNamespace(
        has_target=has_target, time_s=time_s, kinematics_at=lambda t: "ahead", smoothed_at=lambda t: "behind"
    )
    pipeline._track_manager = SimpleNamespace(reported=lambda found: found)
    assert pipeline.estimate_at(t_s) == expected
