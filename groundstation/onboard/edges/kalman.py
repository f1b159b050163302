"""The Kalman filter on (a, b, c, d), a² + b² = 1, and the constant-velocity one in the picture as a baseline.

The runway is stationary: A = 1, B = 0 (Eqs. 21, 22). `update_lines` is the paper's: six numbers of two lines of the
picture, y = C_k x (Eq. 33). `update_crossings` measures the lines where they cross two rows, in px with their own
covariance, and includes the pose's uncertainty. Both use the norm-constrained gain (Zanetti et al. 2009).
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.kalman_kernel import constrain, update_kernel
from groundstation.onboard.edges.lines import normalised_lines

# rates of the constant-velocity model per s: of the lines' places (px) and slopes (px per px)
_CV_STATE = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineState:
    """Estimate of (a, b, c, d): mean (4,) and covariance (4, 4); a, b plain numbers, c, d in m.

    The tracker's own has (7,) and (7, 7): after these the pose's lasting errors of roll, pitch and height, rad and m.
    """

    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineUpdate:
    """Result of an update: the new state, innovation with covariance, and its normalised square."""

    state: LineState
    innovation: FloatArray
    innovation_covariance: FloatArray
    nis: float


def predict(state: LineState, process_covariance: FloatArray) -> LineState:
    """Return the state one frame later, Eq. 15: the same lines, less surely by Q (n, n)."""
    return LineState(mean=state.mean, covariance=state.covariance + process_covariance)


def constrained_gain(gain: FloatArray, innovation: FloatArray, s: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the gain (n, m) that leaves a² + b² = 1, of least trace: the rows of a and b are corrected.

    K* = K + (1/n − 1) x̂ νᵀ S⁻¹ / (νᵀ S⁻¹ ν) in those rows, with x̂ the unconstrained (a, b) and n its length.
    """
    corrected = gain.copy()
    constrain(corrected, innovation, np.asarray(np.linalg.solve(s, innovation), np.float64), mean)
    return corrected


def _updated(state: LineState, h: FloatArray, innovation: FloatArray, noise: FloatArray) -> LineUpdate:
    """Return the constrained update with a linear(ised) measurement matrix (m, 4) and noise (m, m), Joseph's form."""
    size = state.mean.size
    mean, covariance, s = np.empty(size), np.empty((size, size)), np.empty(noise.shape)
    p, h, noise = (np.ascontiguousarray(a) for a in (state.covariance, h, noise))
    nis = update_kernel(state.mean, p, h, innovation, noise, mean, covariance, s)
    return LineUpdate(
        state=LineState(mean=mean, covariance=covariance), innovation=innovation, innovation_covariance=s, nis=nis
    )


def update_lines(state: LineState, c_k: FloatArray, lines: FloatArray, noise: FloatArray) -> LineUpdate:
    """Return the paper's update with two lines of the picture (6,) in px, noise U (6, 6), Eqs. 16 and 18.

    C_k x has a separate scale for each line; the measured lines, of unit normals, are given the predicted one's.
    """
    predicted = c_k @ state.mean
    pair = predicted.reshape(2, 3)
    scale = np.hypot(pair[:, 0], pair[:, 1]) * np.where(pair[:, 0] < 0.0, -1.0, 1.0)
    weights = np.repeat(scale, 3)
    measured = normalised_lines(lines) * weights
    return _updated(state, c_k, measured - predicted, noise * np.outer(weights, weights))


def update_crossings(
    state: LineState, predicted_px: FloatArray, h: FloatArray, measured_px: FloatArray, noise_px2: FloatArray
) -> LineUpdate:
    """Return the update with crossings (4,), their derivative by the state ``h`` (4, n) and covariance (4, 4) px²."""
    return _updated(state, h, measured_px - predicted_px, noise_px2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PictureState:
    """The 2-D model: for each line its place in ``row_px`` and its slope, then their rates; (8,) and (8, 8)."""

    mean: FloatArray
    covariance: FloatArray
    row_px: float


def picture_state(
    crossings_px: FloatArray, rows_px: FloatArray, row_px: float, rate_sigmas: FloatArray
) -> PictureState:
    """Return a 2-D state at rest from crossings (4,); ``rate_sigmas`` (2,) of place (px/s) and slope (1/s)."""
    to_state = np.linalg.inv(_from_picture(rows_px, row_px))
    mean = np.concatenate([to_state @ crossings_px, np.zeros(4)])
    covariance = np.zeros((_CV_STATE, _CV_STATE))
    covariance[:4, :4] = to_state @ to_state.T
    covariance[4:, 4:] = np.diag(np.tile(rate_sigmas, 2) ** 2)
    return PictureState(mean=mean, covariance=covariance, row_px=row_px)


def predict_picture(state: PictureState, dt_s: float, acceleration_psd: FloatArray) -> PictureState:
    """Return the 2-D state after ``dt_s`` at constant rates; spectral densities (2,) of place and slope."""
    f = np.eye(_CV_STATE)
    f[:4, 4:] = dt_s * np.eye(4)
    q = np.diag(np.tile(acceleration_psd, 2))
    noise = np.block([[q * dt_s**3 / 3, q * dt_s**2 / 2], [q * dt_s**2 / 2, q * dt_s]])
    return PictureState(mean=f @ state.mean, covariance=f @ state.covariance @ f.T + noise, row_px=state.row_px)


def picture_crossings(state: PictureState, rows_px: FloatArray) -> FloatArray:
    """Return where the lines of a 2-D state cross two rows, (4,)."""
    return np.asarray(_from_picture(rows_px, state.row_px) @ state.mean[:4])


def update_picture(
    state: PictureState, crossings_px: FloatArray, rows_px: FloatArray, noise_px2: FloatArray
) -> PictureState:
    """Return the 2-D state after crossings (4,) with the rows (2,)."""
    h = np.hstack([_from_picture(rows_px, state.row_px), np.zeros((4, 4))])
    s = h @ state.covariance @ h.T + noise_px2
    gain = np.linalg.solve(s, h @ state.covariance).T
    kept = np.eye(_CV_STATE) - gain @ h
    return PictureState(
        mean=state.mean + gain @ (crossings_px - h @ state.mean),
        covariance=kept @ state.covariance @ kept.T + gain @ noise_px2 @ gain.T,
        row_px=state.row_px,
    )


def _from_picture(rows_px: FloatArray, row_px: float) -> FloatArray:
    """Return crossings (4,) from place and slope of both lines, (4, 4)."""
    one = np.array([[1.0, rows_px[0] - row_px], [1.0, rows_px[1] - row_px]])
    return np.block([[one, np.zeros((2, 2))], [np.zeros((2, 2)), one]])
