"""Silhouettes that are too wide or too narrow for the aircraft whose span was given."""

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.integrity.apparent_span import ApparentSpanMonitor
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    Innovation,
    StepReport,
    TrackEstimate,
    TrackStatus,
    Triangulation,
    TriangulationStatus,
)
from tests.stereo_rig import make_station

STATIONS = {name: make_station(name, x).geometry() for name, x in (("left", -5.0), ("right", 5.0))}


def report(
    epoch: int,
    range_m: float,
    width_m: float,
    *,
    accepted: bool = True,
    cut: bool = False,
    bearing_rad: float = 0.0,
) -> StepReport:
    """A pair of silhouettes ``width_m`` wide at a triangulated range."""
    point = np.array([range_m * np.sin(bearing_rad), range_m * np.cos(bearing_rad), 5.0])
    cameras = []
    for name, geometry in STATIONS.items():
        eye = geometry.camera_pose(0.0, 0.0).position_runway_m
        width_px = width_m * float(geometry.lens.focal_px[0]) / float(np.linalg.norm(point - eye))
        found = Detection(
            u_px=300.0,
            v_px=200.0,
            covariance_px2=np.eye(2),
            noise_px2=np.eye(2),
            centroid_px=np.array([300.0, 200.0]),
            box=Box(300.0, 190.0, 300.0 + width_px, 210.0),
            area_px=100.0,
            contour_px=np.empty((0, 2), np.float32),
            contrast_to_noise=9.0,
            channel="learned",
            cut=cut,
        )
        innovation = Innovation(residual=np.zeros(2), covariance=np.eye(2), nis=0.0, dof=2, accepted=accepted)
        cameras.append(
            CameraReport(
                t_s=0.1 * epoch,
                station=name,
                epoch=epoch,
                status=DetectionStatus.OK,
                result=found,
                roi=None,
                predicted_px=None,
                predicted_covariance_px2=None,
                pan_rad=0.0,
                tilt_rad=0.0,
                innovation=innovation,
                elapsed_s=0.0,
            )
        )
    triangulation = Triangulation(
        midpoint_runway_m=point, point_runway_m=point, covariance_m2=np.eye(3), gap_m=0.0, residual_sigma=0.0
    )
    estimate = TrackEstimate(
        t_s=0.1 * epoch,
        epoch=epoch,
        status=TrackStatus.TRACKING,
        kinematics=None,
        triangulation_status=TriangulationStatus.OK,
        triangulation=triangulation,
    )
    return StepReport(cameras=tuple(cameras), estimates=(estimate,))


def watched(width_m: float, span_m: float | None = 2.0, count: int = 60, **options: bool) -> ApparentSpanMonitor:
    monitor = ApparentSpanMonitor(STATIONS, span_m)
    for epoch in range(count):
        monitor.add(report(epoch, 400.0 - 5.0 * epoch % 300.0, width_m, **options))
    return monitor


@pytest.mark.parametrize("width_m", [0.6, 1.2, 2.0, 2.5, 2.9])
def test_any_view_of_the_aircraft_is_believed(width_m: float) -> None:
    assert watched(width_m).fault() is None


@pytest.mark.parametrize("width_m", [0.2, 4.0, 20.0])
def test_another_size_is_reported(width_m: float) -> None:
    fault = watched(width_m, count=3000).fault()
    assert fault is not None
    assert fault.seen_m == pytest.approx(width_m, rel=1e-6)
    assert f"{width_m:.2g} m wide" in fault.line()
    assert "given as 2 m" in fault.line()


def test_what_cannot_tell_says_nothing() -> None:
    assert watched(4.0, span_m=None).fault() is None
    assert watched(4.0, count=29).fault() is None
    assert watched(4.0, accepted=False).fault() is None
    assert watched(4.0, cut=True).fault() is None
