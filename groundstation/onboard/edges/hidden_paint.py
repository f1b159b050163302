"""Whether ground that is brighter than the pavement may be as white as paint, whatever the exposure.

Grey levels say nothing: the exposure makes snow as grey as grass is on another day. What the exposure leaves as it is:

- the ground over the paint that the same picture shows on the pavement, where it resolves any;
- the difference of ground and pavement in its colours, which light and haze leave as neutral as that of paint and
  pavement is. It decides where the picture resolves no paint.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.lines import crossings_at

# px in a metre from which on a line of 0.45 m is seen at more than half of its brightness, and rows that are looked at
_RESOLVED_PX_PER_M, _ROWS = 3.5, 24
# share of the width at either side that is left out, with its side line; least number of pixels in a row, and of rows
_BESIDE, _LEAST_PIXELS, _LEAST_ROWS = 0.12, 8, 8
# of the rows' brightest pixels, the quantile that is paint: a centre line is dashed
_PAINTED = 0.9
# ground over paint from which on the ground may be, and is, as white: over drawn worlds (train 0-29) the palest sand is
# at 0.79 where paint is resolved, chalk from 0.84 on (train 500000-500057)
_WHITE = (0.8, 0.86)
# rise of the brightest marks over the pavement, as a share of the ground's, below which they are none (chosen)
_BARE = 0.25
# spread of the relative difference over the colours up to which it is neutral, and from which on it is tinted: in the
# same worlds salt and chalk have 0.1 to 0.4, sand, dry and bleached grass 0.45 and more
_NEUTRAL = (0.25, 0.45)
# share of the pavement's level to which both are known in a colour: texture is tinted, a grey level is 1/255 (chosen)
_TINT_KNOWN_TO = 0.01


def whiteness(levels: FloatArray, paint: float | None) -> float:
    """Return from 0 to 1 how surely ground of ``levels`` (2, 3), pavement and ground by colour, looks like paint.

    ``paint``: grey level of paint on the pavement; None where none is resolved.
    """
    pavement, ground = levels
    rise = (ground - pavement) / np.maximum(pavement, 1.0 / 255.0)
    tint = max(float(rise.max() - rise.min()) - _TINT_KNOWN_TO, 0.0)
    spread = tint / max(abs(float(rise.mean())), 1e-9)
    neutral = 1.0 - _ramp(spread, *_NEUTRAL)
    if paint is None:
        return neutral
    # nothing is brighter than the pavement's texture: no paint; worn or seen small, it may look like the ground
    bare = paint - float(pavement.mean()) < _BARE * float((ground - pavement).mean())
    return 0.0 if bare else neutral * _ramp(float(ground.mean()) / paint, *_WHITE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PaintSight:
    """Where paint is looked for on the pavement: a picture (h, w, 3) uint8, the edges' rows (2,), the width, m."""

    image: ImageArray
    rows_px: FloatArray
    width_m: float

    def level(self, crossings_px: FloatArray) -> float | None:
        """Return the grey level, 0 to 1, of the brightest marks between edges (4,), None where paint is not resolved.

        Without paint it is that of the pavement's texture.
        """
        first = int(np.ceil(max(0.5 * self.rows_px.sum(), 0.0)))
        last = int(min(np.floor(self.rows_px[1]), self.image.shape[0] - 1))
        brightest = []
        for row in np.unique(np.linspace(first, max(last, first), _ROWS).astype(int)):
            left, _, right, _ = crossings_at(crossings_px, self.rows_px, np.array([row, row + 1.0]))
            wide = float(right - left)
            low, high = np.ceil(left + _BESIDE * wide), np.floor(right - _BESIDE * wide)
            pixels = self.image[row, max(int(low), 0) : max(int(high) + 1, 0)] if row <= last else self.image[:0, 0]
            if wide / self.width_m >= _RESOLVED_PX_PER_M and len(pixels) >= _LEAST_PIXELS:
                brightest.append(float(pixels.mean(axis=1).max()) / 255.0)
        return float(np.quantile(brightest, _PAINTED)) if len(brightest) >= _LEAST_ROWS else None


def _ramp(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0.0), 1.0)
