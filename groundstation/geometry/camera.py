"""The lens: pinhole with OpenCV's k1 k2 p1 p2 k3 distortion."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from groundstation.arrays import FloatArray

# how far beyond the image's corner (in corner radii) the lens polynomial is still followed
LENS_REACH = 2.5
# and how close to the radius where it would fold back
FOLD_MARGIN = 0.9

_Floats = tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lens:
    """A camera's lens: image size (w, h) in px, focal (fx, fy) px, principal point (cx, cy) px, k1 k2 p1 p2 k3."""

    image_size_px: tuple[int, int]
    focal_px: FloatArray
    principal_point_px: FloatArray
    distortion: FloatArray

    @property
    def radius_limit(self) -> float:
        """Return the largest r² (normalised image plane) up to which the polynomial is used and still increases."""
        focal, centre = tuple(self.focal_px.tolist()), tuple(self.principal_point_px.tolist())
        return _radius_limit(self.image_size_px, focal, centre, tuple(self.distortion.tolist()))


# a fit builds stations of one lens thousands of times
@lru_cache(maxsize=256)
def _radius_limit(
    image_size_px: tuple[int, int], focal_px: _Floats, principal_point_px: _Floats, distortion: _Floats
) -> float:
    w, h = image_size_px
    corners = np.array([[-0.5, -0.5], [w - 0.5, -0.5], [-0.5, h - 0.5], [w - 0.5, h - 0.5]])
    normalised = (corners - principal_point_px) / np.array(focal_px)
    reach = LENS_REACH**2 * float((normalised**2).sum(axis=1).max())
    k1, k2, _, _, k3 = distortion
    # d(r·radial)/dr = 1 + 3 k1 q + 5 k2 q² + 7 k3 q³ with q = r²; its first positive root is the fold
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    folds = [float(r.real) for r in roots if abs(r.imag) < 1e-9 * max(1.0, abs(r)) and r.real > 0]
    return min([reach, *(FOLD_MARGIN * f for f in folds)])
