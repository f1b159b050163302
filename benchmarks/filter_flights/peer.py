"""Stone Soup's extended Kalman filter on the same state and measurements, in a separate virtual environment."""

import os
import pickle
import subprocess
import sys
import time
import venv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from filter_flights.consistency import NEAR, drawn_case, one_mode
from filter_flights.run_filter import drawn_start, new_filter, true_states
from groundstation.arrays import FloatArray
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import PixelMeasurement, PtuSample
from groundstation.simulation import SimulatedFlight, simulate

FOLDER = Path("build/stonesoup-venv")
PACKAGE = "stonesoup==1.9.1"
_ANGLE, _RATE = 1e-4, 0.01

# seconds since the step before, and the fused measurement: kind, number of the station, two numbers
Step = tuple[float, list[tuple[str, int, FloatArray]]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeerComparison:
    """Position RMSE (3,) in m over the flights, median s per step (one per repeat), this filter's and the peer's."""

    ours_m: FloatArray
    theirs_m: FloatArray
    ours_s: FloatArray
    theirs_s: FloatArray
    furthest_m: float


def side_by_side(seeds: range, repeats: int = 5) -> PeerComparison:
    """Run both filters over the same flights, case B at 10 Hz, from the near start."""
    errors: list[list[FloatArray]] = [[], []]
    medians: list[list[float]] = [[], []]
    furthest = 0.0
    for seed in seeds:
        flight = simulate(drawn_case("B", seed, 10.0))
        steps = _steps(flight)
        times = np.cumsum([dt for dt, _ in steps])
        truth = true_states(flight, times)[:, :3]
        ekf, request = _beginning(flight, seed)
        request |= {"steps": steps, "repeats": repeats}
        theirs = _ask(request)
        found = []
        for _ in range(repeats):
            ekf, _ = _beginning(flight, seed)
            states, median = _run(ekf, flight, steps)
            medians[0].append(median)
            found = states
        medians[1] += theirs["median_s"]
        ours, peer = np.array(found)[:, :3], theirs["states"][:, :3]
        furthest = max(furthest, float(np.abs(ours - peer).max()))
        errors[0].append(ours - truth)
        errors[1].append(peer - truth)
    rmse = [np.sqrt((np.concatenate(e) ** 2).mean(axis=0)) for e in errors]
    return PeerComparison(
        ours_m=rmse[0],
        theirs_m=rmse[1],
        ours_s=np.array(medians[0]),
        theirs_s=np.array(medians[1]),
        furthest_m=furthest,
    )


def _beginning(flight: SimulatedFlight, seed: int) -> tuple[StationEkf, dict[str, object]]:
    """Return this filter at its start, and the same for the peer."""
    ekf = new_filter(flight, one_mode(), ParameterPrior.nothing())
    start = drawn_start(flight, seed, *NEAR)
    ekf.predict_to(0.0)
    for name in ekf.layout.angles:
        truth = flight.truth.stations[name]
        pan_tilt = (truth.angles_rad[0, 0], truth.angles_rad[0, 1])
        ekf.set_angles(name, pan_tilt, (truth.rates_rad_s[0, 0], truth.rates_rad_s[0, 1]), _ANGLE, _RATE)
    ekf.start_target(start.mean[:3], start.mean[3:], start.covariance)
    config = one_mode()
    motion = MotionModel(ekf.layout, config.acceleration_psd_m2_s3, config.ptu_acceleration_psd_rad2_s3)
    values, slopes = motion.pairs
    request: dict[str, object] = {
        "mean": ekf.state.copy(),
        "covariance": ekf.covariance.copy(),
        "angle_columns": [where.start for where in ekf.layout.angles.values()],
        "stations": [flight.rig[name].geometry().packed for name in ekf.layout.angles],
        "psd": motion.psd,
        "values": values,
        "slopes": slopes,
        "angle_variance": flight.rig.stations[0].angle_sigma_rad ** 2,
        "pixel_variance": 0.25,
    }
    return ekf, request


def _steps(flight: SimulatedFlight) -> list[Step]:
    """Return each pair's readings and pixels, station by station; everything carries the pair's stamp."""
    numbers = {name: k for k, name in enumerate(flight.rig.names)}
    at: dict[float, list[tuple[str, int, FloatArray]]] = {}
    for event in flight.events:
        match event:
            case PtuSample() if -1e-9 <= event.t_s <= flight.truth.t_s[-1] + 1e-9:
                values = np.array([event.pan_rad, event.tilt_rad])
                at.setdefault(round(event.t_s, 6), []).append(("angles", numbers[event.station], values))
            case PixelMeasurement():
                values = np.array([event.u_px, event.v_px])
                at.setdefault(round(event.t_s, 6), []).append(("pixel", numbers[event.station], values))
    times = sorted(at)
    return [(t - before, at[t]) for t, before in zip(times, [0.0, *times[:-1]], strict=True)]


def _run(ekf: StationEkf, flight: SimulatedFlight, steps: list[Step]) -> tuple[list[FloatArray], float]:
    """Return this filter's states after each step and the median time of one."""
    names, R, sigma = flight.rig.names, np.eye(2) * 0.25, flight.rig.stations[0].angle_sigma_rad
    now, took, states = 0.0, [], []
    for dt, measurements in steps:
        now += dt
        began = time.perf_counter()
        ekf.predict_to(now)
        for kind, number, values in measurements:
            if kind == "pixel":
                ekf.update_pixel(names[number], values, R)
            else:
                ekf.update_encoder(names[number], (values[0], values[1]), sigma, 0.0, 0.0)
        took.append(time.perf_counter() - began)
        states.append(ekf.state.copy())
    return states, float(np.median(took))


def _ask(request: dict[str, object]) -> dict[str, FloatArray]:
    """Let the peer work on a request."""
    python = FOLDER / "bin" / "python"
    if not (FOLDER / "installed").is_file():
        print(f"installing {PACKAGE} into {FOLDER}", file=sys.stderr)
        venv.create(FOLDER, with_pip=True, clear=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, PACKAGE], check=True)
        (FOLDER / "installed").touch()
    worker = [str(python), str(Path(__file__).parent.parent / "stone_soup" / "worker.py")]
    # one thread each: a filter's matrices are too small for more
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(worker, input=pickle.dumps(request), stdout=subprocess.PIPE, check=True, env=environment)
    answer: dict[str, FloatArray] = pickle.loads(done.stdout)
    return answer
