"""Cramér-Rao bounds with an uncertain calibration (docs/derivation.md, section 11).

A nuisance is anything constant that moves pixels and is not the target: a calibration parameter, a clock's offset.
It can be *considered*: the estimator ignores it and its effect is added, which is what a filter with a fixed
calibration reaches. Or it can be *learned*: the estimator has it as a constant of its own, with its prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.parameters import CLOCKS, DGPS_CLOCK
from groundstation.evaluation.bounds import StationView, fix_covariance, motion_matrices, posterior_bound
from groundstation.geometry.calibration import parameter_indices, project_with_calibration
from groundstation.rig.covariance import READOUT


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsiderBound:
    """Noise and the effect of considered nuisances, kept separate so that each contribution can be computed.

    Attributes
    ----------
    noise : (…, k, k) the bound with every nuisance known: position in m² (k = 3), or position and velocity (k = 6).
    sensitivity : (…, k, m) ∂estimate/∂nuisance, by the value that the estimator takes it to have.
    """

    noise: FloatArray
    sensitivity: FloatArray

    def covariance(self, nuisance_covariance: FloatArray) -> FloatArray:
        """Return noise + S·P·Sᵀ, (…, k, k), for a covariance (m, m) of the nuisances."""
        return self.noise + self.floor(nuisance_covariance)

    def floor(self, nuisance_covariance: FloatArray) -> FloatArray:
        """Return S·P·Sᵀ, (…, k, k): what no averaging takes away."""
        return self.sensitivity @ nuisance_covariance @ np.swapaxes(self.sensitivity, -1, -2)


def calibration_sensitivities(
    point_runway_m: FloatArray, views: Sequence[StationView], names: Sequence[str]
) -> list[FloatArray]:
    """Return ∂pixel/∂nuisance (2, m) of each view for parameters named ``station.parameter``.

    Zero where a parameter is another station's, or the point (3,) is not in front of the camera. Raises
    `CalibrationError` for an unknown parameter.
    """
    places = _places(tuple(names))
    found = []
    for view in views:
        sensitivity = np.zeros((2, len(names)))
        projected = project_with_calibration(view.geometry, point_runway_m, view.pan_rad, view.tilt_rad)
        if projected is not None and view.geometry.name in places:
            own, columns = places[view.geometry.name]
            sensitivity[:, own] = projected.calibration_jacobian[:, columns]
        found.append(sensitivity)
    return found


@lru_cache(maxsize=64)
def _places(names: tuple[str, ...]) -> dict[str, tuple[list[int], list[int]]]:
    """Return for each station its parameters' places among the names, and their columns of a calibration Jacobian.

    Kept, as the names are the same at thousands of points of one approach.
    """
    split = [name.partition(".") for name in names]
    columns = parameter_indices([parameter for _, _, parameter in split])
    places: dict[str, tuple[list[int], list[int]]] = {}
    for k, ((station, _, _), column) in enumerate(zip(split, columns, strict=True)):
        own, theirs = places.setdefault(station, ([], []))
        own.append(k)
        theirs.append(column)
    return places


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionProfile:
    """What moves while the stations look: through it a clock's error moves a pixel.

    Attributes
    ----------
    velocity_runway_m_s : (3,) of the target.
    rates_rad_s : one (2,) for each view, the rates of pan and tilt.
    age_s : how long clocks have been drifting.
    """

    velocity_runway_m_s: FloatArray
    rates_rad_s: Sequence[FloatArray]
    age_s: float = 0.0


def nuisance_sensitivities(
    point_runway_m: FloatArray, views: Sequence[StationView], movement: MotionProfile, names: Sequence[str]
) -> list[FloatArray]:
    """Return ∂pixel/∂nuisance (2, m) of each view for calibration parameters and clocks.

    Clocks are named as in `groundstation.estimation.parameters`. A camera that is late by δ sees the target at
    p + δ·v from a head at its angle + δ·rate; a PTU's reading that is late by δ makes the angle wrong by −δ·rate. The
    reference's clock moves no pixel.
    """
    clocks = [any(part.endswith("_clock") or part == READOUT for part in name.split(".")) for name in names]
    plain = [k for k, is_clock in enumerate(clocks) if not is_clock]
    found = []
    for view, rates in zip(views, movement.rates_rad_s, strict=True):
        sensitivity = np.zeros((2, len(names)))
        sensitivity[:, plain] = calibration_sensitivities(point_runway_m, [view], [names[k] for k in plain])[0]
        projected = view.geometry.project(point_runway_m, view.pan_rad, view.tilt_rad)
        if projected is not None:
            turning = projected.jacobian[:, 3:] @ rates
            late = dict(
                zip(CLOCKS, (projected.jacobian[:, :3] @ movement.velocity_runway_m_s + turning, -turning), strict=True)
            )
            for k, name in enumerate(names):
                station, _, parameter = name.partition(".")
                clock, _, part = parameter.partition(".")
                if station == view.geometry.name and clock in late:
                    sensitivity[:, k] = late[clock] * (movement.age_s if part == "drift" else 1.0)
                if name == f"{view.geometry.name}.{READOUT}":
                    share = (projected.pixel[1] + 0.5) / view.geometry.image_size_px[1] - 0.5
                    sensitivity[:, k] = late[CLOCKS[0]] * share
        found.append(sensitivity)
    return found


def reference_information(covariance_m2: FloatArray, movement: MotionProfile, names: Sequence[str]) -> FloatArray:
    """Return the information (3 + m, 3 + m) of a reference position (3,) with covariance (3, 3), in its own clock."""
    H = np.zeros((3, 3 + len(names)))
    H[:, :3] = np.eye(3)
    for k, name in enumerate(names):
        clock, _, part = name.partition(".")
        if clock == DGPS_CLOCK:
            H[:, 3 + k] = movement.velocity_runway_m_s * (movement.age_s if part == "drift" else 1.0)
    return np.asarray(H.T @ np.linalg.solve(covariance_m2, H))


def joint_information(
    point_runway_m: FloatArray, views: Sequence[StationView], sensitivities: Sequence[FloatArray]
) -> FloatArray:
    """Return the information (3 + m, 3 + m) that the views hold on a point (3,) and the nuisances together.

    ``sensitivities`` are ∂pixel/∂nuisance (2, m), one for each view. The first three rows and columns are
    `bounds.fix_information`; zero without any view.
    """
    m = sensitivities[0].shape[1] if sensitivities else 0
    information = np.zeros((3 + m, 3 + m))
    for view, sensitivity in zip(views, sensitivities, strict=True):
        projected = view.geometry.project(point_runway_m, view.pan_rad, view.tilt_rad)
        if projected is None:
            continue
        by_angle = projected.jacobian[:, 3:]
        noise = view.pixel_covariance_px2 + view.angle_sigma_rad**2 * by_angle @ by_angle.T
        J = np.hstack([projected.jacobian[:, :3], sensitivity])
        information += J.T @ np.linalg.solve(noise, J)
    return information


def fix_consider(joint: FloatArray) -> ConsiderBound | None:
    """Return the single-fix bound from a joint information, or None where the views do not determine a point.

    Weighted least squares that take a nuisance for δ too large are off by −Λ⁻¹·(Σ J_pᵀ W J_n)·δ.
    """
    noise = fix_covariance(joint[:3, :3])
    if noise is None:
        return None
    return ConsiderBound(noise=noise, sensitivity=-noise @ joint[:3, 3:])


def track_consider(
    t_s: FloatArray,
    joint: FloatArray,
    acceleration_psd_m2_s3: FloatArray,
    prior_position_sigma_m: float,
    prior_velocity_sigma_m_s: float,
) -> ConsiderBound:
    """Return the bound (n, 6, …) of a track whose filter takes the nuisances as known.

    Parameters
    ----------
    t_s : (n,) rising.
    joint : (n, 3 + m, 3 + m) joint information of each epoch, zero where nothing was seen.
    acceleration_psd_m2_s3, prior_… : as for `bounds.posterior_bound`.

    Notes
    -----
    With P⁺ the bound after an update, S⁺ = (I − P⁺HᵀΛH)·F·S − P⁺Hᵀ·Λ_pn: errors pass through the filter's own
    gain.
    """
    P = posterior_bound(t_s, joint[:, :3, :3], acceleration_psd_m2_s3, prior_position_sigma_m, prior_velocity_sigma_m_s)
    sensitivity = np.zeros((len(t_s), 6, joint.shape[2] - 3))
    S = sensitivity[0] if len(t_s) else np.zeros((6, 0))
    for k in range(len(t_s)):
        if k:
            S = motion_matrices(float(t_s[k] - t_s[k - 1]), acceleration_psd_m2_s3)[0] @ S
        S = S - P[k][:, :3] @ (joint[k, :3, :3] @ S[:3] + joint[k, :3, 3:])
        sensitivity[k] = S
    return ConsiderBound(noise=P, sensitivity=sensitivity)


def track_learning(
    t_s: FloatArray,
    joint: FloatArray,
    nuisance_covariance: FloatArray,
    acceleration_psd_m2_s3: FloatArray,
    prior_position_sigma_m: float,
    prior_velocity_sigma_m_s: float,
) -> FloatArray:
    """Return the posterior bound (n, 6 + m, 6 + m) of position, velocity and constant nuisances.

    Parameters are those of `track_consider`; ``nuisance_covariance`` (m, m) is what is known of them before.
    """
    m = joint.shape[2] - 3
    seen = [0, 1, 2, *range(6, 6 + m)]
    P = np.zeros((6 + m, 6 + m))
    P[:6, :6] = np.diag([prior_position_sigma_m**2] * 3 + [prior_velocity_sigma_m_s**2] * 3)
    P[6:, 6:] = nuisance_covariance
    bound = np.zeros((len(t_s), 6 + m, 6 + m))
    F, Q = np.eye(6 + m), np.zeros((6 + m, 6 + m))
    for k in range(len(t_s)):
        if k:
            F[:6, :6], Q[:6, :6] = motion_matrices(float(t_s[k] - t_s[k - 1]), acceleration_psd_m2_s3)
            P = F @ P @ F.T + Q
        # as in `bounds.posterior_bound`: P⁺ = P (I + Λ P)⁻¹ needs no inverse of a singular matrix
        gain = np.eye(6 + m)
        gain[seen] += joint[k] @ P[seen]
        P = np.linalg.solve(gain.T, P.T).T
        P = 0.5 * (P + P.T)
        bound[k] = P
    return bound
