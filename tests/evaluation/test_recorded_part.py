"""The part of a session that is studied, its ends included."""

from types import SimpleNamespace

import numpy as np

from groundstation.experiments.localisation import _against_dgps
from groundstation.experiments.truth_session import TruthSession


def test_the_ends_belong_to_it() -> None:
    recorded = TruthSession.__new__(TruthSession)
    recorded.from_s, recorded.to_s = 1.0, 3.0
    assert recorded.inside(np.array([0.9, 1.0, 2.0, 3.0, 3.1])).tolist() == [False, True, True, True, False]


def test_a_log_that_covers_a_part_is_compared_with_on_that_part() -> None:
    known = np.array([True, True, False, True])
    comparison = SimpleNamespace(
        both_known=known,
        reference_m=np.zeros((4, 3)),
        ekf_error_m=np.ones((4, 3)),
        triangulation_error_m=np.full((4, 3), 2.0),
    )
    evaluation = SimpleNamespace(comparisons={"dgps": comparison}, epochs={"midpoint_m": np.full((4, 3), 3.0)})
    (row, *_) = _against_dgps(SimpleNamespace(evaluation=evaluation))
    assert row[:2] == ["all, against DGPS", 3]
    comparison.both_known = ~known & known
    assert _against_dgps(SimpleNamespace(evaluation=evaluation)) == []
    assert _against_dgps(SimpleNamespace(evaluation=SimpleNamespace(comparisons={}))) == []
