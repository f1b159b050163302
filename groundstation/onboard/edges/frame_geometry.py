"""Geometry of a frame for line tracking: rows, crossings of the prediction, bands, noise."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.config import MeasurementModel, TrackerConfig
from groundstation.onboard.edges.edge_measurement import EdgeMeasurement
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.line_kernel import (
    BandLimits,
    GeometryArrays,
    band_widths_of,
    fill_frame_geometry,
    noise_of_pose,
)
from groundstation.onboard.edges.line_state import PITCH, ROLL, UP, C, D
from groundstation.onboard.edges.pose import NoseCameraPose, corrected_pose
from groundstation.onboard.edges.search_band import NoBand, across_direction, band_rows
from groundstation.onboard.edges.width_prior import WidthPrior, other_pair_m2

# fainter than a quarter of plain contrast an edge is not drawn farther: the profile's own sigma grows there; the edge
# of a profile is drawn less where contrast is plain, and the more the fainter it gets
_MOST_FAINT, _MOST_FAINT_PROFILE = 4.0, 12.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackerCamera:
    """Camera without distortion and tuning: intrinsic matrix (3, 3), image size (w, h) in px."""

    kappa: FloatArray
    image_size_px: tuple[int, int]
    config: TrackerConfig


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameGeometry:
    """A frame's geometry: pose, intrinsic matrix, line map E, rows, predicted crossings, how they move, bands."""

    pose: NoseCameraPose
    kappa: FloatArray
    e: FloatArray
    rows: FloatArray
    predicted: FloatArray
    h: FloatArray
    by_pose: FloatArray
    widths: FloatArray
    across: FloatArray


def frame_geometry(camera: TrackerCamera, pose: NoseCameraPose, state: LineState) -> FrameGeometry | None:
    """Return the geometry of a frame for predicted lines, None where no rows hold runway."""
    mean = state.mean[:4]
    if state.mean.size > 4:
        pose = corrected_pose(pose, *(float(v) for v in state.mean[[ROLL, PITCH, UP]]))
    rows = band_rows(
        pose,
        camera.kappa,
        camera.image_size_px,
        camera.config.guess,
        middle_m=-0.5 * float(mean[C] + mean[D]),
        width_m=abs(float(mean[C] - mean[D])),
    )
    return None if isinstance(rows, NoBand) else geometry_between_rows(camera, pose, state, rows)


def geometry_between_rows(
    camera: TrackerCamera, pose: NoseCameraPose, state: LineState, rows: FloatArray
) -> FrameGeometry:
    """Return the geometry between rows (2,) that are given, the pose taken as it is."""
    config, size = camera.config, state.mean.size
    predicted, h, by_pose = np.empty(4), np.empty((4, size)), np.empty((4, 6))
    widths, across = np.empty((2, 2)), np.empty(2)
    e = fill_frame_geometry(
        pose.threshold_from_camera,
        pose.camera_threshold_m,
        camera.kappa,
        state.mean,
        rows,
        BandLimits(config.band_m, config.least_band_px, config.most_band_px),
        config.bands_across,
        GeometryArrays(predicted, h, by_pose, widths, across),
    )
    return FrameGeometry(
        pose=pose,
        kappa=camera.kappa,
        e=e,
        rows=rows,
        predicted=predicted,
        h=h,
        by_pose=by_pose,
        widths=widths,
        across=across,
    )


def widths_of(
    config: TrackerConfig, mean: FloatArray, e: FloatArray, rows: FloatArray, crossings: FloatArray, band_m: float
) -> FloatArray:
    """Return the widths ℓ (2, 2) of bands of ``band_m`` about lines (4,), px."""
    widths, across = np.empty((2, 2)), across_direction(e) if config.bands_across else np.zeros(2)
    band_widths_of(
        mean, e, rows, crossings, BandLimits(band_m, config.least_band_px, config.most_band_px), across, widths
    )
    return widths


