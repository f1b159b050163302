"""Compiled strapdown step of the inertial filter: state and covariance over one sample."""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.onboard.pose.camera_kernel import matrix_of

STATE_SIZE = 15
GRAVITY_M_S2 = 9.80665


class SquaredNoises(NamedTuple):
    """Squared noise densities of an inertial unit: white noise of force and rate, random walk of both biases."""

    force: float
    rate: float
    force_bias: float
    rate_bias: float


@njit(cache=True)
def turned(q: FloatArray, x: float, y: float, z: float, local: bool) -> FloatArray:
    """Return q ⊗ exp(θ/2) where ``local``, otherwise exp(θ/2) ⊗ q, for a rotation vector θ in rad; normalised."""
    angle = np.sqrt(x * x + y * y + z * z)
    share = 0.5 if angle < 1e-9 else np.sin(0.5 * angle) / angle
    w, a, b, c = np.cos(0.5 * angle), share * x, share * y, share * z
    sign = 1.0 if local else -1.0
    out = np.empty(4)
    out[0] = q[0] * w - q[1] * a - q[2] * b - q[3] * c
    out[1] = q[0] * a + q[1] * w + sign * (q[2] * c - q[3] * b)
    out[2] = q[0] * b + q[2] * w + sign * (q[3] * a - q[1] * c)
    out[3] = q[0] * c + q[3] * w + sign * (q[1] * b - q[2] * a)
    return out / np.sqrt((out * out).sum())


@njit(cache=True)
def strapdown(
    position: FloatArray,
    velocity: FloatArray,
    q: FloatArray,
    force: FloatArray,
    rate: FloatArray,
    dt: float,
) -> FloatArray:
    """Move position and velocity in place over ``dt`` under a specific force (3,) and rate (3,); returns the force.

    v̇ = R f + g, ṗ = v, q̇ = ½ q ⊗ ω, with R halfway through the step; the returned force (3,) is R f, runway frame.
    """
    half = turned(q, 0.5 * dt * rate[0], 0.5 * dt * rate[1], 0.5 * dt * rate[2], True)
    pushed = matrix_of(half) @ force
    for k in range(3):
        a = pushed[k] - (GRAVITY_M_S2 if k == 2 else 0.0)
        position[k] += dt * velocity[k] + 0.5 * dt * dt * a
        velocity[k] += dt * a
    after = turned(q, dt * rate[0], dt * rate[1], dt * rate[2], True)
    for k in range(4):
        q[k] = after[k]
    return pushed


@njit(cache=True)
def transition(q_half: FloatArray, pushed: FloatArray, dt: float) -> FloatArray:
    """Return the error state's transition (15, 15) over one step.

    δṗ = δv, δv̇ = −[R f]× δθ − R δb_a, δθ̇ = −R δb_g, with R_true = exp([δθ]×) R.
    """
    F = np.eye(STATE_SIZE)
    R = matrix_of(q_half)
    skew = np.array([[0.0, -pushed[2], pushed[1]], [pushed[2], 0.0, -pushed[0]], [-pushed[1], pushed[0], 0.0]])
    for i in range(3):
        F[i, 3 + i] = dt
        for k in range(3):
            F[3 + i, 6 + k] = -dt * skew[i, k]
            F[i, 6 + k] = -0.5 * dt * dt * skew[i, k]
            F[3 + i, 9 + k] = -dt * R[i, k]
            F[i, 9 + k] = -0.5 * dt * dt * R[i, k]
            F[6 + i, 12 + k] = -dt * R[i, k]
    return F


@njit(cache=True)
def predict(
    position: FloatArray,
    velocity: FloatArray,
    q: FloatArray,
    P: FloatArray,
    force: FloatArray,
    rate: FloatArray,
    dt: float,
    noises: SquaredNoises,
) -> None:
    """Move state and covariance (15, 15) in place by one sample, held for ``dt`` s."""
    half = turned(q, 0.5 * dt * rate[0], 0.5 * dt * rate[1], 0.5 * dt * rate[2], True)
    pushed = strapdown(position, velocity, q, force, rate, dt)
    F = transition(half, pushed, dt)
    moved = F @ P @ F.T
    for i in range(STATE_SIZE):
        for k in range(STATE_SIZE):
            P[i, k] = moved[i, k]
    for k in range(3):
        P[k, k] += noises.force * dt**3 / 3.0
        P[k, 3 + k] += noises.force * dt**2 / 2.0
        P[3 + k, k] += noises.force * dt**2 / 2.0
        P[3 + k, 3 + k] += noises.force * dt
        P[6 + k, 6 + k] += noises.rate * dt
        P[9 + k, 9 + k] += noises.force_bias * dt
        P[12 + k, 12 + k] += noises.rate_bias * dt
