"""The target at the picture's border, the prediction as often outside as in: what either weighting makes of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from filter_flights.consistency import one_mode
from groundstation.arrays import FloatArray
from groundstation.estimation.config import OutOfViewWeighting
from groundstation.estimation.station_ekf import StationEkf
from groundstation.simulation import standard_rig
from groundstation.simulation.pointing_kernels import aim_many

POINT_M = np.array([0.0, 200.0, 8.0])
VELOCITY_M_S = np.array([0.0, -25.0, -1.5])
# ± 2 m across at 200 m are ± 67 px
PRIOR = np.diag([2.0, 4.0, 2.0, 0.3, 0.3, 0.3]) ** 2
INSIDE_PX = 15.0
PIXEL_PX = 0.5
FRAMES = 5
# half the picture's width and height, px, and the direction of the border
BORDERS = {"left": (-1, 0), "right": (1, 0), "top": (0, -1), "bottom": (0, 1)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """NEES per degree of freedom of the position (runs,) after the frames, and whether the prediction began outside."""

    nees: FloatArray
    outside: FloatArray


def fly_scene(border: str, weighting: OutOfViewWeighting, seeds: Sequence[int]) -> Scene:
    """Hold both heads so that the target is just inside one border, and start from a drawn error."""
    results = [_one(border, weighting, seed) for seed in seeds]
    return Scene(nees=np.array([r[0] for r in results]), outside=np.array([r[1] for r in results]))


def _one(border: str, weighting: OutOfViewWeighting, seed: int) -> tuple[float, float]:
    generator = np.random.default_rng([seed, 17])
    rig = standard_rig(resolution_rad=0.0, sigma_rad=1e-5)
    geometries = {s.name: s.geometry() for s in rig.stations}
    config = replace(one_mode(), out_of_view=weighting, gate_probability=1 - 1e-12)
    ekf = StationEkf(geometries, rig.names, config)
    ekf.predict_to(0.0)
    towards = np.array(BORDERS[border], dtype=float)
    angles = {}
    for name, geometry in geometries.items():
        width, height = geometry.image_size_px
        focal = float(geometry.lens.focal_px[0])
        off = towards * (np.array([width, height]) / 2 - INSIDE_PX) / focal
        pan, tilt = aim_many(geometry.packed, POINT_M[None])[0]
        # a head turned to the left (pan up) moves the target to the right; one tilted up moves it down
        angles[name] = (float(pan + np.arctan(off[0])), float(tilt + np.arctan(off[1])))
        ekf.set_angles(name, angles[name], (0.0, 0.0), 1e-5)
    error = np.linalg.cholesky(PRIOR) @ generator.normal(size=6)
    ekf.start_target(POINT_M + error[:3], VELOCITY_M_S + error[3:], PRIOR)
    outside = 0.0
    point = POINT_M
    for k in range(FRAMES):
        point = POINT_M + 0.02 * k * VELOCITY_M_S
        ekf.predict_to(0.02 * k)
        for name, geometry in geometries.items():
            reading = np.array(angles[name]) + generator.normal(0.0, 1e-5, 2)
            ekf.update_encoder(name, (reading[0], reading[1]), 1e-5, 0.0, 0.0)
            prediction, truth = ekf.predict_pixel(name), geometry.project(point, *angles[name])
            assert prediction is not None
            assert truth is not None
            if k == 0 and name == rig.names[0]:
                outside = float(not geometry.contains(prediction.pixel, margin_px=0.0))
            if geometry.contains(truth.pixel, margin_px=0.0):
                ekf.update_pixel(name, truth.pixel + generator.normal(0.0, PIXEL_PX, 2), np.eye(2) * PIXEL_PX**2)
    e = ekf.state[:3] - point
    return float(e @ np.linalg.solve(ekf.covariance[:3, :3], e)) / 3.0, outside
