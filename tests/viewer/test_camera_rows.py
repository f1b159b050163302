"""Rows of one camera in a recording: changes of status with their level, and a head whose angles are half known."""

from types import SimpleNamespace

import pytest

from groundstation.messages import DetectionStatus
from groundstation.viewer import camera_channel as rerun_cameras
from groundstation.viewer.blueprint import _states
from groundstation.viewer.camera_channel import CameraChannel


def channel() -> CameraChannel:
    made = CameraChannel.__new__(CameraChannel)
    made.station, made._last_status, made._last_angles = "left", None, None
    return made


def test_a_used_detection_is_no_warning_and_another_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_cameras, "_describe", lambda report: str(report.status))
    order = (DetectionStatus.OK, DetectionStatus.OK, DetectionStatus.MISS, DetectionStatus.OK)
    reports = [SimpleNamespace(t_s=float(k), status=status) for k, status in enumerate(order)]
    lanes, log = channel()._status(reports)
    assert list(lanes.t_s) == [0.0, 2.0, 3.0]
    rows = [row for column in log.columns for row in column.as_arrow_array().to_pylist()]
    items = [item for row in rows for item in row or ()]
    assert [item for item in items if item in ("INFO", "WARN")] == ["INFO", "WARN", "INFO"]


@pytest.mark.parametrize(("pan_rad", "tilt_rad"), [(0.1, None), (None, 0.1), (None, None)])
def test_a_head_is_turned_only_where_both_angles_exist(pan_rad: float | None, tilt_rad: float | None) -> None:
    assert channel()._pointing([SimpleNamespace(t_s=0.0, pan_rad=pan_rad, tilt_rad=tilt_rad)]) == []


def test_status_and_log_share_a_place() -> None:
    assert [view.name for view in _states().contents] == ["Status", "Log"]
