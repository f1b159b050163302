"""What a frame looks like to lines that are followed: rows, crossings of the prediction, bands, noise."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.config import Measurement, TrackerConfig
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.lines import (
    PITCH,
    ROLL,
    UP,
    C,
    D,
    bias_jacobian,
    line_map,
    pose_jacobian,
    project_lines,
    shifted,
)
from groundstation.onboard.edges.pose import CameraPose, corrected_pose
from groundstation.onboard.edges.search_band import NoBand, across_direction, band_rows, band_widths

_MOST_FAINT = 4.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lookout:
    """Camera without distortion and tuning: intrinsic matrix (3, 3), image size (w, h) in px."""

    kappa: FloatArray
    image_size_px: tuple[int, int]
    config: TrackerConfig


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Look:
    """A frame's geometry: pose, line map E, rows, crossings of the prediction, how they move, bands."""

    pose: CameraPose
    e: FloatArray
    rows: FloatArray
    predicted: FloatArray
    h: FloatArray
    by_pose: FloatArray
    widths: FloatArray
    across: FloatArray


def look_at(lookout: Lookout, pose: CameraPose, state: LineState) -> Look | None:
    """Return the geometry of a frame for predicted lines, None where no rows hold runway."""
    mean = state.mean[:4]
    if state.mean.size > 4:
        pose = corrected_pose(pose, *(float(v) for v in state.mean[[ROLL, PITCH, UP]]))
    rows = band_rows(
        pose,
        lookout.kappa,
        lookout.image_size_px,
        lookout.config.guess,
        middle_m=-0.5 * float(mean[C] + mean[D]),
        width_m=abs(float(mean[C] - mean[D])),
    )
    return None if isinstance(rows, NoBand) else look_between(lookout, pose, state, rows)


def look_between(lookout: Lookout, pose: CameraPose, state: LineState, rows: FloatArray) -> Look:
    """Return the geometry between rows (2,) that are given, the pose taken as it is."""
    mean = state.mean[:4]
    e = line_map(pose, lookout.kappa)
    predicted, h = project_lines(mean, e, rows)
    by_pose = pose_jacobian(predicted, rows, pose, lookout.kappa)
    if state.mean.size > 4:
        h = np.hstack([h, bias_jacobian(by_pose, pose)])
    return Look(
        pose=pose,
        e=e,
        rows=rows,
        predicted=predicted,
        h=h,
        by_pose=by_pose,
        widths=widths_of(lookout.config, mean, e, rows, predicted, lookout.config.band_m),
        across=across_direction(e),
    )


def widths_of(
    config: TrackerConfig, mean: FloatArray, e: FloatArray, rows: FloatArray, crossings: FloatArray, band_m: float
) -> FloatArray:
    """Return the widths ℓ (2, 2) of bands of ``band_m`` about lines (4,), px."""
    band = min(band_m, 0.45 * abs(float(mean[C] - mean[D])))
    outer, _ = project_lines(shifted(mean, band), e, rows)
    across = across_direction(e) if config.bands_across else None
    widths = band_widths(crossings, outer, rows, config.least_band_px, across)
    return np.minimum(widths, config.most_band_px)


def pose_noise(config: TrackerConfig, look: Look) -> FloatArray:
    """Return what the pose's uncertainty is at the crossings, (4, 4) px²."""
    if config.measurement is Measurement.LINES:
        return np.zeros((4, 4))
    sigmas = np.array([config.attitude_sigma_rad] * 3 + list(config.position_sigma_m))
    return np.asarray((look.by_pose * sigmas**2) @ look.by_pose.T)


def edge_noise(
    config: TrackerConfig, crossings: FloatArray, mean: FloatArray, contrast: FloatArray | None = None
) -> FloatArray:
    """Return what the definition of an edge leaves open, (4, 4) px²: alike at both ends of a line.

    ``contrast`` (2,) across each edge: where it is faint, other marks draw it farther. None where it was not seen.
    """
    faint = np.ones(2) if contrast is None else np.clip(config.plain_contrast / contrast, 1.0, _MOST_FAINT)
    px_per_m = np.abs(crossings[2:] - crossings[:2]) / max(abs(float(mean[C] - mean[D])), 1.0)
    own = np.outer(px_per_m, px_per_m) * config.edge_sigma_m**2
    blur = config.edge_sigma_px**2 * np.eye(2)
    none = np.zeros((2, 2))
    return np.block([[own + faint[0] ** 2 * blur, none], [none, own + faint[1] ** 2 * blur]])
