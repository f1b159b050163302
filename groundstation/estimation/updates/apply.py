"""Applies the correction of a measurement update to the filter's modes."""

from collections.abc import Callable

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.imm import ImmFilter, ImmState
from groundstation.estimation.kalman_kernels import BoolArray, LinearMeasurement
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.updates.update import (
    CorrectedModes,
    Correction,
    LinearCorrection,
    MomentMatching,
    TargetReset,
    VarianceInflation,
)
from groundstation.geometry.rotation import cross


def apply_correction(
    imm: ImmFilter, correction: Correction | None, layout: StateLayout, estimated: Callable[[], BoolArray]
) -> FloatArray | None:
    """Apply a correction; ``estimated`` returns which states (n,) may change where the correction does not say.

    Return the matrix (n, n) of the transition for the smoother where the correction is one: an inflation or a reset.
    None where it contains the information of a measurement.
    """
    match correction:
        case CorrectedModes():
            imm.state = correction.imm
        case LinearCorrection():
            mask = estimated() if correction.estimated is None else correction.estimated
            share, updates_weights = correction.gain_share, correction.updates_weights
            if correction.ray is None:
                imm.correct(correction.measurement, mask, updates_weights=updates_weights, share=share)
                return None
            T = _along_and_across(layout, correction.ray)
            residual, H, R = correction.measurement
            mask = mask.copy()
            mask[[layout.position.start, layout.velocity.start]] = False
            imm.state = _rotated(imm.state, T)
            turned = LinearMeasurement(residual, np.ascontiguousarray(H @ T.T), R)
            imm.correct(turned, mask, updates_weights=updates_weights, share=share)
            imm.state = _rotated(imm.state, T.T)
        case MomentMatching():
            imm.replace_moments(correction.jacobian, correction.shift, correction.covariance, estimated())
        case VarianceInflation():
            imm.inflate(correction.part, correction.variances)
            return np.eye(layout.size)
        case TargetReset():
            imm.set_states(layout.target, correction.target, correction.covariance)
            imm.correlate(correction.correlated, layout.constant, correction.sensitivity)
            F = reset_transition(layout, layout.target)
            # the new target depends on the carried errors, which later measurements therefore still estimate
            F[correction.correlated, layout.constant] = correction.sensitivity
            return F
        case None:
            pass
    return None


def reset_transition(layout: StateLayout, *parts: slice) -> FloatArray:
    """Return F (n, n) of a reset of some states: zero rows and columns, so that nothing is smoothed across it."""
    F = np.eye(layout.size)
    for part in parts:
        F[part, part] = 0.0
    return F


def _along_and_across(layout: StateLayout, ray: FloatArray) -> FloatArray:
    """Return the rotation (n, n) of the target's axes to one along a unit vector (3,) and two across it."""
    # the axis that is furthest from the ray makes the best-conditioned second one
    across = cross(ray, np.eye(3)[int(np.argmin(np.abs(ray)))])
    across /= np.linalg.norm(across)
    axes, T = np.array([ray, across, cross(ray, across)]), np.eye(layout.size)
    T[layout.position, layout.position] = T[layout.velocity, layout.velocity] = axes
    return T


def _rotated(state: ImmState, T: FloatArray) -> ImmState:
    """Return the modes in other axes: T x, T P Tᵀ."""
    return ImmState(
        np.ascontiguousarray(state.states @ T.T),
        np.ascontiguousarray(T @ state.covariances @ T.T),
        state.weights,
        T @ state.mean,
        T @ state.covariance @ T.T,
    )
