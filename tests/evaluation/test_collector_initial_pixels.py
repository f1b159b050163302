"""Pixels by which a target was found, in the table of camera reports."""

import numpy as np

from groundstation.evaluation.collector import DETECTION_STATUSES, NO_REASON, ResultCollector
from groundstation.messages import (
    CameraReport,
    DetectionStatus,
    InitialPixel,
    Miss,
    MissReason,
    StepReport,
)


def _report(t_s: float, reason: MissReason) -> CameraReport:
    return CameraReport(
        t_s=t_s,
        station="left",
        epoch=round(10 * t_s),
        status=DetectionStatus.MISS,
        result=Miss(reason=reason, detail=""),
        roi=None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=0.0,
        tilt_rad=0.0,
        innovation=None,
        elapsed_s=0.0,
    )


def _pixel(t_s: float) -> InitialPixel:
    return InitialPixel(t_s=t_s, station="left", u_px=3.0, v_px=4.0, sigma_px=2.0)


def test_only_searched_frames_of_the_last_seconds_get_a_pixel() -> None:
    collector = ResultCollector()
    for k in range(80):
        reason = MissReason.LOW_CONTRAST if k == 70 else MissReason.NOT_ACQUIRED
        collector.write(StepReport(cameras=(_report(0.1 * k, reason),)))
    collector.write(StepReport(initial_pixels=tuple(_pixel(0.1 * k) for k in (2, 69, 70, 71))))
    rows = collector.cameras()
    known = np.isfinite(rows["pixel"]).all(axis=1)
    assert np.flatnonzero(known).tolist() == [69, 71]
    for row in rows[known]:
        assert row["pixel"].tolist() == [3.0, 4.0]
        assert row["covariance_px2"].tolist() == [[4.0, 0.0], [0.0, 4.0]]
        assert DETECTION_STATUSES[row["status"]] is DetectionStatus.INITIAL
        assert row["reason"] == NO_REASON
        # it was in no update of the filter
        assert not row["accepted"]
        assert np.isnan(row["nis"])
