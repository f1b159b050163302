"""A lens with its covariance, and the same lens without its sixth-order coefficient."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens

PARAMETERS = (
    *("focal.x", "focal.y", "principal_point.x", "principal_point.y"),
    *("distortion.k1", "distortion.k2", "distortion.p1", "distortion.p2", "distortion.k3"),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibratedLens:
    """A ``lens`` and the ``covariance`` (9, 9) of `PARAMETERS`, px and the distortion's units; zero where unknown."""

    lens: Lens
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReducedLens:
    """A lens ``calibrated`` without k3, and how far at most a pixel of the image moves by it, ``worst_px``."""

    calibrated: CalibratedLens
    worst_px: float


def without_k3(calibrated: CalibratedLens) -> ReducedLens:
    """Approximate k3 by k1 and k2 over the image (least squares); focal length and centre stay."""
    lens = calibrated.lens
    w, h = lens.image_size_px
    grid = np.stack(np.meshgrid(np.linspace(0, w - 1, 41), np.linspace(0, h - 1, 31)), axis=-1).reshape(-1, 2)
    # the distorted radius stands for the undistorted one: the difference is of second order
    r = np.linalg.norm((grid - lens.principal_point_px) / lens.focal_px, axis=1)
    share = np.linalg.lstsq(np.stack([r**3, r**5], axis=1), r**7, rcond=None)[0]
    k3 = float(lens.distortion[4])
    turn = np.eye(9)
    turn[4, 8], turn[5, 8], turn[8, 8] = share[0], share[1], 0.0
    changed = Lens(
        image_size_px=lens.image_size_px,
        focal_px=lens.focal_px,
        principal_point_px=lens.principal_point_px,
        distortion=turn[4:, 4:] @ lens.distortion,
    )
    moved = np.abs(k3 * (r**7 - share[0] * r**3 - share[1] * r**5))
    covariance = turn @ calibrated.covariance @ turn.T
    return ReducedLens(
        calibrated=CalibratedLens(lens=changed, covariance=covariance),
        worst_px=float(moved.max() * lens.focal_px.max()),
    )
