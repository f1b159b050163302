"""Whether two lines of a picture can be the edges of the runway that was announced."""

import math

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.frame_geometry import yaw_place_m
from groundstation.onboard.edges.line_kernel import ground_of, state_through
from groundstation.onboard.edges.pose import NoseCameraPose

_FARTHEST = 3.0
# position and width have long tails: a position may be off by a runway's width, pitch makes a far one appear narrow
_FARTHEST_PLACE = 9.0
_FARTHEST_WIDTH = 5.5


def pair_weight(
    crossings_px: FloatArray, rows_px: FloatArray, pose: NoseCameraPose, kappa: FloatArray, config: TrackerConfig
) -> float:
    """Return the weight of a pair: 0 unless parallel on the ground, along the runway, near it, and of its width.

    Each of these is measured in the configuration's ``start_…``, its place also in what a lasting error of yaw moves
    it by; beyond three of one, nine of the place, five of the width, it is no runway, and the nearer the weightier.
    """
    weight = _weight(
        crossings_px,
        rows_px,
        pose.threshold_from_camera,
        pose.camera_threshold_m,
        kappa,
        config.start_turn_rad,
        math.hypot(config.start_shift_m, yaw_place_m(config, pose)),
        config.guess.width_m,
        math.log(config.start_width),
    )
    return float(weight)


@njit(cache=True, nogil=True, error_model="numpy")
def _weight(
    crossings: FloatArray,
    rows: FloatArray,
    rotation: FloatArray,
    position: FloatArray,
    kappa: FloatArray,
    turn_rad: float,
    shift_m: float,
    width_m: float,
    log_width: float,
) -> float:
    """Return the weight of the lines through crossings (4,) with rows (2,).

    Turn and shift are measured in ``turn_rad`` and ``shift_m``, the logarithm of the width by ``width_m`` in
    ``log_width``.
    """
    pixels = np.empty((4, 2))
    for k in range(4):
        pixels[k, 0], pixels[k, 1] = crossings[k], rows[k % 2]
    ground = ground_of(pixels, rotation, position, kappa).reshape(2, 2, 2)
    both, alone = state_through(ground), np.empty((2, 2, 2))
    if not np.isfinite(both).all():
        return 0.0
    turns = np.empty(2)
    for line in range(2):
        alone[0], alone[1] = ground[line], ground[line]
        own = state_through(alone)
        if not np.isfinite(own).all():
            return 0.0
        turns[line] = math.atan2(own[1], own[0])
    turn, apart = abs(math.atan2(both[1], both[0])) / turn_rad, abs(turns[0] - turns[1]) / turn_rad
    place = 0.5 * abs(both[2] + both[3]) / shift_m
    factor = abs(math.log(max(abs(both[2] - both[3]), 0.1) / width_m)) / log_width
    if max(np.abs(turns).max() / turn_rad, turn, apart) > _FARTHEST:
        return 0.0
    if place > _FARTHEST_PLACE or factor > _FARTHEST_WIDTH:
        return 0.0
    return math.exp(-0.5 * (turn**2 + apart**2)) / ((1.0 + place**2) * (1.0 + factor**2))
