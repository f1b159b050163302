"""The part of a target point's covariance that is new in each frame.

Most of the covariance is constant over a flight: the aircraft's attitude and shape. New in each frame is the effect of
the picture's noise on the outline: it moves the point itself, and the rows of the outline from
which crab and pitch are estimated. Measured in 16 drawn flights (docs/notes/detection.md, "In a replay").
"""

from groundstation.arrays import FloatArray

# px over contrast, for u and v of the picture: many rows of the outline determine u, few ends v
_U_PX_SIGMAS, _V_PX_SIGMAS = 2.2, 4.5
_READ_SHARE = 0.08  # of the attitude's part, where the outline determines the attitude


def uncorrelated_covariance(steady: float, attitude: FloatArray, contrast: float, legible: float) -> FloatArray:
    """Return the noise (2, 2), px² of u and v, in a covariance of ``steady`` · 1 + ``attitude`` + more.

    The picture's own part is in the picture's columns and rows: it is not rotated with the aircraft's bank.

    Parameters
    ----------
    steady : px², variance of each axis for picture and pixels; the noise cannot exceed it.
    attitude : (2, 2) px², covariance due to the attitude.
    contrast : of the silhouette, in sigmas.
    legible : 0 to 1, observability of the attitude in the outline.
    """
    noise = _READ_SHARE * legible * attitude
    for axis, sigmas in enumerate((_U_PX_SIGMAS, _V_PX_SIGMAS)):
        noise[axis, axis] += min((sigmas / max(contrast, 1.0)) ** 2, steady)
    return noise
