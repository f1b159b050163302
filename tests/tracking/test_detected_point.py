"""The lead of a hidden nose where a receiver on the aircraft says where it is."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from groundstation.messages import Kinematics, ReferenceFix
from groundstation.tracking.camera_tracker import SpanModel
from groundstation.tracking.config import Config
from groundstation.tracking.detected_point import DetectedPoint
from groundstation.tracking.reference_fusion import ReferenceUpdate
from tests.stereo_rig import make_rig

AWAY = Kinematics(
    position_runway_m=np.array([0.0, 2000.0, 2.0]),
    velocity_runway_m_s=np.array([0.0, 20.0, 0.0]),
    covariance=np.diag([0.04] * 3 + [0.01] * 3),
)
SPAN_M = 3.0


def point(*, detected: bool, inferred: bool = True) -> DetectedPoint:
    camera: Any = SimpleNamespace(has_detected=detected, infers_hidden_nose=inferred)
    eyes = [s.geometry().camera_pose(0.0, 0.0).position_runway_m for s in make_rig().stations]
    return DetectedPoint(Config(), {"left": camera}, SpanModel(SPAN_M), eyes)


def test_the_lead_is_a_share_of_the_span_once_detected() -> None:
    lead = point(detected=True).lead_m(AWAY)
    np.testing.assert_allclose(lead, [0.0, SPAN_M * Config().estimation.target_point_behind_lead_spans, 0.0], atol=1e-3)
    moved = point(detected=True).as_target_point(AWAY).position_runway_m - AWAY.position_runway_m
    np.testing.assert_allclose(moved, lead)
    for other in (point(detected=False), point(detected=True, inferred=False)):
        np.testing.assert_array_equal(other.lead_m(AWAY), 0.0)
    assert point(detected=False).as_target_point(AWAY) is AWAY


@pytest.mark.parametrize("detected", [False, True])
def test_a_receivers_position_is_put_back_to_the_detected_point(detected: bool) -> None:
    """Expected: a state that is put to the receiver's nose, and moved ahead when reported, would be too far ahead."""
    used: list[np.ndarray] = []
    found = point(detected=detected)

    def update(reference: Any) -> SimpleNamespace:
        used.append(reference.position_m)
        return SimpleNamespace(accepted=True, residual=np.zeros(3))

    ekf: Any = SimpleNamespace(
        has_target=True,
        learns=True,
        state=np.zeros(6),
        covariance=AWAY.covariance,
        kinematics_of=lambda state, covariance: AWAY,
        nose_of=lambda reference: reference.position_m,
        update_reference=update,
    )
    manager: Any = SimpleNamespace(detected_point=found, state_machine=SimpleNamespace(seen_by_two=lambda t_s: True))
    check: Any = SimpleNamespace(contradicts=lambda t_s, nose: False)
    fusion = ReferenceUpdate(ekf, manager, Any, check, lambda t_s, text: None)  # type: ignore[arg-type]
    nose = AWAY.position_runway_m
    assert fusion._fuse(ReferenceFix(t_s=1.0, position_runway_m=nose, sigma_m=np.ones(3)), 0.0)
    reported = found.as_target_point(replace(AWAY, position_runway_m=used[0])).position_runway_m
    np.testing.assert_allclose(reported, nose, atol=1e-3)
