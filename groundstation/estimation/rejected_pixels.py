"""Pixels that the gate rejects one after another: outliers, or a filter that is further off than it states.

Outliers jump. Labelled pixels of one camera that are rejected look after look, while no camera's pixel is accepted, and
that lie on one smooth path past the prediction are the target's: the prediction is then wrong by what they say. Pixels
of the program's own detector are not believed so: anything that stands still lies on such a path, too.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from groundstation.arrays import FloatArray

# so many looks over so long; with four the path below has two degrees of freedom a coordinate
_LOOKS, _LEAST_S = 5, 0.3
# of a longer run the newest, over which a path is straight
_KEPT_S = 0.6
# mean square of the distances from the path, in the pixels' own variance: 99.9 % of true ones are below
_ROUGHEST = 4.0


class _Rejection(NamedTuple):
    t_s: float
    residual_px: FloatArray
    variance_px2: float


@dataclass(frozen=True, slots=True, eq=False)
class RejectedPixels:
    """The run of rejected pixels of one camera since the last accepted one; replaced, never written to."""

    run: tuple[_Rejection, ...] = ()
    station: str = ""
    last_accepted_s: float = field(default=float("nan"))

    def accepted(self, t_s: float) -> "RejectedPixels":
        """Return the state after an accepted pixel of any camera."""
        return RejectedPixels(last_accepted_s=t_s)

    def rejected(
        self, station: str, t_s: float, residual_px: FloatArray, covariance_px2: FloatArray
    ) -> "RejectedPixels":
        """Return the state after a pixel was rejected: residual (2,), noise (2, 2)."""
        entry = _Rejection(t_s, residual_px, 0.5 * float(np.trace(covariance_px2)))
        before = self.run if station == self.station else ()
        run = (*(r for r in before if t_s - r.t_s <= _KEPT_S), entry)
        return RejectedPixels(run, station, self.last_accepted_s)

    @property
    def contradict(self) -> bool:
        """Whether the run says that the filter is wrong."""
        if len(self.run) < _LOOKS or self.run[-1].t_s - self.run[0].t_s < _LEAST_S:
            return False
        t = np.array([r.t_s for r in self.run])
        residuals = np.array([r.residual_px for r in self.run])
        design = np.column_stack([np.ones(len(t)), t - t.mean()])
        path, *_ = np.linalg.lstsq(design, residuals, rcond=None)
        off = residuals - design @ path
        variance = float(np.mean([r.variance_px2 for r in self.run]))
        return float((off**2).sum()) / (2.0 * (len(t) - 2)) <= _ROUGHEST * variance

    def doubt(self, jacobian_px_per_m: FloatArray) -> FloatArray:
        """Return the covariance (6, 6) to add to position and velocity, so that the newest pixel is believed.

        ``jacobian_px_per_m`` (2, 3) is that of the pixel by the position. The range is as wrong as what is seen of it.
        """
        newest = self.run[-1]
        shift_m = jacobian_px_per_m.T @ np.linalg.solve(jacobian_px_per_m @ jacobian_px_per_m.T, newest.residual_px)
        since_s = newest.t_s - self.last_accepted_s
        since_s = since_s if since_s > _LEAST_S else _LEAST_S
        variance = float(shift_m @ shift_m)
        return np.diag([variance] * 3 + [variance / since_s**2] * 3)
