"""A pixel that someone else has found, as a detection and as a candidate for a target."""

import math

import numpy as np

from groundstation.box import Box
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.messages import Detection, PixelMeasurement


def labelled_detection(record: PixelMeasurement, usual_sigma_px: float) -> Detection:
    """Return a labelled pixel as a detection without a silhouette, with its own noise, or the usual one."""
    usual = (usual_sigma_px, usual_sigma_px)
    covariance = np.diag(np.square(usual if record.sigma_px is None else record.sigma_px))
    return Detection(
        u_px=record.u_px,
        v_px=record.v_px,
        covariance_px2=covariance,
        noise_px2=covariance,
        centroid_px=np.array([record.u_px, record.v_px]),
        box=Box(record.u_px, record.v_px, record.u_px, record.v_px),
        area_px=0.0,
        contour_px=np.zeros((0, 2), dtype=np.float32),
        contrast_to_noise=0.0,
        channel="labelled",
    )


def labelled_candidate(
    record: PixelMeasurement, pan_rad: float, tilt_rad: float, angle_sigma_rad: float
) -> CameraCandidate:
    """Return a labelled pixel as a candidate; a pixel with a sigma has the mean variance of u and v."""
    return CameraCandidate(
        t_s=record.t_s,
        station=record.station,
        pixel=np.array([record.u_px, record.v_px]),
        width_px=None,
        score=1.0,
        pan_rad=pan_rad,
        tilt_rad=tilt_rad,
        angle_sigma_rad=angle_sigma_rad,
        labelled=True,
        sigma_px=None if record.sigma_px is None else math.hypot(*record.sigma_px) / math.sqrt(2.0),
    )
