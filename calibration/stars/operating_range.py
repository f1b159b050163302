"""A calibration's effect where aircraft are: derivatives of pixels over the angles of operation."""

from dataclasses import replace

import numpy as np

from calibration.mount.problem import Mark, MarkKind, MountProblem, MountSightings
from groundstation.arrays import FloatArray

# as in `calibration.mount.pointing`
WORK_PAN_DEG, WORK_TILT_DEG = (-30.0, -15.0, 0.0, 15.0, 30.0), (0.0, 7.5, 15.0)


def work_jacobian(problem: MountProblem, change: FloatArray, aside: float = 0.0) -> FloatArray:
    """Return the derivatives (n, 2, p) of the pixel of a point at rest, in rad of the camera's direction.

    One row for each pair of pan and tilt of operation, the point in the middle of the picture or ``aside`` of it, in
    parts of its width. The first component is across, positive to the right; the second downwards.
    """
    station = problem.station_at(change)
    lens = station.lens
    pixel = 0.5 * (np.array(lens.image_size_px) - 1.0) + np.array([aside * lens.image_size_px[0], 0.0])
    readings = np.radians([(pan, tilt) for pan in WORK_PAN_DEG for tilt in WORK_TILT_DEG])
    n = len(readings)
    geometry = station.geometry()
    angles = station.ptu_axes.angles_many(readings, np.zeros((n, 2)))
    towards = [geometry.ray(float(pixel[0]), float(pixel[1]), *map(float, a)).direction_runway for a in angles]
    sky = Mark(
        name="work",
        kind=MarkKind.SKY,
        place_m=np.array([0.0, 0.0, 1.0]),
        sigma=np.zeros(3),
        runway_from_board=np.eye(3),
    )
    seen = MountSightings(
        reading_rad=readings,
        sense=np.zeros((n, 2)),
        pixel_px=np.tile(pixel, (n, 1)),
        sigma_px=np.ones(n),
        pointing=np.arange(n),
        mark=np.zeros(n, dtype=np.int64),
        body_m=np.array(towards),
        label=("",) * n,
    )
    here = replace(problem, sightings=seen, marks=(sky,))
    return np.asarray(here.predict(change).jacobian / lens.focal_px[None, :, None])
