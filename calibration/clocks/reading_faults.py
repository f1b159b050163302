"""Readings with a wrong sign, axis or unit: by which of them a camera's turns agree with its head's readings."""

import numpy as np

from calibration.clocks.image_motion import ImageMotion
from groundstation.arrays import FloatArray

_SEARCH_S, _STEP_S = 0.3, 0.05
_LEAST_PAIRS = 20
# chosen: of the pictures' turns a hypothesis leaves so much at most, and so much less than the readings as they stand
_MOST_LEFT = 0.3
_BETTER = 3.0
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
    pictures, and as they stand do not.
    """
    t, first = np.unique(readings[:, 0], return_index=True)
    angles = readings[first, 1:]
    inside = (motion.from_s - _SEARCH_S >= t[0]) & (motion.to_s + _SEARCH_S <= t[-1])
    if inside.sum() < _LEAST_PAIRS:
        return ""
    turns = motion.turn_rad[inside]
    size = float(np.abs(turns).mean())
    moves = [_moves(t, angles, motion.from_s[inside], motion.to_s[inside], offset) for offset in _offsets()]
    stated = _left(turns, moves, np.eye(2)) / size
    best, words = stated, ""
    for unit, factor in _UNITS.items():
        for exchanged in (False, True):
            for signs, sign_words in _SIGNS.items():
                mix = factor * np.diag(signs).astype(np.float64)[:, :: -1 if exchanged else 1]
                left = _left(turns, moves, mix) / size
                # of two that fit alike, the one with fewer faults, which comes first
                if left < 0.9 * best:
                    parts = ("pan and tilt exchanged" if exchanged else "", sign_words, unit)
                    best, words = left, " and ".join(part for part in parts if part)
    return words if best <= _MOST_LEFT and _BETTER * best <= stated else ""


def _offsets() -> FloatArray:
    return np.arange(-_SEARCH_S, _SEARCH_S + 1e-9, _STEP_S)


def _moves(t: FloatArray, angles: FloatArray, from_s: FloatArray, to_s: FloatArray, offset: float) -> FloatArray:
    """Return by what the readings (n, 2) change from frame to frame, with a clock that is off by ``offset``."""
    return np.stack(
        [np.interp(to_s - offset, t, angle) - np.interp(from_s - offset, t, angle) for angle in angles.T], axis=1
    )


def _left(turns: FloatArray, moves: list[FloatArray], mix: FloatArray) -> float:
    """Return the mean of what is left of the turns (n, 2), without their worst tenth, at the best of the offsets."""
    kept = max(1, int(0.9 * turns.size))
    return min(float(np.sort(np.abs(turns - move @ mix.T), axis=None)[:kept].mean()) for move in moves)
