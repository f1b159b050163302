"""The regions into which the level set divides a window of the learned channel."""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.box import Box
from groundstation.detection.channel_window import TARGET_PX
from groundstation.detection.contour_evolution import settle_driven
from groundstation.detection.learned_channel import ChannelMaps

# drive of the level set per unit of log odds, and where odds say no more; its length term stays the configured one
_DRIVE, _MOST_ODDS = 0.1, 6.0
# regions nearer to each other than this share of the target are pieces of one
_PIECES = 0.35


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelCandidate:
    """A region of one window.

    Attributes
    ----------
    mask : (96, 128) its pixels.
    odds : largest log odds in it.
    centre : (2,) of its pixels, window px.
    box : around them, window px.
    """

    mask: MaskArray
    odds: float
    centre: FloatArray
    box: Box[int]


def candidates_of(maps: ChannelMaps, mu: float, prior: float = 0.0) -> list[ChannelCandidate]:
    """Return the regions into which the level set divides a window by its log odds.

    ``mu`` weighs its length; ``prior`` is added to the odds, and not to those of the candidates.
    """
    odds = np.clip(maps.aircraft + np.float32(prior), -_MOST_ODDS, _MOST_ODDS)
    drive = np.ascontiguousarray(_DRIVE * odds, np.float32)
    phi = np.where(drive > 0.0, np.float32(1.0), np.float32(-1.0))
    settle_driven(drive, phi, mu)
    inside = phi > 0.0
    reach = max(round(0.5 * _PIECES * TARGET_PX), 1)
    near = cv2.dilate(inside.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    count, labels = cv2.connectedComponents(near, connectivity=8)
    found = []
    for number in range(1, count):
        mask = inside & (labels == number)
        rows, columns = np.nonzero(mask)
        if rows.size == 0:
            continue
        box = Box(int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        found.append(
            ChannelCandidate(
                mask=mask,
                odds=float(maps.aircraft[mask].max()),
                centre=np.array([columns.mean(), rows.mean()]),
                box=box,
            )
        )
    return found