def pose_noise(config: TrackerConfig, look: FrameGeometry) -> FloatArray:
    """Return the effect of the pose's uncertainty on the crossings, (4, 4) px²."""
    if config.measurement is MeasurementModel.LINES:
        return np.zeros((4, 4))
    return np.asarray(noise_of_pose(look.by_pose, config.attitude_sigma_rad, config.position_sigma_m))


def yaw_place_m(config: TrackerConfig, pose: NoseCameraPose) -> float:
    """Return by how much a lasting error of yaw moves lines across the runway at its threshold, sigma in m.

    Of a stated error: 0 without. Where none is known, a pair far aside is more often another pair than the runway by a
    yaw that is so far off: with 0.7° for all, 29 more of 1,200 frames of train 0-29 and 500000-500029 tracked to 2 px,
    and nine instead of one were beyond three sigmas.
    """
    return 0.0 if config.lasting_yaw_rad is None else config.lasting_yaw_rad * abs(float(pose.camera_threshold_m[1]))


def width_prior(announced_m: float, pose: NoseCameraPose, state: LineState) -> WidthPrior:
    """Return what is known of a runway announced so wide, m, with the height's part in a width that a picture shows."""
    height_m2 = float(state.covariance[UP, UP]) if state.mean.size > UP else 0.0
    above_m = max(float(pose.camera_threshold_m[2]), 1.0)
    return WidthPrior(announced_m=announced_m, scale_sigma=math.sqrt(height_m2) / above_m)


def other_pair_noise(config: TrackerConfig, look: FrameGeometry, state: LineState) -> FloatArray:
    """Return the second moment (4, 4) px² of the runway's edges about a pair's that is not as wide as announced."""
    if not config.guess.width_announced:
        return np.zeros((4, 4))
    width_m = max(abs(float(state.mean[C] - state.mean[D])), 1e-3)
    px_per_m = np.abs(look.predicted[2:] - look.predicted[:2]) / width_m
    outwards = np.zeros((4, 2))
    outwards[:2, 0], outwards[2:, 1] = -px_per_m, px_per_m
    return np.asarray(
        outwards @ other_pair_m2(width_m, width_prior(config.guess.width_m, look.pose, state)) @ outwards.T
    )


def edge_noise(
    config: TrackerConfig,
    crossings: FloatArray,
    rows: FloatArray,
    mean: FloatArray,
    found: EdgeMeasurement | None = None,
) -> FloatArray:
    """Return the covariance (4, 4) px² of the definition of an edge, the same at both ends of a line.

    Near markings displace faint edges farther, along a row more with the inclination of the line. A profile's own
    second moment of the alternatives replaces most of it. ``found`` is None where the edges were not measured.
    """
    per_m, noise = max(abs(float(mean[C] - mean[D])), 1.0), np.zeros((4, 4))
    unsettled = None if found is None else found.unsettled_px2
    sigma_m = config.edge_sigma_m if unsettled is None else config.profile_sigma_m
    sigma_px = config.edge_sigma_px if unsettled is None else config.profile_sigma_px
    own = np.abs(crossings[2:] - crossings[:2]) * (sigma_m / per_m)
    for line in range(2):
        contrast = config.plain_contrast if found is None else float(found.contrast[line])
        faint = max(config.plain_contrast / max(contrast, 1e-9), 1.0)
        faint = min(faint, _MOST_FAINT) if unsettled is None else min(faint * faint, _MOST_FAINT_PROFILE)
        faint *= math.hypot(1.0, float(crossings[2 * line + 1] - crossings[2 * line]) / float(rows[1] - rows[0]))
        block = noise[2 * line : 2 * line + 2, 2 * line : 2 * line + 2]
        np.multiply(own[:, None], own, out=block)
        block[0, 0] += (faint * sigma_px) ** 2
        block[1, 1] += (faint * sigma_px) ** 2
    return noise if unsettled is None else noise + unsettled
