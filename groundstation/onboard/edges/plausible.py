"""Whether two lines of a picture can be the edges of the runway that was announced."""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.lines import C, D, angle_between, state_from_ground
from groundstation.onboard.edges.pose import CameraPose, ground_from_pixels

_FARTHEST = 3.0
# place and width have long tails: a position may be off by a runway's width, pitch makes a far one look narrow
_FARTHEST_PLACE = 9.0
_FARTHEST_WIDTH = 5.5


def plausible(
    crossings_px: FloatArray, rows_px: FloatArray, pose: CameraPose, kappa: FloatArray, config: TrackerConfig
) -> float:
    """Return the weight of a pair: 0 unless parallel on the ground, along the runway, near it, and of its width.

    Each of these is measured in the configuration's ``start_…``; beyond three of one, nine of the place, five of the
    width, it is no runway, and the nearer the weightier.
    """
    pixels = np.column_stack([crossings_px, np.tile(rows_px, 2)])
    ground = ground_from_pixels(pose, kappa, pixels).reshape(2, 2, 2)
    each = [state_from_ground(ground[[line, line]]) for line in range(2)]
    both = state_from_ground(ground)
    if not np.isfinite(both).all() or not all(np.isfinite(one).all() for one in each):
        return 0.0
    turns = [abs(angle_between(state)) / config.start_turn_rad for state in (*each, both)]
    apart = abs(angle_between(each[0]) - angle_between(each[1])) / config.start_turn_rad
    place = 0.5 * abs(both[C] + both[D]) / config.start_shift_m
    width = max(abs(float(both[C] - both[D])), 0.1)
    factor = abs(math.log(width / config.guess.width_m)) / math.log(config.start_width)
    if max(*turns, apart) > _FARTHEST or place > _FARTHEST_PLACE or factor > _FARTHEST_WIDTH:
        return 0.0
    return math.exp(-0.5 * float(turns[2] ** 2 + apart**2)) / float((1.0 + place**2) * (1.0 + factor**2))
