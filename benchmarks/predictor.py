"""How well each predictor places the region of interest: rms error of the left camera's u, in px.

Case C at 10 Hz: 1 px and 0.00625° of noise, 25 m/s from y = 450 m, a glide of 3.5° with a flare, a weave of
±1.5 m, filter PSD 1 m²/s³; 60 runs, over 8–14 s. Each predictor extrapolates the last knots to the next frame;
knots are triangulated points or the filter's. Prints a table; `measure` returns it for tests.

    python benchmarks/predictor.py [--runs N]
"""

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from groundstation.estimation.trajectory_curve import Knot, curve, curve_inherited_tangent, hermite, line
from groundstation.geometry.camera import Lens
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Epoch, PixelMeasurement, PtuSample
from groundstation.rig.rig import ClockModel, Rig, Station
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

FRAME_S = 0.1
NOISE_RAD = math.radians(0.00625)
NOISE_PX = 1.0
FROM_S, TO_S = 8.0, 14.0


def truth(t_s: float) -> NDArray[np.float64]:
    """Position (3,) in m, runway frame."""
    y = 450.0 - 25.0 * t_s
    z = math.tan(math.radians(3.5)) * (y - 60.0) if y > 110.0 else max(0.3, 3.06 * math.exp(-(110.0 - y) / 35.0))
    return np.array([1.5 * math.sin(2 * math.pi * t_s / 8.0), y, z])


def rig() -> Rig:
    """Two ideal stations 10.77 m apart, 25 mm lens on 3.75 µm pixels."""
    lens = Lens(
        image_size_px=(1280, 960),
        focal_px=np.full(2, 6667.0),
        principal_point_px=np.array([639.5, 479.5]),
        distortion=np.zeros(5),
    )
    return Rig(
        stations=tuple(
            Station(
                name=name,
                fixed=False,
                known=("position", "orientation", "lens"),
                ptu_position_m=np.array([x, 0.0, 1.5]),
                runway_from_base_wxyz=np.array([1.0, 0, 0, 0]),
                head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0, 0]),
                camera_in_head_m=np.zeros(3),
                lens=lens,
                ptu_resolution_rad=0.0,
                ptu_sigma_rad=NOISE_RAD,
                ptu_clock=ClockModel(),
                camera_clock=None,
                readout_s=0.0,
                covariance_parameters=(),
                covariance=np.zeros((0, 0)),
            )
            for name, x in (("left", -5.385), ("right", 5.385))
        )
    )


def aim(geometry: StationGeometry, point: NDArray[np.float64]) -> tuple[float, float]:
    """Pan and tilt in rad that point at a point from the pedestal."""
    d = point - geometry.packed[9:12]
    return -math.atan2(d[0], d[1]), math.atan2(d[2], math.hypot(d[0], d[1]))


Predict = Callable[[Sequence[Knot], float], NDArray[np.float64] | None]


def one_run(seed: int) -> dict[str, list[float]]:
    """Return the errors in px of each predictor over one flight."""
    generator = np.random.default_rng(seed)
    stations = rig()
    geometries = {s.name: s.geometry() for s in stations.stations}
    base = Config()
    estimation = replace(
        base.estimation,
        acceleration_psd_m2_s3=(1.0, 1.0, 1.0),
        ptu_acceleration_psd_rad2_s3=1e-3,
        labelled_sigma_px=NOISE_PX,
        fix_window_s=0.005,
        residual_gate_sigma=1e3,
    )
    pipeline = Pipeline(stations, replace(base, estimation=estimation), span_m=2.3)
    filtered: list[Knot] = []
    velocities: list[NDArray[np.float64]] = []
    points: list[Knot] = []
    errors: dict[str, list[float]] = {}
    predictors: dict[str, tuple[Predict, list[Knot]]] = {
        "line, triangulated": (line, points),
        "line, filtered": (line, filtered),
        "curve, triangulated": (curve, points),
        "curve, filtered": (curve, filtered),
        "curve with inherited tangent, triangulated": (curve_inherited_tangent, points),
    }
    for k in range(int(TO_S / FRAME_S) + 1):
        t = k * FRAME_S
        place = truth(t)
        pan, tilt = aim(geometries["left"], place)
        true_u = _u(geometries["left"], place, pan, tilt)
        if t >= FROM_S:
            guesses = {name: predict(knots, t) for name, (predict, knots) in predictors.items()}
            last, v = filtered[-1], velocities[-1]
            ahead = Knot(t_s=t, position_m=last.position_m + (t - last.t_s) * v)
            guesses["filter's prediction (end of the Hermite path)"] = hermite(last, v, ahead, v, t)
            before, v0 = filtered[-2], velocities[-2]
            guesses["Hermite extrapolated beyond its last knot"] = _hermite_beyond(before, v0, last, v, t)
            for name, guess in guesses.items():
                if guess is not None:
                    errors.setdefault(name, []).append(_u(geometries["left"], guess, pan, tilt) - true_u)
        for s in stations.stations:
            true = aim(geometries[s.name], place)
            read = np.array(true) + generator.normal(0, NOISE_RAD, 2)
            pipeline.step(PtuSample(t_s=t, station=s.name, pan_rad=float(read[0]), tilt_rad=float(read[1])))
            projection = geometries[s.name].project(place, *true)
            if projection is None:
                raise RuntimeError(f"the aircraft at {place} is behind {s.name}")
            u, v_px = projection.pixel + generator.normal(0, NOISE_PX, 2)
            pipeline.step(PixelMeasurement(t_s=t, station=s.name, epoch=k, u_px=u, v_px=v_px))
        for estimate in pipeline.step(Epoch(t_s=t, epoch=k, stations=stations.names)).estimates:
            if estimate.kinematics is not None:
                filtered.append(Knot(t_s=t, position_m=estimate.kinematics.position_runway_m))
                velocities.append(estimate.kinematics.velocity_runway_m_s)
            if estimate.triangulation is not None:
                points.append(Knot(t_s=t, position_m=estimate.triangulation.point_runway_m))
    return errors


def _u(geometry: StationGeometry, point: NDArray[np.float64], pan: float, tilt: float) -> float:
    projection = geometry.project(point, pan, tilt)
    return float("inf") if projection is None else float(projection.pixel[0])


def _hermite_beyond(
    a: Knot, va: NDArray[np.float64], b: Knot, vb: NDArray[np.float64], t_s: float
) -> NDArray[np.float64]:
    """The same cubic followed past its end: what `hermite` refuses to do."""
    span = b.t_s - a.t_s
    s = (t_s - a.t_s) / span
    h00, h10 = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2
    h01, h11 = s * s * (3 - 2 * s), s * s * (s - 1)
    return h00 * a.position_m + h10 * span * va + h01 * b.position_m + h11 * span * vb


def measure(runs: int) -> dict[str, float]:
    """Return the rms error in px of each predictor over ``runs`` seeded flights."""
    gathered: dict[str, list[float]] = {}
    for seed in range(runs):
        for name, values in one_run(seed).items():
            gathered.setdefault(name, []).extend(values)
    return {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in gathered.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=60)
    table = measure(parser.parse_args().runs)
    for name, rms in sorted(table.items(), key=lambda item: item[1]):
        print(f"{name:48s} {rms:8.1f} px")


if __name__ == "__main__":
    main()
