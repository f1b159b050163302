"""The part of a target point's covariance that is new in each frame.

Most of what is stated lasts as long as a flight: where the aircraft points and how it is built. New in each frame is
what the noise of the picture does to the outline: it moves the point itself, and it moves the rows of the outline from
which crab and pitch are read. Seen in 16 drawn flights (docs/notes/detection.md, "In a replay").
"""

from groundstation.arrays import FloatArray

# px over contrast, for u and v of the picture: many rows of the outline say where across it, few ends where down it
_U_PX_SIGMAS, _V_PX_SIGMAS = 2.2, 4.5
_READ_SHARE = 0.08  # of the attitude's part, where the outline tells the attitude


def uncorrelated_covariance(steady: float, attitude: FloatArray, contrast: float, legible: float) -> FloatArray:
    """Return the noise (2, 2), px² of u and v, in a covariance of ``steady`` · 1 + ``attitude`` + more.

    The picture's own part is of the picture's columns and rows: it is not turned with the aircraft's bank.

    Parameters
    ----------
    steady : px², what is stated of each axis for picture and pixels; no more of it can be noise.
    attitude : (2, 2) px², what is stated for where the aircraft points.
    contrast : of the silhouette, in sigmas.
    legible : 0 to 1, how far the outline tells the attitude.
    """
    noise = _READ_SHARE * legible * attitude
    for axis, sigmas in enumerate((_U_PX_SIGMAS, _V_PX_SIGMAS)):
        noise[axis, axis] += min((sigmas / max(contrast, 1.0)) ** 2, steady)
    return noise
