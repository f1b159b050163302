"""Region of interest around a predicted target point."""

import math

from groundstation.arrays import FloatArray
from groundstation.box import Box
from groundstation.detection.config import DetectionConfig

_ROOM = 0.25  # of the basic size, which a silhouette keeps around it


def place_roi(
    predicted_px: FloatArray,
    predicted_covariance_px2: FloatArray,
    last_size_px: tuple[float, float] | None,
    config: DetectionConfig,
    image_size_px: tuple[int, int],
    last_middle_px: tuple[float, float] = (0.0, 0.0),
) -> Box[int] | None:
    """Return the window to search, clipped to the image, or None if it is outside.

    Parameters
    ----------
    predicted_px : (2,) expected target point, u and v.
    predicted_covariance_px2 : (2, 2) its covariance.
    last_size_px : width and height of the target's last silhouette, None if unknown.
    last_middle_px : middle of that silhouette's box relative to the target point: an aircraft that climbs over
        the camera hangs below its nose.

    The window is the target's last size plus the basic size, centred on the prediction and widened by ``roi_sigmas``
    of it to either side. It moves, without growing, so that the silhouette keeps a quarter of the basic size around
    it.
    """
    size = last_size_px if last_size_px is not None else (0.0, 0.0)
    edges: list[tuple[int, int]] = []
    for axis in (0, 1):
        aside = last_middle_px[axis]
        beyond = math.copysign(max(abs(aside) - _ROOM * config.roi_basic_px[axis], 0.0), aside)
        centre, variance = float(predicted_px[axis]) + beyond, float(predicted_covariance_px2[axis, axis])
        if not math.isfinite(centre) or not variance >= 0:
            return None
        sigma = min(math.sqrt(variance), config.roi_max_sigma_px)
        half = 0.5 * (size[axis] + config.roi_basic_px[axis]) + config.roi_sigmas * sigma
        limit = image_size_px[axis]
        low = min(max(centre - half + 0.5, 0.0), float(limit))
        high = min(max(centre + half + 0.5, 0.0), float(limit))
        edges.append((round(low), round(high)))
    (x0, x1), (y0, y1) = edges
    if x1 - x0 < 1 or y1 - y0 < 1:
        return None
    return Box(x0, y0, x1, y1)
