"""A calibration's effect where aircraft are: derivatives of pixels over the angles of operation."""

from dataclasses import replace

import numpy as np

from calibration.mount.problem import Mark, MarkKind, MountProblem, MountSightings
from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.rig.rig import Station

# about the runway's direction and the horizon, as in `calibration.mount.pointing`
WORK_PAN_DEG, WORK_TILT_DEG = (-30.0, -15.0, 0.0, 15.0, 30.0), (0.0, 7.5, 15.0)
# m; a direction is aimed at as a point so far away
_FAR_M = 1e6


def work_readings(station: Station) -> FloatArray:
    """Return the readings (n, 2), rad, of the angles of operation: about those at which it looks along the runway."""
    ahead = aim_at(station.geometry(), station.ptu_position_m + _FAR_M * np.array([0.0, 1.0, 0.0]))
    level = (0.0, 0.0) if ahead is None else station.ptu_axes.readings(ahead.pan_rad, ahead.tilt_rad, 0.0, 0.0)
    return np.radians([(pan, tilt) for pan in WORK_PAN_DEG for tilt in WORK_TILT_DEG]) + np.array(level)


def work_jacobian(problem: MountProblem, change: FloatArray, aside: float = 0.0) -> FloatArray:
    """Return the derivatives (n, 2, p) of the pixel of a point at rest, in rad of the camera's direction.

    One row for each pair of pan and tilt of operation, the point in the middle of the picture or ``aside`` of it, in
    parts of its width. The first component is across, positive to the right; the second downwards.
    """
    station = problem.station_at(change)
    lens = station.lens
    pixel = 0.5 * (np.array(lens.image_size_px) - 1.0) + np.array([aside * lens.image_size_px[0], 0.0])
    readings = work_readings(station)
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
