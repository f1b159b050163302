"""One way of flying or two: how the filter follows a glide, a flare, a take-off and a real landing."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from filter_flights.consistency import drawn_case
from filter_flights.run_filter import drawn_start, drive
from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.session.flight_log import load_flight_log
from groundstation.simulation import Scenario, case_c, simulate
from groundstation.simulation.approach import Flare, GlideApproach
from groundstation.simulation.logged_flight import trajectory_from_log
from groundstation.simulation.take_off import take_off
from groundstation.simulation.trajectory import Trajectory

Psd = tuple[float, float, float]
RATE_HZ = 15.0
_SETTLED_S = 2.0
_TOUCHDOWN_S = 613.5


def tuning(steady: Psd, manoeuvre: Psd, steady_s: float = 8.0, manoeuvre_s: float = 2.0) -> EstimationConfig:
    """Return the default tuning with these ways of flying; equal ones are one way."""
    return replace(
        EstimationConfig(),
        acceleration_psd_m2_s3=steady,
        manoeuvre_psd_m2_s3=manoeuvre,
        steady_s=steady_s,
        manoeuvre_s=manoeuvre_s,
    )


def flights(data: Path | None) -> dict[str, Trajectory | None]:
    """Return the flights, by name; None is drawn from the glide's own motion model. The log only if it exists."""
    found: dict[str, Trajectory | None] = {
        "glide": None,
        "flare": GlideApproach(
            start_y_m=350.0,
            end_y_m=40.0,
            flare=Flare.meeting(110.0, GlideApproach().aim_y_m, GlideApproach().slope_rad),
        ),
        "take-off": take_off(),
    }
    log = None if data is None else data / "fixedwing-gps-log" / "bin_parser_POS.csv"
    if log is not None and log.is_file():
        flown = load_flight_log(log)
        found["flown"] = trajectory_from_log(
            flown.t_s, flown.position_enu_m, touchdown_s=_TOUCHDOWN_S, before_s=14.0, sigma_m=0.03
        )
    return found


def errors(flown: Trajectory | None, config: EstimationConfig, seeds: Sequence[int]) -> tuple[FloatArray, float]:
    """Return the RMSE (3,) in m after 2 s and the ANEES of the position, case C."""
    squares, nees = [], []
    for seed in seeds:
        flight = simulate(_scenario(flown, seed))
        run = drive(flight, config, drawn_start(flight, seed, 1.0, 1.0))
        settled = run.t_s > run.t_s[0] + _SETTLED_S
        squares.append(run.error[settled, :3] ** 2)
        nees.append(run.nees(3)[settled] / 3)
    return np.sqrt(np.concatenate(squares).mean(axis=0)), float(np.concatenate(nees).mean())


def _scenario(flown: Trajectory | None, seed: int) -> Scenario:
    if flown is None:
        return drawn_case("C", seed, RATE_HZ)
    return case_c(seed=seed, rate_hz=RATE_HZ, trajectory=flown)
