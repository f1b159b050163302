"""Cramér-Rao bounds of a single fix and of a track.

One fix, from the stations' own Jacobians: information = Σ J_pᵀ (R_px + J_a R_a J_aᵀ)⁻¹ J_p, with J_p and J_a the
derivatives of the pixel by position and by pan and tilt (docs/derivation.md, section 8). A track: the posterior
bound by Tichavský's recursion, which for a linear motion model is the Riccati equation with the single-fix
information taken at the true position; constant velocity, white acceleration per axis.

The angle noise is that of one reading. A filter that interpolates between readings averages two of them and
can come out slightly below these bounds where the encoder dominates.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.position_series import BoolArray
from groundstation.geometry.station import StationGeometry


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationView:
    """One station's look: its geometry and angles, pixel covariance (2, 2) px² and sigma of one angle, rad."""

    geometry: StationGeometry
    pan_rad: float
    tilt_rad: float
    pixel_covariance_px2: FloatArray
    angle_sigma_rad: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoundSeries:
    """Bounds of each epoch as sigmas (n, 3) in m: of one fix (where ``fix_known`` (n,)), and of the track so far."""

    fix_sigma_m: FloatArray
    fix_known: BoolArray
    track_sigma_m: FloatArray
    track_known: BoolArray


def fix_information(point_runway_m: FloatArray, views: Sequence[StationView]) -> FloatArray:
    """Return the information (3, 3) in 1/m² that the views hold on a point (3,); zero without any view."""
    information = np.zeros((3, 3))
    for view in views:
        projected = view.geometry.project(point_runway_m, view.pan_rad, view.tilt_rad)
        if projected is None:
            continue
        by_point, by_angle = projected.jacobian[:, :3], projected.jacobian[:, 3:]
        noise = view.pixel_covariance_px2 + view.angle_sigma_rad**2 * by_angle @ by_angle.T
        information += by_point.T @ np.linalg.solve(noise, by_point)
    return information


def fix_covariance(information: FloatArray) -> FloatArray | None:
    """Return the single-fix bound (3, 3) in m², or None where the views do not determine a point."""
    values = np.linalg.eigvalsh(information)
    if values[0] <= 1e-12 * max(values[-1], 1e-300):
        return None
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def motion_matrices(dt_s: float, acceleration_psd_m2_s3: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return F and Q, (6, 6) each, of constant velocity with white acceleration of PSD (3,), over ``dt_s``."""
    F, Q = np.eye(6), np.zeros((6, 6))
    for k, psd in enumerate(acceleration_psd_m2_s3):
        F[k, 3 + k] = dt_s
        Q[k, k], Q[3 + k, 3 + k] = psd * dt_s**3 / 3, psd * dt_s
        Q[k, 3 + k] = Q[3 + k, k] = psd * dt_s**2 / 2
    return F, Q


def posterior_bound(
    t_s: FloatArray,
    information: FloatArray,
    acceleration_psd_m2_s3: FloatArray,
    prior_position_sigma_m: float,
    prior_velocity_sigma_m_s: float,
) -> FloatArray:
    """Return the posterior bound (n, 6, 6) of position and velocity after each epoch's update.

    Parameters
    ----------
    t_s : (n,) rising.
    information : (n, 3, 3) single-fix information of each epoch, zero where nothing was seen.
    acceleration_psd_m2_s3 : (3,) of the motion model.
    """
    given = (t_s, information, acceleration_psd_m2_s3, prior_position_sigma_m, prior_velocity_sigma_m_s)
    return np.array(list(posterior_bounds(*given))).reshape(-1, 6, 6)


def posterior_bounds(
    t_s: FloatArray,
    information: FloatArray,
    acceleration_psd_m2_s3: FloatArray,
    prior_position_sigma_m: float,
    prior_velocity_sigma_m_s: float,
) -> Iterator[FloatArray]:
    """Yield what `posterior_bound` returns, one (6, 6) after the other."""
    P = np.diag([prior_position_sigma_m**2] * 3 + [prior_velocity_sigma_m_s**2] * 3)
    for k in range(len(t_s)):
        if k:
            F, Q = motion_matrices(float(t_s[k] - t_s[k - 1]), acceleration_psd_m2_s3)
            P = F @ P @ F.T + Q
        # P⁺ = P (I + HᵀΛH P)⁻¹: no inverse of Λ, which is singular with one view
        gain = np.eye(6)
        gain[:3] += information[k] @ P[:3]
        P = np.linalg.solve(gain.T, P.T).T
        P = 0.5 * (P + P.T)
        yield P
