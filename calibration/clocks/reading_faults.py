"""Readings with a wrong sign, axis or unit: by which of them a camera's turns agree with its head's readings."""

import numpy as np

from calibration.clocks.image_motion import ImageMotion
from groundstation.arrays import FloatArray

_SEARCH_S, _STEP_S = 0.3, 0.05
# chosen: clocks of one recording are hardly further apart, and a swing's half period is shorter
_APART_S = 3.0
_LEAST_PAIRS = 20
# chosen: of the pictures' turns a hypothesis leaves so much at most, and so much less than the readings as they stand
_MOST_LEFT = 0.3
_BETTER = 3.0
_APART = "clocks more than 0.3 s apart"
# any signs and order of two axes are a rotation of the camera, with the sign of the third that makes it one
_MOUNT = " (or another mount of the camera than head_from_camera_wxyz)"
_SIGNS = {(1, 1): "", (-1, 1): "pan reversed", (1, -1): "tilt reversed", (-1, -1): "pan and tilt reversed"}
# by what a reading in that unit has to be multiplied
_UNITS = {
    "": 1.0,
    "readings in radians": float(np.degrees(1.0)),
    "readings in thousandths of a radian": float(np.degrees(1e-3)),
    "readings in minutes of arc": 1.0 / 60.0,
    "readings in thousandths of a degree": 1e-3,
}


def reading_fault(readings: FloatArray, motion: ImageMotion) -> str:
    """Return what is wrong with readings (m, 3) of time, pan and tilt, which the pictures contradict; "" for nothing.

    Between clocks that differ by 0.3 s at most. A fault is named only if the readings without it agree with the
    pictures, and as they stand do not. What gives the same data is named with it: another mount of the camera, and
    clocks further apart, as half a period of a swing looks like a sign.
    """
    t, first = np.unique(readings[:, 0], return_index=True)
    angles = readings[first, 1:]
    inside = (motion.from_s - _SEARCH_S >= t[0]) & (motion.to_s + _SEARCH_S <= t[-1])
    size = float(np.abs(motion.turn_rad[inside]).mean()) if inside.sum() >= _LEAST_PAIRS else 0.0
    if not size > 0.0:
        return ""
    stated = _left(t, _unwrapped(angles, 1.0), motion, np.eye(2)) / size
    best, words = stated, ""
    for unit, factor in _UNITS.items():
        own = _unwrapped(angles, factor)
        for exchanged in (False, True):
            for signs, sign_words in _SIGNS.items():
                mix = factor * np.diag(signs).astype(np.float64)[:, :: -1 if exchanged else 1]
                left = _left(t, own, motion, mix) / size
                # of two that fit alike, the one with fewer faults, which comes first
                if left < 0.9 * best:
                    parts = ["pan and tilt exchanged" if exchanged else "", sign_words, unit]
                    mount = _MOUNT if exchanged or sign_words else ""
                    best, words = left, " and ".join(part for part in parts if part) + mount
    if best > _MOST_LEFT or _BETTER * best > stated:
        return ""
    apart = _left_apart(t, _unwrapped(angles, 1.0), motion)
    if apart > _MOST_LEFT or _BETTER * apart > stated:
        return words
    return _APART if _BETTER * apart <= best else f"{words}, or {_APART}"


def _unwrapped(angles: FloatArray, factor: float) -> FloatArray:
    """Return angles (m, 2) without jumps of a turn, in a unit of which ``factor`` is one of theirs."""
    return np.asarray(np.unwrap(angles, axis=0, period=2.0 * np.pi / factor))


def _offsets(most_s: float) -> FloatArray:
    return np.arange(-most_s, most_s + 1e-9, _STEP_S)


def _left_apart(t: FloatArray, angles: FloatArray, motion: ImageMotion) -> float:
    """Return which share of the turns is left by the readings as they stand, the clocks more than 0.3 s apart."""
    shares = [np.inf]
    for offset in _offsets(_APART_S):
        inside = (motion.from_s - offset >= t[0]) & (motion.to_s - offset <= t[-1])
        size = float(np.abs(motion.turn_rad[inside]).mean()) if inside.sum() >= _LEAST_PAIRS else 0.0
        if abs(offset) <= _SEARCH_S + 1e-9 or 2 * inside.sum() < len(inside) or not size > 0.0:
            continue
        move = _moves(t, angles, motion.from_s[inside], motion.to_s[inside], offset)
        shares.append(_trimmed(motion.turn_rad[inside] - move) / size)
    return min(shares)


def _moves(t: FloatArray, angles: FloatArray, from_s: FloatArray, to_s: FloatArray, offset: float) -> FloatArray:
    """Return by what the readings (n, 2) change from frame to frame, with a clock that is off by ``offset``."""
    return np.stack(
        [np.interp(to_s - offset, t, angle) - np.interp(from_s - offset, t, angle) for angle in angles.T], axis=1
    )


def _left(t: FloatArray, angles: FloatArray, motion: ImageMotion, mix: FloatArray) -> float:
    """Return the mean of what is left of the turns, at the best of the offsets within 0.3 s."""
    inside = (motion.from_s - _SEARCH_S >= t[0]) & (motion.to_s + _SEARCH_S <= t[-1])
    turns, from_s, to_s = motion.turn_rad[inside], motion.from_s[inside], motion.to_s[inside]
    return min(_trimmed(turns - _moves(t, angles, from_s, to_s, offset) @ mix.T) for offset in _offsets(_SEARCH_S))


def _trimmed(left: FloatArray) -> float:
    """Return the mean size of what is left of turns (n, 2), without the worst tenth."""
    kept = max(1, int(0.9 * left.size))
    return float(np.sort(np.abs(left), axis=None)[:kept].mean())
